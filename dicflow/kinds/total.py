"""Displacement and strain since the first step."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.kinds.frame import frame_from_json, frame_to_json
from dicflow.kinds.kind import GRID, STATUS, Kind, Layout
from dicflow.kinds.quantities import BASIC, ERRORS, of_field, strain_function

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.cameras.frames import Frame
    from dicflow.core.cameras.rigid import RigidMotion
    from dicflow.core.strain.measures import GradientMeasures
    from dicflow.core.uncertainty.overlap import ShapeFunction

__all__ = [
    "DEGREE",
    "VSG",
    "Gauge",
    "Total",
    "TotalFacts",
    "field_means",
    "frames_to_json",
    "gradient_measures",
    "named_with_unit",
    "rigid_motion_to_json",
]

Definition = Literal["precise", "material", "thesis"]

_PLACES = {
    "xyz": Layout((*GRID, "component"), "{unit}", "place"),
    "xyz_reference": Layout((*GRID, "component"), "{unit}", "place at the first step"),
    "xy": Layout((*GRID, "image_component"), "px", "place in the image"),
    "xy_reference": Layout((*GRID, "image_component"), "px", "place in the image at the first step"),
    "gradient": Layout((*GRID, "out", "in"), "1", "deformation gradient"),
    "covariance": Layout(
        (*GRID, "pair"), "{unit}²", "covariance of the place at this step and the first, upper triangle by rows"
    ),
    "calibration_xyz": Layout((*GRID, "component"), "{unit}", "calibration's share in σ of the place"),
}
DEGREE = Layout(GRID, "1", "degree of the polynomial of the strain")
VSG = Layout(GRID, "px", "side of the virtual strain gauge")
_LAST = "last_"
"""Begins the names of arrays, and of their axes, that hold the last total with displacements."""
_SINGLE = ("covariance", "calibration_xyz")
"""Kept in single precision, as standard deviations are."""


class Gauge(NamedTuple):
    """The virtual strain gauge (VSG): the part of the specimen over which each strain is a mean.

    side_px : of the square in the first photograph [px]
    side_mm : on the specimen [mm]; None with one camera
    """

    side_px: float
    side_mm: float | None

    @property
    def size(self) -> str:
        """``74 px = 5.3 mm``."""
        return f"{self.side_px:.0f} px" + ("" if self.side_mm is None else f" = {self.side_mm:.3g} mm")


class TotalFacts(NamedTuple):
    """Definition, unit and titles of the numbers of a total.

    definition : precise, from subsets; material or thesis, from increments
    unit : of displacements and places, mm or px
    titles : quantity → its measure in words
    further : attributes of one definition only
    """

    definition: Definition
    unit: str
    titles: Mapping[str, str]
    further: Mapping[str, Any]


class Total(Kind):
    """Fields (row, col) of displacement and strain at the points that have both; NaN elsewhere."""

    KINDS: ClassVar = ("total",)

    @classmethod
    def write(
        cls,
        fields: Mapping[str, np.ndarray],
        status: np.ndarray,
        facts: TotalFacts,
        beside: Mapping[str, Variable] | None = None,
    ) -> Product:
        """A product of fields.

        fields : quantities, their standard deviations and shares (row, col), and places (row, col, …)
        status : (row, col)
        beside : arrays of the same points from other products
        """
        variables = {name: _variable(name, values, facts) for name, values in fields.items()}
        attrs = {"definition": facts.definition, "unit": facts.unit, "measures": dict(facts.titles), **facts.further}
        return Product("total", {**variables, "status": STATUS(status), **(beside or {})}, attrs)

    def lost(self, last: Total | None) -> Product:
        """The product of a step without displacements, with the total to which the next step adds; None for none."""
        known = {} if last is None else last.product.variables
        variables = {
            f"{_LAST}{name}": part._replace(dims=tuple(f"{_LAST}{dim}" for dim in part.dims))
            for name, part in known.items()
            if not name.startswith(_LAST)
        }
        attrs = {**self.product.attrs, "lost": True}
        return replace(self.product, variables={**self.product.variables, **variables}, attrs=attrs)

    def with_scale(self, facts: Mapping[str, Any]) -> Product:
        """The product of one camera in millimetres. facts : of the scale"""
        return replace(self.product, attrs={**self.product.attrs, "scale": dict(facts)})

    @property
    def window_shares(self) -> Mapping[str, float]:
        """Side of the window in points, as text → share of the points; empty where all have the same."""
        found: Mapping[str, float] = self.product.attrs.get("window_shares", {})
        return found

    @property
    def last(self) -> Total | None:
        """The total of the last step with displacements: this one, or one before; None if unknown yet."""
        if not self.product.attrs.get("lost"):
            return self
        kept = {
            name.removeprefix(_LAST): part._replace(dims=tuple(dim.removeprefix(_LAST) for dim in part.dims))
            for name, part in self.product.variables.items()
            if name.startswith(_LAST)
        }
        attrs = {name: value for name, value in self.product.attrs.items() if name != "lost"}
        return Total(replace(self.product, variables=kept, attrs=attrs)) if kept else None

    @property
    def definition(self) -> Definition:
        """How the numbers are defined: precise, from subsets; material or thesis, from increments."""
        found: Definition = self.product.attrs["definition"]
        return found

    @property
    def follows_material(self) -> bool:
        """Whether a point is the same material at every step; the thesis's definition has a new grid at each."""
        return self.definition != "thesis"

    @property
    def unit(self) -> str:
        """Unit of displacements and places: mm, or px with one camera and no scale."""
        return str(self.product.attrs["unit"])

    @property
    def in_space(self) -> bool:
        """Whether two cameras measured it."""
        return self.unit == "mm" and "scale" not in self.product.attrs

    @property
    def relative_u_of_scale(self) -> float | None:
        """Relative standard uncertainty of all lengths by the scale of one camera; None without a scale."""
        found: float | None = self.product.attrs.get("scale", {}).get("relative_u")
        return found

    @property
    def measure(self) -> str:
        """Name of the measure of strain."""
        return str(self.product.attrs.get("measure", "engineering"))

    @property
    def directions(self) -> Literal["material", "global"]:
        """Whether x and y of the strains are the material's, as they lay at the first step, or the frame's."""
        found: Literal["material", "global"] = self.product.attrs.get("directions", "material")
        return found

    @property
    def titles(self) -> Mapping[str, str]:
        """Quantity → its measure in words."""
        found: Mapping[str, str] = self.product.attrs.get("measures", {})
        return found

    @property
    def step_size(self) -> float:
        """Distance of neighbouring points at the first step [px]."""
        return float(self.product.attrs["step_size"])

    @property
    def gauge(self) -> Gauge | None:
        """The virtual strain gauge; None if undefined, as without subsets."""
        attrs = self.product.attrs
        return Gauge(attrs["vsg_px"], attrs["vsg_mm"]) if "vsg_px" in attrs else None

    @property
    def has_uncertainty(self) -> bool:
        """Whether each value has a standard deviation."""
        return "covariance" in self

    @property
    def subset_size(self) -> int:
        """Side of a subset [px]; only with uncertainty."""
        return int(self.product.attrs["subset_size"])

    @property
    def window_points(self) -> tuple[int, int]:
        """Rows and columns of the window of a strain [points]."""
        rows, cols = self.product.attrs["window_points"]
        return rows, cols

    @property
    def degree(self) -> int:
        """Degree of the polynomial in the window, of most points; only with uncertainty."""
        return int(self.product.attrs["degree"])

    @property
    def shape_shares(self) -> Mapping[ShapeFunction, Sequence[float]]:
        """Shape function → its shares in the variances of U, V and W; only with uncertainty."""
        found: Mapping[ShapeFunction, Sequence[float]] = self.product.attrs["shape_shares"]
        return found

    @property
    def frames(self) -> tuple[Frame, Frame]:
        """Frames of the places at the step and at the first one, in the left camera's frame; only with uncertainty."""
        at_step, at_first = map(frame_from_json, self.product.attrs["frames"])
        return at_step, at_first

    @property
    def rigid_motion_removed(self) -> bool:
        """Whether the rigid-body motion since the first step was removed."""
        return self.product.attrs.get("rigid") is not None

    @property
    def fields(self) -> Iterator[str]:
        """Names of the arrays with one number per point, the status left out."""
        return (name for name, part in self.product.variables.items() if part.dims == GRID and name != "status")

    def sigma(self, name: str) -> np.ndarray:
        """Standard deviation (row, col) of a quantity by the noise of the photographs."""
        return self[f"sigma_{name}"]

    def bias(self, name: str) -> np.ndarray:
        """Standard deviation (row, col) of the bias that remains in a quantity; 0 where it was not estimated."""
        import numpy as np

        known = f"bias_{name}" in self
        return np.nan_to_num(self[f"bias_{name}"]) if known else np.zeros_like(self[f"sigma_{name}"])

    def uncertainty(self, name: str) -> np.ndarray:
        """Combined standard uncertainty (row, col) of a quantity: by noise and the bias that remains."""
        return self[f"u_{name}"]

    def unit_of(self, name: str) -> str:
        """Unit of an array."""
        return self.product.variables[name].units

    def title(self, name: str) -> str:
        """What an array holds, in words."""
        return self.titles.get(name) or self.product.variables[name].long_name or name

    def caption(self, name: str) -> str:
        """The title, for a strain with the virtual strain gauge."""
        quantity = of_field(name)
        belongs_to_point = quantity is None or quantity.is_displacement
        if self.gauge is None or belongs_to_point:
            return self.title(name)
        return f"{self.title(name)}, VSG {self.gauge.size}"

    def known(self) -> np.ndarray:
        """(row, col) bool — the points with displacement, strain and a place."""
        import numpy as np

        placed = np.isfinite(self["xyz_reference"]).all(axis=-1)
        return np.asarray(np.isfinite(np.stack([self[name] for name in BASIC])).all(axis=0) & placed)


