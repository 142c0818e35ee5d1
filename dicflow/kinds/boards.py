"""Marks of the calibration target in one pair of photographs."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import Kind, Layout, laid_out

if TYPE_CHECKING:
    import numpy as np

__all__ = ["BoardMarks"]

Size = tuple[int, int]

_LAYOUTS = {side: Layout(("corner", "component"), "px", f"{side} corners") for side in ("left", "right")}


class BoardMarks(Kind):
    """Corners of a board's squares, or centres of its circles, in the photographs of one or two cameras."""

    KINDS: ClassVar = ("corners",)

    @classmethod
    def write(
        cls,
        marks: Mapping[str, np.ndarray],
        seen: Mapping[str, Size | None],
        target: str,
        size: Size,
        image_size: Size,
    ) -> Product:
        """A product of marks.

        marks : left and right → (n, 2) — empty where the board is not seen, NaN for a hidden corner [px]
        seen : left and right → columns and rows of the board that the photograph shows; None without a board
        target : what the board shows: checkerboard, charuco, circles, asymmetric_circles
        size : columns and rows of the expected marks
        image_size : width and height of the photographs [px]
        """
        attrs = {
            "target": target,
            "size": list(size),
            "image_size": list(image_size),
            "found": {side: len(xy) > 0 for side, xy in marks.items()},
            "seen": {side: None if other is None else list(other) for side, other in seen.items()},
        }
        return Product("corners", laid_out(_LAYOUTS, marks), attrs)

    def is_found(self, side: str) -> bool:
        """Whether one camera saw the board."""
        return bool(self.product.attrs["found"][side])

    @property
    def is_found_by_both(self) -> bool:
        """Whether all cameras saw the board."""
        return all(self.product.attrs["found"].values())

    @property
    def others(self) -> Mapping[str, Size]:
        """left and right → columns and rows of a board of another size in the photograph."""
        return {
            side: (other[0], other[1])
            for side, other in self.product.attrs["seen"].items()
            if other is not None and not self.is_found(side)
        }

    @property
    def target(self) -> str:
        """What the board shows: checkerboard, charuco, circles, asymmetric_circles."""
        return str(self.product.attrs["target"])

    @property
    def size(self) -> Size:
        """Columns and rows of the marks."""
        columns, rows = self.product.attrs["size"]
        return columns, rows

    @property
    def image_size(self) -> Size:
        """Width and height of the photographs [px]."""
        width, height = self.product.attrs["image_size"]
        return width, height
