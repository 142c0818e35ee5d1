"""A thin specimen between grips: its section, its loads, and its field up to the sides."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar, Literal, NamedTuple

from pydantic import model_validator

from dicflow.engine.node import At, Joined, Millimetres, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.channels import Channels
from dicflow.kinds.points import Points
from dicflow.kinds.region import Region
from dicflow.kinds.sheet import SheetFacts, SheetFields
from dicflow.kinds.total import Total
from dicflow.stages._section import check_uncertainty

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.photographs.polygon import Polygon
    from dicflow.stages._selected import Selected

__all__ = ["Sheet", "sentence"]

_TO_NEWTON = {"N": 1.0, "kN": 1e3, "mN": 1e-3, "g": 9.80665e-3, "kg": 9.80665}
_LEAST_ROWS, _LEAST_POINTS = 4, 4
"""Rows of points between the ends, and points of a row, that are needed."""
_BORDER_PX = 2.0
"""Distance from the border of the photograph up to which a side counts as not in view."""
_U_SIDE_PX = 0.5
"""Standard uncertainty of a side of the region."""
_FEW = 0.9
"""Share of the points of the field that should be known at all steps."""
_MIDDLE = (0.25, 0.375, 0.5, 0.625, 0.75)
"""Places along the region at which its sides are looked at before anything runs."""
_RIM = 0.1
"""Share of the width without points from which a warning is due."""


class _Row(NamedTuple):
    """A row of points: its number, the known columns, and where the sides are [columns]."""

    number: int
    columns: np.ndarray
    sides: tuple[float, float]


class _Grid(NamedTuple):
    """Points of the first step.

    known : (row, col) bool — at all loaded steps
    origin, step : pixel (x, y) of the first point, and distance of the points [px]
    jacobian : (row, col, 2, 2) — derivatives of the places by column and row, in the plane of the sheet [mm]
    """

    known: np.ndarray
    origin: tuple[float, float]
    step: float
    jacobian: np.ndarray


class Sheet(Node):
    """Prepare a thin specimen between grips, pulled along the y of the photographs, for ``virtual_fields``.

    The width is that of the region: its edges in the first photograph are those of the specimen. Points whose window is
    cut by the ends of the field are left out, since any part between two sections carries the same load; beyond the
    points next to the sides, the field goes on straight up to them. Points lost at some step are left out of all.
    """

    title: ClassVar = "thin specimen between grips"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {
        "total": Port("total", at=At.ALL),
        "points": Port("points", at=At.FIRST, of="total"),
        "region": Port("region", optional=True),
        "channels": Port("channels"),
    }
    gives: ClassVar = "sheet"
    impl_version: ClassVar = 2

    stage: Literal["sheet"] = "sheet"
    thickness: Millimetres = parameter(..., "thickness of the unloaded specimen", unit="mm", gt=0)
    u_thickness: Millimetres = parameter(..., "standard uncertainty of the thickness", unit="mm", ge=0)
    width: Millimetres | None = parameter(
        None, "of the unloaded specimen, side to side; that of the region unless given", unit="mm"
    )
    u_width: Millimetres | None = parameter(
        None, "standard uncertainty of the width; unless given 0, or half a pixel at each side of the region", unit="mm"
    )
    phase: Literal["loading", "unloading", "both"] = parameter("loading", "part of the cycle that is taken")

    @model_validator(mode="after")
    def _section(self) -> Sheet:
        check_uncertainty("width", self.width, self.u_width)
        check_uncertainty("thickness", self.thickness, self.u_thickness)
        return self

    def problems(self, joined: Mapping[str, Joined]) -> Iterator[tuple[str, str]]:
        """A region that is drawn up to the border of the photograph."""
        if self.width is not None or "region" not in joined:
            return
        try:
            if selected := _selected(joined["region"]):
                outline = _outline(selected.polygons)
                least, most = outline[:, 1].min(), outline[:, 1].max()
                for share in _MIDDLE:
                    _sides_in_view(outline, least + share * (most - least), selected.size[0])
        except StageError as error:
            yield "region", str(error)

    def run(
        self, total: Sequence[Product], points: Product, channels: Product, region: Product | None = None
    ) -> Product:
        import numpy as np

        names = tuple(getattr(total, "steps", map(str, range(1, len(total) + 1))))
        totals, (forces, u_force, phases) = [Total.read(one) for one in total], _loads(Channels.read(channels), names)
        unknown = int(np.isnan(forces).sum())
        loaded = [k for k in range(len(totals)) if forces[k] > 0.0 and self.phase in ("both", phases[k])]
        used = [k for k in loaded if totals[k].known().any()]
        if not used:
            least = float(np.nanmin(forces, initial=0.0))
            sign = f" the load is negative, down to {least:.4g} N: its sign is reversed;" if least < 0.0 else ""
            which = "no step" if self.phase == "both" else f"no step of {self.phase}"
            raise StageError(
                f"{which} has both a load above 0 and measured points;{sign} look at the load and the total"
            )
        _check_direction([totals[k] for k in np.flatnonzero(forces > 0.0)], forces[forces > 0.0])
        fields = [totals[k] for k in used]
        grid = _grid(fields, Points.read(points))
        rows = list(self._rows(grid, fields[0], Points.read(points), None if region is None else Region.read(region)))
        values, facts = self._integrals(grid, rows, fields)
        values |= {"forces": forces[used], **_errors(fields, _places(rows))}
        facts = facts._replace(u_force=u_force)
        warnings = [*_lost(len(loaded) - len(used)), *_unloaded(unknown), *_warnings(facts, len(values["areas"]), rows)]
        return SheetFields.write(values, [names[k] for k in used], facts, warnings)

    def _rows(self, grid: _Grid, total: Total, points: Points, region: Region | None) -> Iterator[_Row]:
        """The rows whose windows lie inside the field along the load, with the sides of the specimen."""
        import numpy as np

        found = np.flatnonzero(grid.known.sum(axis=1) >= _LEAST_POINTS)
        cut = 0 if total.gauge is None else int(total.gauge.side_px / (2.0 * grid.step))
        whole = found[(found >= found.min() + cut) & (found <= found.max() - cut)] if found.size else found
        if len(whole) < _LEAST_ROWS:
            raise StageError(
                f"{len(whole)} rows of points are known at all loaded steps and not cut by the ends of the field; "
                "leave steps out, take a smaller window of the strain, or points that lie closer"
            )
        for number in whole:
            columns = np.flatnonzero(grid.known[number])
            yield _Row(int(number), columns, self._sides(grid, int(number), columns, points, region))

    def _sides(
        self, grid: _Grid, row: int, columns: np.ndarray, points: Points, region: Region | None
    ) -> tuple[float, float]:
        """Where the sides of the specimen are in a row [columns]."""
        import numpy as np

        if self.width is not None:
            spacing = float(np.linalg.norm(grid.jacobian[row, columns, :, 0], axis=-1).mean())
            rim = (self.width / spacing - (columns[-1] - columns[0])) / 2.0
            if rim < -0.02 * self.width / spacing:
                seen = (columns[-1] - columns[0]) * spacing
                raise StageError(
                    f"the points are {seen:.1f} mm wide, more than the width of {self.width:g} mm; correct it"
                )
            return float(columns[0] - rim), float(columns[-1] + rim)
        if region is None:
            raise StageError("the width is unknown; give width, or a region whose edges are those of the specimen")
        return _sides_of_region(region, points.image_width, grid, row)

    def _integrals(
        self, grid: _Grid, rows: Sequence[_Row], fields: Sequence[Total]
    ) -> tuple[dict[str, np.ndarray], SheetFacts]:
        """Places, areas and gradients of the points, and the facts of the sheet."""
        import numpy as np

        from dicflow.core.material.quadrature import row_weights

        weights = [row_weights(one.columns.astype(float), *one.sides) for one in rows]
        jacobians = [grid.jacobian[one.number, one.columns] for one in rows]
        widths = [w @ np.linalg.norm(j[:, :, 0], axis=-1) for w, j in zip(weights, jacobians, strict=True)]
        areas = np.concatenate([w * np.linalg.det(j) for w, j in zip(weights, jacobians, strict=True)])
        width = float(np.mean(widths))
        length = float(areas.sum()) / width
        first, count = rows[0].number, rows[-1].number - rows[0].number + 1
        across = np.concatenate([(one.columns - one.sides[0]) / (one.sides[1] - one.sides[0]) for one in rows])
        along = np.concatenate([np.full(len(one.columns), (one.number - first + 0.5) / count) for one in rows])
        scale = np.concatenate([np.full(len(one.columns), 1.0 / (one.sides[1] - one.sides[0])) for one in rows])
        by_index = np.stack([width * scale, np.full(len(scale), length / count)], axis=-1)
        slopes = by_index[:, :, None] * np.linalg.inv(np.concatenate(jacobians))
        places = _places(rows)
        values = {
            "places": np.stack([width * across, length * along], axis=-1),
            "slopes": slopes,
            "areas": areas,
            "gradients": np.stack([total["gradient"][places] for total in fields]),
            "lines": np.arange(count + 1) * length / count,
        }
        rim = float(np.mean([1.0 - np.ptp(one.columns) / (one.sides[1] - one.sides[0]) for one in rows]))
        pixel = width / float(np.mean([one.sides[1] - one.sides[0] for one in rows])) / grid.step
        measured = math.sqrt(2.0) * _U_SIDE_PX * pixel if self.width is None else 0.0
        u_width = measured if self.u_width is None else self.u_width
        shared = _shared(fields[0])
        return values, SheetFacts(width, length, self.thickness, u_width, self.u_thickness, shared, 0.0, rim)


def _loads(channels: Channels, steps: Sequence[str]) -> tuple[np.ndarray, float, Sequence[str]]:
    """Load at each step of the total [N], NaN where unknown, its standard uncertainty, and the phases.

    Raises StageError without N.
    """
    import numpy as np

    load = channels.of(channels.load)
    factor = _TO_NEWTON.get(load.unit)
    if factor is None:
        raise StageError(f"the load '{channels.load}' has the unit '{load.unit}'; expected {', '.join(_TO_NEWTON)}")
    if missing := [step for step in steps if step not in channels.steps]:
        raise StageError(f"the channels have no step {', '.join(missing)}; give a load for every step")
    places = [channels.steps.index(step) for step in steps]
    forces = load.values[places] * factor
    known = np.zeros(0) if load.u is None else load.u[places][np.isfinite(load.u[places])]
    u = float(np.median(known)) * factor if known.size else 0.0
    peak = int(np.argmax(np.nan_to_num(forces)))
    phases = channels.phases or [
        "loading" if place <= places[peak] else "unloading" for place in range(max(places) + 1)
    ]
    return forces, u, [phases[place] for place in places]


def _grid(totals: Sequence[Total], points: Points) -> _Grid:
    """The points known at all steps. Raises StageError where there are too few, or no lengths in mm."""
    import numpy as np

    from dicflow.core.material.quadrature import smooth_derivatives
    from dicflow.core.strain.surface_strain import tangent_basis

    if not totals[0].in_space:
        raise StageError("virtual work needs lengths in mm; measure with two cameras")
    known = np.all([total.known() for total in totals], axis=0)
    step, xy = float(points.grid.step_size), points["xy"]
    row, col = np.indices(known.shape)
    origin = tuple(float(np.nanmedian(xy[..., axis] - step * index)) for axis, index in ((0, col), (1, row)))
    derivatives = smooth_derivatives(totals[0]["xyz_reference"])
    jacobian = np.swapaxes(tangent_basis(derivatives), -1, -2) @ derivatives
    return _Grid(known, (origin[0], origin[1]), step, jacobian)


def _sides_of_region(region: Region, image_width: int, grid: _Grid, row: int) -> tuple[float, float]:
    """Edges of the region in a row [columns]. Raises StageError where they are not those of one sheet in view."""
    sides = _sides_in_view(_outline(region.polygons), grid.origin[1] + grid.step * row, image_width)
    left, right = ((x - grid.origin[0]) / grid.step for x in sides)
    return left, right


def _outline(polygons: Sequence[Polygon]) -> np.ndarray:
    """Outline (n, 2) of one sheet [px]. Raises StageError where there are several, or holes."""
    if len(polygons) != 1 or polygons[0].holes:
        raise StageError(
            "the region has holes or several parts, but virtual work needs one sheet without; draw one outline"
        )
    return polygons[0].exterior


def _sides_in_view(outline: np.ndarray, y: float, image_width: int) -> tuple[float, float]:
    """Least and largest x of an outline at a y [px]. Raises StageError for a side at the border of the photograph."""
    from dicflow.core.material.quadrature import sides_at

    sides = sides_at(outline, y)
    for side, distance in (("left", sides[0]), ("right", image_width - 1 - sides[1])):
        if distance < _BORDER_PX:
            raise StageError(
                f"the {side} edge of the specimen is not in view: the region reaches the border of the photograph; "
                "give width, or photograph the whole specimen"
            )
    return sides


def _selected(region: Joined) -> Selected | None:
    """The region in the photograph; None where it is unknown before anything runs. Raises StageError for a bad mask."""
    node, images = region.node, region.inputs.get("images")
    if images is None or "left" not in images.facts or getattr(images.node, "orientation", None) == "upright":
        return None
    if getattr(node, "auto", True) or getattr(node, "frame", None) != "photograph":
        return None
    size = int(images.facts["left"]["width"]), int(images.facts["left"]["height"])
    file = next((Path(file) for file in region.files), None)
    found: Selected = node.given(size, "the left photograph", file)  # type: ignore[attr-defined]
    return found


def _check_direction(totals: Sequence[Total], forces: np.ndarray) -> None:
    """Raise StageError for a load that does not grow with the stretch, over all loaded steps."""
    import numpy as np

    points = [total.known() for total in totals]
    stretch = np.array(
        [np.mean(one["gradient"][at][:, 1, 1]) if at.any() else np.nan for one, at in zip(totals, points, strict=True)]
    )
    seen = np.isfinite(stretch)
    if seen.sum() > 2 and np.ptp(forces[seen]) > 0.0 and np.corrcoef(stretch[seen], forces[seen])[0, 1] <= 0.0:
        raise StageError(
            "the load runs against the stretch: the more load, the shorter the specimen; look at the order of rows and "
            "the sign of the load"
        )


def _places(rows: Sequence[_Row]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns (n,) of the points of all rows."""
    import numpy as np

    numbers = np.repeat([one.number for one in rows], [len(one.columns) for one in rows])
    return numbers, np.concatenate([one.columns for one in rows])


