"""Displacement since the previous step, and the strain of that step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, ClassVar, Literal, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.kinds.kind import GRID, STATUS, Kind, Layout, laid_out
from dicflow.kinds.region import polygons_from_json, polygons_to_json
from dicflow.kinds.track import TrackedPoints

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.strain.surface_strain import Strain
    from dicflow.core.surfaces.displacement import Cloud
    from dicflow.core.surfaces.displacement import Increment as IncrementField

__all__ = ["Increment", "Since", "StrainIncrement", "lost_increment", "since_of"]

Definition = Literal["material", "thesis"]

_VECTOR = (*GRID, "component")
_LAYOUTS = {
    "xy": Layout((*GRID, "image_component"), "px", "place in the image"),
    "xyz_reference": Layout(_VECTOR, "{unit}", "place at the previous step"),
    "xyz": Layout(_VECTOR, "{unit}", "place"),
    "displacement": Layout(_VECTOR, "{unit}", "displacement since the previous step"),
    "U": Layout(GRID, "{unit}", "displacement U in this step"),
    "V": Layout(GRID, "{unit}", "displacement V in this step"),
    "W": Layout(GRID, "{unit}", "displacement W in this step"),
    "gradient": Layout((*GRID, "out", "in"), "1", "deformation gradient of the step"),
    "exx": Layout(GRID, "1", "strain along x in this step"),
    "eyy": Layout(GRID, "1", "strain along y in this step"),
    "gxy": Layout(GRID, "1", "shear strain in this step"),
    "status": STATUS,
}


_SINCE = {
    "since_points": Layout((*GRID, "image_component"), "px", "material points at the last step with displacements"),
    "since_status": Layout(GRID, "1", "status there"),
    "since_xyz": Layout(("cloud_row", "cloud_col", "component"), "mm", "positions of that step"),
    "since_xyz_status": Layout(("cloud_row", "cloud_col"), "1", "status of these"),
    "since_transforms": Layout(("subset_row", "subset_col", "i", "j"), "1", "transforms from that step to this one"),
}


class Since(NamedTuple):
    """The state from which a displacement is measured.

    points : of the track; cloud : of the step, None with one camera
    transforms : (subset_row, subset_col, 3, 3) — from there to the previous step; None if that is the state's own
    """

    points: TrackedPoints
    cloud: Cloud | None
    transforms: np.ndarray | None


def _laid_out(values: Mapping[str, np.ndarray], unit: str) -> dict[str, Variable]:
    """Arrays by name, each with its layout; ``unit`` is that of lengths."""
    layouts = {name: layout._replace(units=layout.units.format(unit=unit)) for name, layout in _LAYOUTS.items()}
    return laid_out(layouts, values)


class _SincePreviousStep(Kind):
    """Properties of displacements and of strains since the previous step."""

    @property
    def definition(self) -> Definition:
        """material: vectors of material points; thesis: on the deformed pixel grid of each step."""
        definition: Definition = self.product.attrs["definition"]
        return definition

    @property
    def has_values(self) -> bool:
        """Whether any point has a displacement."""
        import numpy as np

        field = self["displacement"] if "displacement" in self else self["U"]
        return bool(np.isfinite(field).any())

    @property
    def follows_material(self) -> bool:
        """Whether a point is the same material at every step."""
        return self.definition == "material"

    @property
    def unit(self) -> str:
        """Unit of displacements and places: mm, or px with one camera."""
        return str(self.product.attrs["unit"])

    @property
    def step_size(self) -> float:
        """Distance of neighbouring points [px]."""
        return float(self.product.attrs["step_size"])


class Increment(_SincePreviousStep):
    """Displacement vectors (row, col, 3) since the previous step."""

    KINDS: ClassVar = ("increment",)

    @classmethod
    def write(
        cls,
        field: IncrementField,
        definition: Definition,
        step_size: float,
        unit: str,
        summary: Mapping[str, float],
    ) -> Product:
        """A product of displacements.

        step_size : distance of neighbouring points [px]
        unit : mm, or px with one camera
        """
        attrs = {"definition": definition, "step_size": step_size, "unit": unit, "summary": dict(summary)}
        return Product("increment", _laid_out(field._asdict(), unit), attrs)

    def changed(self, values: Mapping[str, np.ndarray], window: Sequence[int], summary: Mapping[str, float]) -> Product:
        """The product with other values of some arrays.

        window : rows and columns of the window over which they were smoothed [points]
        """
        variables = {name: part for name, part in self.product.variables.items() if name not in _SINCE}
        variables |= {name: variables[name]._replace(values=array) for name, array in values.items()}
        attrs: dict[str, Any] = {**self.product.attrs, "window_points": list(window), "summary": dict(summary)}
        return Product("increment", variables, attrs)


class StrainIncrement(_SincePreviousStep):
    """Displacement (row, col) and strain since the previous step."""

    KINDS: ClassVar = ("strain_increment",)

    @classmethod
    def write(
        cls,
        increment: Increment,
        strain: Strain,
        gradient: np.ndarray | None,
        status: np.ndarray,
        window: Sequence[int],
    ) -> Product:
        """A product of strains.

        increment : the displacements from which the strains come
        strain : of the step, arrays (row, col)
        gradient : (row, col, 2, 2) — of the deformation; None in the thesis's definition
        status : (row, col)
        window : rows and columns of the window of a strain [points]
        """
        values = {name: increment[name] for name in ("xy", "xyz", "xyz_reference")}
        values |= {name: increment["displacement"][..., axis] for axis, name in enumerate("UVW")}
        values |= {} if gradient is None else {"gradient": gradient}
        values |= {**strain._asdict(), "status": status}
        attrs = {
            "definition": increment.definition,
            "step_size": increment.step_size,
            "unit": increment.unit,
            "window_points": list(window),
        }
        return Product("strain_increment", _laid_out(values, increment.unit), attrs)


def lost_increment(increment: Product, since: Since) -> Product:
    """The increment of a step without displacements, with the state from which the next is measured."""
    values = {"since_points": since.points.points, "since_status": since.points.status}
    attrs: dict[str, Any] = {"since_polygons": polygons_to_json(since.points.polygons)}
    if since.cloud is not None:
        values |= {"since_xyz": since.cloud.xyz, "since_xyz_status": since.cloud.status}
        attrs["since_origin"] = list(since.cloud.origin)
    if since.transforms is not None:
        values["since_transforms"] = since.transforms
    variables = {**increment.variables, **laid_out(_SINCE, values)}
    return replace(increment, variables=variables, attrs={**increment.attrs, **attrs})


def since_of(increment: Product) -> Since | None:
    """The state from which the next displacement is measured, if this step has none; else None."""
    from dicflow.core.surfaces.displacement import Cloud

    if "since_points" not in increment:
        return None
    attrs, cloud = increment.attrs, None
    if "since_xyz" in increment:
        x, y = attrs["since_origin"]
        cloud = Cloud(increment["since_xyz"], increment["since_xyz_status"], (x, y))
    points = TrackedPoints(
        increment["since_points"], increment["since_status"], polygons_from_json(attrs["since_polygons"])
    )
    return Since(points, cloud, increment["since_transforms"] if "since_transforms" in increment else None)  # noqa: SIM401
