"""A thin specimen between grips, with its fields and loads, as virtual work needs it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, NamedTuple

from dicflow.engine.product import Product, Variable
from dicflow.kinds.kind import Kind, Layout, steps_of

if TYPE_CHECKING:
    import numpy as np

__all__ = ["SheetFacts", "SheetFields"]

_LAYOUTS = {
    "places": Layout(("point", "component"), "mm", "place across and along, 0 at a side and at the resting end"),
    "slopes": Layout(("point", "out", "in"), "1", "derivatives of the places"),
    "areas": Layout(("point",), "mm²", "area at rest that a point stands for"),
    "gradients": Layout(("step", "point", "out", "in"), "1", "deformation gradient"),
    "forces": Layout(("step",), "N", "load"),
    "u_gradient": Layout(("step",), "1", "standard deviation of the gradients by noise"),
    "u_bias": Layout(("step",), "1", "standard deviation of the bias that remains in the gradients"),
    "lines": Layout(("line",), "mm", "places along the load between rows of points"),
}


class SheetFacts(NamedTuple):
    """Numbers of the whole sheet.

    width, length : of its field at rest, and of the unloaded section the thickness [mm]
    u_width, u_thickness : standard uncertainties [mm]
    shared : number of neighbouring points that have the same noise
    u_force : standard uncertainty of each load [N]
    rim : share of the width without points
    """

    width: float
    length: float
    thickness: float
    u_width: float
    u_thickness: float
    shared: float
    u_force: float
    rim: float


class SheetFields(Kind):
    """The points known at all loaded steps."""

    KINDS: ClassVar = ("sheet",)

    @classmethod
    def write(
        cls, values: Mapping[str, np.ndarray], steps: Sequence[str], facts: SheetFacts, warnings: Sequence[str]
    ) -> Product:
        """A product of fields and loads.

        values : places, slopes, areas, gradients, forces, u_gradient, u_bias, lines
        steps : names of the loaded steps
        """
        variables: dict[str, Variable] = {name: _LAYOUTS[name](array) for name, array in values.items()}
        summary = {
            "width_mm": facts.width,
            "u_width_mm": facts.u_width,
            "rim_pct": 100.0 * facts.rim,
            "points": len(values["areas"]),
        }
        attrs: dict[str, Any] = {"steps": list(steps), "sheet": facts._asdict(), "summary": summary}
        return Product("sheet", variables, {**attrs, "warnings": list(warnings)})

    @property
    def steps(self) -> Sequence[str]:
        """Names of the loaded steps."""
        return tuple(steps_of(self.product))

    @property
    def facts(self) -> SheetFacts:
        """Numbers of the whole sheet."""
        return SheetFacts(**self.product.attrs["sheet"])
