"""Compare lengths with a caliper's, step by step."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from dicflow.engine.node import At, InputFile, Joined, Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import InputError, StageError
from dicflow.kinds.cloud import Cloud
from dicflow.kinds.comparison import Comparison, FieldStrain
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.total import Total
from dicflow.kinds.track import Track

if TYPE_CHECKING:
    import numpy as np

    from dicflow.io.caliper import Caliper

__all__ = ["Compare"]

_SAME_LENGTH = 0.05
_OTHER_MEASURE = "a caliper measures engineering strain, not {}; set measure: engineering, or leave this stage out"


class Compare(Node):
    """Length of the region at every step, its displacement and strain, and their differences from a caliper's.

    Two lengths are measured. ``cloud``: the distance in space between the two loaded edges of the region as it was
    carried to the step, in the cloud of the step. ``tracked``: the distance between the material points that lay on
    these edges at the first step, continued from the grid to the outline. Both are means over the width. Or else the
    length of an extensometer is compared, with its standard deviation; one whose first length is not the caliper's
    within 5 % in strain alone. With one camera the lengths are in pixels, and only strains can be compared. Where there
    is neither a track nor an extensometer, the caliper's first length is stretched by the mean strain of the field. The
    columns are those of the thesis's Tables 6–10, with all lengths and the mean strain of the field beside them.
    """

    title: ClassVar = "compare with the caliper"
    scope: ClassVar = Scope.TEST
    takes: ClassVar = {
        "track": Port("track", at=At.ALL, optional=True),
        "cloud": Port("cloud", at=At.ALL, optional=True),
        "probes": Port("probes", optional=True),
        "total": Port("total", at=At.ALL, optional=True),
    }
    gives: ClassVar = "comparison"

    stage: Literal["compare"] = "compare"
    caliper: InputFile = parameter(
        ..., "CSV table with the columns load_g, length_mm and perhaps phase; one row per step"
    )
    axis: Literal["y", "x"] = parameter("y", "direction of the load in the image")
    length: Literal["tracked", "cloud"] = parameter("tracked", "which of the two lengths is compared")
    extensometer: str | None = parameter(None, "name of the extensometer among the probes that is compared instead")

    def check(self, path: Path) -> dict[str, Any]:
        from dicflow.io.caliper import read_caliper

        return {"rows": len(read_caliper(path).phase)}

    def agree(
        self,
        facts: Mapping[Path, Mapping[str, Any]],
        steps: Mapping[str, Mapping[str, Path]],
        inputs: Mapping[str, tuple[str, ...]],
    ) -> None:
        if not (counts := [len(inputs[port]) + more for port, more in (("track", 0), ("total", 1)) if port in inputs]):
            return
        count = counts[0]
        for path, fact in facts.items():
            if fact["rows"] != count:
                raise InputError(
                    f"{path}: has {fact['rows']} rows, but there are {count} steps; "
                    "write one row per step, the first for the unloaded specimen"
                )

    def problems(self, joined: Mapping[str, Joined]) -> Iterator[tuple[str, str]]:
        """A length that nobody gives, and a total whose strain is not that of a caliper."""
        if not {"track", "total"} & joined.keys() and self.extensometer is None:
            yield "extensometer", "is missing, and so are a track and a total; add one of the three"
        measure = getattr(joined["total"].node, "measure", "engineering") if "total" in joined else "engineering"
        if measure != "engineering":
            yield "total", _OTHER_MEASURE.format(measure)

    def look(self, total: Product) -> Product:
        """Mean strain of the field at one step."""
        import numpy as np

        field, strain = Total.read(total), total[{"y": "eyy", "x": "exx"}[self.axis]]
        known = np.isfinite(strain)
        mean = float(strain[known].mean()) if known.any() else math.nan
        return FieldStrain.write(mean, field.measure, field.follows_material)

    def run(
        self,
        caliper_path: Path,
        track: Sequence[Product] | None = None,
        cloud: Sequence[Product] | None = None,
        probes: Product | None = None,
        total: Sequence[Product] | None = None,
    ) -> Product:
        from dicflow.io.caliper import read_caliper

        caliper = read_caliper(caliper_path)
        seen = [FieldStrain.read(product) for product in total or ()]
        field_strain = None if total is None else _field_strain(seen)
        if self.extensometer is None and track is None and field_strain is not None:
            _refuse_thesis(seen)
            lengths, unit, chosen = {"field": caliper.length_mm[0] * (1.0 + field_strain)}, "mm", "field"
        else:
            lengths, unit = self._lengths(track, cloud, probes)
            chosen = self.length if self.extensometer is None else "extensometer"
        if len(lengths[chosen]) != len(caliper.length_mm):
            raise StageError(
                f"{caliper_path}: has {len(caliper.length_mm)} rows for {len(lengths[chosen])} steps; "
                "write one row per step, the first for the unloaded specimen"
            )
        same = chosen != "extensometer" or _is_comparable(lengths[chosen][0], caliper.length_mm[0])
        table = _table(caliper, lengths[chosen], unit, displacements=same and unit == "mm")
        table.update({f"{name}_length_{unit}": values for name, values in lengths.items()})
        if self.extensometer is not None and probes is not None:
            table["sigma_strain"] = ProbeTable.read(probes).of_extensometer(self.extensometer, "sigma_strain")
        if field_strain is not None:
            table["field_strain"] = field_strain
        return Comparison.write(table, caliper.phase, chosen, _summary(table))

    def _lengths(
        self, track: Sequence[Product] | None, cloud: Sequence[Product] | None, probes: Product | None
    ) -> tuple[dict[str, np.ndarray], str]:
        """The lengths by name, at every step, and their unit."""
        if self.extensometer is not None:
            if probes is None:
                raise StageError("an extensometer is read from probes; add a stage 'probes'")
            table = ProbeTable.read(probes)
            return {"extensometer": table.of_extensometer(self.extensometer, "length")}, table.unit
        if track is None:
            raise StageError("a length is measured in a track; add one, or name an extensometer of the probes")
        if self.length == "cloud" and cloud is None:
            raise StageError("length: cloud needs a cloud; name one, or use length: tracked")
        return _region_lengths(track, cloud, self.axis), "px" if cloud is None else "mm"


def _region_lengths(track: Sequence[Product], cloud: Sequence[Product] | None, axis: str) -> dict[str, np.ndarray]:
    """The lengths by name, at every step."""
    import numpy as np

    from dicflow.core.surfaces.length import cloud_length, edge_pairs, tracked_length

    first = Track.read(track[0])
    reference, outline = _upright(first["points"], axis)[..., :: _order(axis)], _outline(first, axis)
    found: dict[str, list[float]] = {"tracked": []} if cloud is None else {"tracked": [], "cloud": []}
    for index, step in enumerate(map(Track.read, track)):
        surface = None if cloud is None else Cloud.read(cloud[index])
        found["tracked"].append(tracked_length(_upright(_in_space(step, surface), axis), reference, outline))
        if surface is not None:
            x, y = surface.origin[:: _order(axis)]
            pairs = edge_pairs(_outline(step, axis))
            found["cloud"].append(cloud_length(_upright(surface["xyz"], axis), (x, y), pairs))
    return {name: np.array(values) for name, values in found.items()}


def _order(axis: str) -> int:
    """Step through (x, y) that puts the axis of the load last."""
    return 1 if axis == "y" else -1


def _upright(field: Any, axis: str) -> Any:
    """A field (row, col, k) turned so that the load acts along its rows' direction."""
    return field if axis == "y" else field.swapaxes(0, 1)


