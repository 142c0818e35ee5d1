"""Smooth the displacement of one increment."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from dicflow.engine.node import Node, Pixels, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

if TYPE_CHECKING:
    import numpy as np

__all__ = ["Smooth", "WindowSide", "fitted_status"]

WindowSide = Annotated[Pixels, Field(gt=0)]
"""One side of a window."""


class Smooth(Node):
    """Replace the displacement at each point by a polynomial fitted to the window around it (Savitzky–Golay in 2D).

    Points without a value stay without. In the material definition ``xyz`` moves with the displacement, so that it is
    always the place at the step before plus the displacement.
    """

    title: ClassVar = "smooth the displacement"
    scope: ClassVar = Scope.PAIR
    takes: ClassVar = {"increment": Port("increment")}
    gives: ClassVar = "increment"

    stage: Literal["smooth"] = "smooth"
    window: tuple[WindowSide, WindowSide] = parameter((80.0, 20.0), "rows and columns of the window", unit="px")
    degree: int = parameter(2, "total degree of the polynomial", ge=0, le=4)

    def run(self, increment: Product) -> Product:
        import numpy as np

        from dicflow.core.surfaces.filters import local_polynomial, odd_window

        raw, unit = increment["displacement"], increment.attrs["unit"]
        window = odd_window(self.window, increment.attrs["step_size"])
        smooth = local_polynomial(raw, window, self.degree).value
        measured = np.isfinite(raw).all(axis=2)
        smooth[~measured] = np.nan
        fitted = np.asarray(np.isfinite(smooth).all(axis=2))
        status = fitted_status(measured, fitted, increment["status"], window, self.degree)
        changed = {"displacement": smooth, "status": status}
        if increment.attrs["definition"] == "material":
            changed["xyz"] = increment["xyz_reference"] + smooth
        variables = {
            name: Variable(old.dims, changed.get(name, old.values), old.units, old.long_name)
            for name, old in increment.variables.items()
        }
        change = float(np.sqrt(np.nanmean((smooth - raw) ** 2))) if measured.any() else 0.0
        summary = {f"change_rms_{unit}": change}
        return Product("increment", variables, {**increment.attrs, "window_points": list(window), "summary": summary})


def fitted_status(
    measured: np.ndarray, fitted: np.ndarray, status: np.ndarray, window: tuple[int, int], degree: int
) -> np.ndarray:
    """Status of the points after a fit of local polynomials.

    measured, fitted : (row, col) bool — which points there were to fit, and where the window held enough of them
    status : (row, col) — before
    Raises StageError where no point that was measured could be fitted.
    """
    import numpy as np

    from dicflow.core.status import Status

    if measured.any() and not (measured & fitted).any():
        raise StageError(
            f"a window of {window[0]} × {window[1]} points never holds enough for degree {degree}; "
            "widen the window or lower the degree"
        )
    return np.where(measured & ~fitted, np.uint8(Status.TOO_FEW_NEIGHBOURS), status)
