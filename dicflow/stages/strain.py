"""Strain of one increment."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from dicflow.engine.node import Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.increment import Increment, StrainIncrement
from dicflow.kinds.parts import parts_in
from dicflow.kinds.status import fitted_status
from dicflow.stages._parameters import WindowSide

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.strain.surface_strain import Strain as Measures

__all__ = ["Strain", "sentence"]


class Strain(Node):
    """How the specimen deformed since the previous step.

    In the material definition: the deformation gradient between the tangent planes of the two surfaces, from local
    polynomials of the points in space over the material grid, each within its part of the region. In the thesis's:
    quotients of differences of displacement and of coordinates, the first smoothed by local polynomials, the second
    replaced by planes.
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

        motion = Increment.read(increment)
        window = odd_window(self.window, motion.step_size)
        try:
            gradient, strain = self._measure(motion, window)
        except ValueError as error:
            raise StageError(f"{error}; look at the tracking and the clouds of this step") from error
        moved = np.isfinite(motion["displacement"]).all(axis=2)
        fitted = np.asarray(np.isfinite(np.stack(strain)).all(axis=0))
        status = fitted_status(moved, fitted, motion["status"], window, self.degree)
        return StrainIncrement.write(motion, strain, gradient, status, window)

    def _measure(self, motion: Increment, window: tuple[int, int]) -> tuple[np.ndarray | None, Measures]:
        """The deformation gradient, if the definition has one, and the strains."""
        import numpy as np

        from dicflow.core.strain.parts_gradient import jacobian_of_parts
        from dicflow.core.strain.surface_strain import Strain as Measures
        from dicflow.core.strain.surface_strain import deformation_gradient, engineering_strain, thesis_strain

        if not motion.follows_material and not motion.has_values:
            return None, Measures(*np.full((3, *motion["status"].shape), np.nan))
        if not motion.follows_material:
            return None, thesis_strain(motion["displacement"], motion["xyz_reference"], window, self.degree)
        parts = parts_in(motion.product)
        places = (motion[name] for name in ("xyz_reference", "xyz"))
        gradient = deformation_gradient(*(jacobian_of_parts(parts, place, window, self.degree) for place in places))
        return gradient, engineering_strain(gradient)


def sentence(stage: Strain, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    rows, columns = stage.window
    return (
        f"The strain of each step was computed from local polynomials of degree {stage.degree} in windows of "
        f"{rows:g} × {columns:g} px [savitzky1964]."
    )