def _outline(track: Track, axis: str) -> np.ndarray:
    """Outline of the region's largest part, (n, 2) [px]."""
    from dicflow.core.photographs.region import area

    return max(track.polygons, key=lambda polygon: area([polygon])).exterior[:, :: _order(axis)]


def _in_space(track: Track, cloud: Cloud | None) -> np.ndarray:
    """The material points in space [mm], or in the image without a cloud [px]; (row, col, k)."""
    from dicflow.core.surfaces.displacement import bilinear

    return track["points"] if cloud is None else bilinear(cloud["xyz"], track["points"], cloud.origin)


def _is_comparable(length: float, other: float) -> bool:
    """Whether two first lengths are so near that displacements can be compared."""
    return abs(length - other) <= _SAME_LENGTH * other


def _table(caliper: Caliper, length: np.ndarray, unit: str, displacements: bool) -> dict[str, np.ndarray]:
    """The columns of the thesis's Tables 6–10; with errors of displacements only where they can be compared."""
    displacement = {"caliper": caliper.length_mm - caliper.length_mm[0], "dic": length - length[0]}
    strain = {"caliper": displacement["caliper"] / caliper.length_mm[0], "dic": displacement["dic"] / length[0]}
    table = {
        "load_g": caliper.load_g,
        "caliper_length_mm": caliper.length_mm,
        "caliper_displacement_mm": displacement["caliper"],
        "caliper_strain": strain["caliper"],
        f"dic_length_{unit}": length,
        f"dic_displacement_{unit}": displacement["dic"],
        "dic_strain": strain["dic"],
    }
    if displacements:
        error = displacement["dic"] - displacement["caliper"]
        table["displacement_error_mm"] = error
        table["displacement_error_pct"] = _percent(error, displacement["caliper"])
    table["strain_error"] = strain["dic"] - strain["caliper"]
    table["strain_error_pct"] = _percent(table["strain_error"], strain["caliper"])
    return table


def _percent(error: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Error in percent of the truth; 0 if both are 0, NaN if only the truth is 0."""
    import numpy as np

    whole = np.where(truth == 0.0, np.nan, truth)
    return np.where((truth == 0.0) & (error == 0.0), 0.0, 100.0 * error / whole)


def _field_strain(seen: Sequence[FieldStrain]) -> np.ndarray:
    """Mean strain of the field at every step; 0 at the first, NaN without measured points."""
    import numpy as np

    measures = {one.measure for one in seen}
    if measures - {"engineering"}:
        raise StageError(_OTHER_MEASURE.format(", ".join(measures)))
    return np.array([0.0, *(one.mean for one in seen)])


def _refuse_thesis(seen: Sequence[FieldStrain]) -> None:
    """Raise StageError for the thesis's totals: sums on a grid that does not move are not the strain of a length."""
    if not all(one.follows_material for one in seen):
        raise StageError(
            "a caliper measures engineering strain, but the total has the thesis's; "
            "set definition: material, or compare a length of the track"
        )


def _summary(table: Mapping[str, np.ndarray]) -> dict[str, float]:
    """The largest errors, and the number of measured steps."""
    import numpy as np

    errors = ("displacement_error_mm", "displacement_error_pct", "strain_error_pct")
    summary: dict[str, float] = {"measured_steps": int(np.isfinite(table["dic_strain"]).sum())}
    for name in errors:
        sizes = np.abs(table[name][np.isfinite(table[name])]) if name in table else np.zeros(0)
        if sizes.size:
            summary[f"max_{name}"] = float(sizes.max())
    return summary