def _variable(name: str, values: np.ndarray, facts: TotalFacts) -> Variable:
    """One array with its axes, unit and title; errors in single precision."""
    import numpy as np

    single = name in _SINGLE or name.startswith(tuple(ERRORS))
    values = values.astype(np.float32) if single else values
    if name in _PLACES:
        layout = _PLACES[name]
        return layout._replace(units=layout.units.format(unit=facts.unit))(values)
    prefix = next((prefix for prefix in ERRORS if name.startswith(prefix)), "")
    base = name.removeprefix(prefix)
    quantity = of_field(base)
    units = "1" if quantity is None else quantity.unit_in(facts.unit)
    title = facts.titles.get(base) or (base if quantity is None else quantity.title)
    return Variable(GRID, values, units, ERRORS[prefix].format(title=title) if prefix else title)


def gradient_measures(total: Total) -> GradientMeasures:
    """The measures of deformation gradients that define the strains of a total."""
    from dicflow.core.strain.measures import GradientMeasures

    return GradientMeasures(strain_function(total.measure), total.directions)


def field_means(fields: Mapping[str, np.ndarray], unit: str) -> dict[str, float]:
    """Mean of each basic quantity over the points with a value; a quantity without values is absent."""
    import numpy as np

    known = {name: fields[name][np.isfinite(fields[name])] for name in BASIC}
    return {f"mean_{named_with_unit(name, unit)}": float(part.mean()) for name, part in known.items() if part.size}


def named_with_unit(name: str, length: str) -> str:
    """A quantity's name, with the unit of a displacement at its end."""
    quantity = of_field(name)
    return f"{name}_{length}" if quantity is not None and quantity.is_displacement else name


def rigid_motion_to_json(motion: RigidMotion | None) -> dict[str, list[float]] | None:
    """The six numbers of a rigid-body motion and its centre."""
    if motion is None:
        return None
    return {
        "rotation_deg": motion.rotation_deg.tolist(),
        "translation": motion.translation.tolist(),
        "centre": motion.centre.tolist(),
    }


def frames_to_json(frames: tuple[Frame, Frame]) -> list[dict[str, list[Any]]]:
    """Frames of the step and of the first one in JSON values."""
    return [frame_to_json(frame) for frame in frames]
