"""The disparity map of one step."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import GRID, Kind, Layout, laid_out

if TYPE_CHECKING:
    import numpy as np

__all__ = ["DisparityMap"]

_LAYOUTS = {"disparity": Layout(GRID, "px", "disparity"), "status": Layout(GRID, "1", "status")}


class DisparityMap(Kind):
    """x_left − x_right of the pixels in a part of the rectified left image."""

    KINDS: ClassVar = ("disparity",)

    @classmethod
    def write(
        cls,
        disparity: np.ndarray,
        status: np.ndarray,
        origin: tuple[int, int],
        limits: tuple[int, int],
        summary: Mapping[str, float],
        warnings: Sequence[str] = (),
    ) -> Product:
        """A product of disparities.

        disparity : (row, col) — NaN where unknown [px]; status : (row, col)
        origin : (x, y) of element [0, 0] in the rectified left image [px]
        limits : range [low, high) that was searched [px]
        warnings : sentences for the user
        """
        values = {"disparity": disparity, "status": status}
        attrs = {"origin": list(origin), "range": list(limits), "summary": dict(summary)}
        said = {"warnings": list(warnings)} if warnings else {}
        return Product("disparity", laid_out(_LAYOUTS, values), {**attrs, **said})

    @property
    def origin(self) -> tuple[int, int]:
        """(x, y) of element [0, 0] in the rectified left image [px]."""
        x, y = self.product.attrs["origin"]
        return x, y

    @property
    def limits(self) -> tuple[int, int]:
        """Range [low, high) that was searched [px]."""
        low, high = self.product.attrs["range"]
        return low, high
