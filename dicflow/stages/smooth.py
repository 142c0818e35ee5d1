"""Smooth the displacement of one increment."""

from __future__ import annotations

from typing import ClassVar, Literal

from dicflow.engine.node import Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.kinds.increment import Increment
from dicflow.kinds.parts import parts_in
from dicflow.kinds.status import fitted_status
from dicflow.stages._parameters import WindowSide

__all__ = ["Smooth", "sentence"]


class Smooth(Node):
    """Replace the displacement at each point by a polynomial fitted to the window around it (Savitzky–Golay in 2D).

    Points without a value keep none. No window reaches from one part of the region into another. In the material
    definition ``xyz`` is the place at the previous step plus the smoothed displacement.
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

        from dicflow.core.surfaces.filters import odd_window
        from dicflow.core.surfaces.part_windows import smooth_parts

        before = Increment.read(increment)
        raw = before["displacement"]
        window = odd_window(self.window, before.step_size)
        smooth = smooth_parts(parts_in(increment), raw, window, self.degree)
        measured = np.isfinite(raw).all(axis=2)
        smooth[~measured] = np.nan
        fitted = np.asarray(np.isfinite(smooth).all(axis=2))
        status = fitted_status(measured, fitted, before["status"], window, self.degree)
        values = {"displacement": smooth, "status": status}
        if before.follows_material:
            values["xyz"] = before["xyz_reference"] + smooth
        change = float(np.sqrt(np.nanmean((smooth - raw) ** 2))) if measured.any() else 0.0
        return before.changed(values, window, {f"change_rms_{before.unit}": change})


def sentence(stage: Smooth, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    rows, columns = stage.window
    return (
        f"They were smoothed by local polynomials of degree {stage.degree} in windows of {rows:g} × {columns:g} px "
        "[savitzky1964]."
    )
