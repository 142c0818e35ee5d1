"""Displacement since the step before, and the strain of that step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from dicflow.engine.product import Product
from dicflow.kinds.kind import GRID, STATUS, Kind, Layout

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.strain.surface_strain import Strain
    from dicflow.core.surfaces.displacement import Increment as IncrementField

__all__ = ["Increment", "StrainIncrement"]

Definition = Literal["material", "thesis"]

_VECTOR = (*GRID, "component")
_GRADIENT = Layout((*GRID, "out", "in"), "1", "deformation gradient of the step")
_STRAIN_TITLES = {
    "exx": "strain along x in this step",
    "eyy": "strain along y in this step",
    "gxy": "shear strain in this step",
}


class _SinceStepBefore(Kind):
    """What both kinds share."""

    @property
    def definition(self) -> Definition:
        """material: vectors of material points; thesis: on the deformed pixel grid of each step."""
        found: Definition = self.product.attrs["definition"]
        return found

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


class Increment(_SinceStepBefore):
    """Displacement vectors (row, col, 3) since the step before."""

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
        variables = {
            "xy": Layout((*GRID, "image_component"), "px", "place in the image")(field.xy),
            "xyz_reference": Layout(_VECTOR, unit, "place at the step before")(field.xyz_reference),
            "xyz": Layout(_VECTOR, unit, "place")(field.xyz),
            "displacement": Layout(_VECTOR, unit, "displacement since the step before")(field.displacement),
            "status": STATUS(field.status),
        }
        attrs = {"definition": definition, "step_size": step_size, "unit": unit, "summary": dict(summary)}
        return Product("increment", variables, attrs)

    def changed(self, values: Mapping[str, np.ndarray], window: Sequence[int], summary: Mapping[str, float]) -> Product:
        """The product with other values of some arrays.

        window : rows and columns of the window over which they were smoothed [points]
        """
        variables = dict(self.product.variables)
        variables |= {name: variables[name]._replace(values=array) for name, array in values.items()}
        attrs: dict[str, Any] = {**self.product.attrs, "window_points": list(window), "summary": dict(summary)}
        return Product("increment", variables, attrs)


class StrainIncrement(_SinceStepBefore):
    """Displacement (row, col) and strain since the step before."""

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

        increment : the displacements that they are of
        gradient : (row, col, 2, 2) — of the deformation; None where the definition has none
        status : (row, col)
        window : rows and columns of the window of a strain [points]
        """
        unit, motion = increment.unit, increment["displacement"]
        variables = {
            **{name: increment.product.variables[name] for name in ("xy", "xyz", "xyz_reference")},
            **{
                name: Layout(GRID, unit, f"displacement {name} in this step")(motion[..., axis])
                for axis, name in enumerate("UVW")
            },
            **({} if gradient is None else {"gradient": _GRADIENT(gradient)}),
            **{name: Layout(GRID, "1", title)(getattr(strain, name)) for name, title in _STRAIN_TITLES.items()},
            "status": STATUS(status),
        }
        attrs = {name: increment.product.attrs[name] for name in ("definition", "step_size", "unit")}
        return Product("strain_increment", variables, {**attrs, "window_points": list(window)})