def _errors(totals: Sequence[Total], places: tuple[np.ndarray, np.ndarray]) -> dict[str, np.ndarray]:
    """Root mean square σ of noise and of bias of the strains along both axes over the points at each step, (step,).

    0 if unknown. places : rows and columns (n,) of the points
    """
    import numpy as np

    if not all(total.has_uncertainty for total in totals):
        return {"u_gradient": np.zeros(len(totals)), "u_bias": np.zeros(len(totals))}
    noise, bias = (
        np.array([[each(total, name)[places] for name in ("exx", "eyy")] for total in totals], dtype=float)
        for each in (Total.sigma, Total.bias)
    )
    return {
        "u_gradient": np.sqrt(np.nanmean(noise**2, axis=(1, 2))),
        "u_bias": np.sqrt(np.mean(bias**2, axis=(1, 2))),
    }


def _shared(total: Total) -> float:
    """Number of neighbours whose windows overlap so much that they have one noise."""
    return 1.0 if total.gauge is None else max(1.0, (total.gauge.side_px / total.step_size) ** 2)


def _lost(count: int) -> Iterator[str]:
    if count:
        steps = "1 loaded step has" if count == 1 else f"{count} loaded steps have"
        yield f"{steps} no points and is left out; look at its photographs"


def _unloaded(count: int) -> Iterator[str]:
    if count:
        steps = "1 step has no load and is" if count == 1 else f"{count} steps have no load and are"
        yield f"{steps} left out; look at the load's column"


def _warnings(facts: SheetFacts, count: int, rows: Sequence[_Row]) -> Iterator[str]:
    if facts.rim > _RIM:
        shown = f"the points show {100 * (1 - facts.rim):.0f} % of the width"
        yield f"{shown}; beyond them the field is taken to go on straight"
    whole = sum(int(one.columns[-1] - one.columns[0]) + 1 for one in rows)
    if count < _FEW * whole:
        yield f"only {100 * count / whole:.0f} % of the points are known at all loaded steps; the others are left out"


def sentence(stage: Sheet, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    if product is None or stage.width is not None:
        return "The field of the specimen between two sections was continued to its sides."
    width = SheetFields.read(product).facts.width
    return (
        f"The width of the specimen, {width:.2f} mm, is that of the region in the first photograph, up to which the "
        "field was continued."
    )
