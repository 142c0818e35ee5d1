"""Strain of one increment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, ClassVar, Literal

from dicflow.engine.node import Node, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError
from dicflow.stages.smooth import WindowSide, fitted_status

if TYPE_CHECKING:
    from dicflow.core.strain.surface_strain import Strain as Measures

__all__ = ["Strain"]


class Strain(Node):
    """How the specimen deformed since the step before.

    In the material definition: the deformation gradient between the tangent planes of the two surfaces, from local
    polynomials of the points in space over the material grid. In the thesis's: quotients of differences of
    displacement and of coordinates, the first smoothed by local polynomials, the second replaced by planes.
    """

    title: ClassVar = "strain of each step"
    scope: ClassVar = Scope.PAIR
    takes: ClassVar = {"increment": Port("increment")}
    gives: ClassVar = "strain_increment"

    stage: Literal["strain"] = "strain"
    window: tuple[WindowSide, WindowSide] = parameter((80.0, 20.0), "rows and columns of the window", unit="px")
    degree: int = parameter(2, "total degree of the polynomial", ge=1, le=4)

    def run(self, increment: Product) -> Product:
        import numpy as np

        from dicflow.core.surfaces.filters import odd_window

        window = odd_window(self.window, increment.attrs["step_size"])
        try:
            fields, measures = self._measure(increment, window)
        except ValueError as error:
            raise StageError(f"{error}; look at the tracking and the clouds of this step") from error
        moved = np.isfinite(increment["displacement"]).all(axis=2)
        fitted = np.asarray(np.isfinite(np.stack(measures)).all(axis=0))
        status = fitted_status(moved, fitted, increment["status"], window, self.degree)
        kept = ("xy", "xyz", "xyz_reference")
        variables = {
            **{name: increment.variables[name] for name in kept},
            **_components(increment),
            **fields,
            **strain_variables(measures, "in this step"),
            "status": Variable(("row", "col"), status, "1", "why a point has a value, or has none"),
        }
        attrs = {name: increment.attrs[name] for name in ("definition", "step_size", "unit")}
        return Product("strain_increment", variables, {**attrs, "window_points": list(window)})

    def _measure(self, increment: Product, window: tuple[int, int]) -> tuple[dict[str, Variable], Measures]:
        """The gradient, if the definition has one, and the strains."""
        from dicflow.core.strain.surface_strain import deformation_gradient, engineering_strain, jacobian, thesis_strain

        if increment.attrs["definition"] == "thesis":
            return {}, thesis_strain(increment["displacement"], increment["xyz_reference"], window, self.degree)
        before, after = (jacobian(increment[name], window, self.degree) for name in ("xyz_reference", "xyz"))
        gradient = deformation_gradient(before, after)
        dims = ("row", "col", "out", "in")
        return {"gradient": Variable(dims, gradient, "1", "deformation gradient of the step")}, engineering_strain(
            gradient
        )


def _components(increment: Product) -> dict[str, Variable]:
    """U, V and W of the increment."""
    values, unit = increment["displacement"], increment.attrs["unit"]
    return {
        name: Variable(("row", "col"), values[..., index], unit, f"displacement {name} in this step")
        for index, name in enumerate("UVW")
    }


def strain_variables(measures: Any, when: str) -> dict[str, Variable]:
    """The strains as arrays of a product."""
    names = {"exx": "strain along x", "eyy": "strain along y", "gxy": "shear strain"}
    return {
        key: Variable(("row", "col"), values, "1", f"{names[key]} {when}".strip())
        for key, values in zip(names, measures, strict=True)
    }
