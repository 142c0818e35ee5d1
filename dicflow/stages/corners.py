"""Corners of the checkerboard in one pair of calibration photographs."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from dicflow.engine.node import Node, Port, Scope, parameter
from dicflow.engine.product import Product, Variable
from dicflow.errors import StageError

if TYPE_CHECKING:
    import numpy as np

__all__ = ["Corners"]

Count = Annotated[int, Field(ge=3, le=100)]


class Corners(Node):
    """Find the board in the photographs of both cameras, to a few hundredths of a pixel.

    A photograph that shows no board of this size has no corners and is no error; ``seen`` then tells the size of the
    board that it shows instead, if any.
    """

    title: ClassVar = "find board corners"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"images": Port("images")}
    gives: ClassVar = "corners"

    stage: Literal["corners"] = "corners"
    size: tuple[Count, Count] = parameter(
        ..., "inner corners of the board, where four squares meet: [columns, rows]", unit="corners"
    )

    def run(self, images: Product) -> Product:
        sides = [side for side in ("left", "right") if side in images]
        sizes = {side: list(images[side].shape[::-1]) for side in sides}
        if len(set(map(tuple, sizes.values()))) > 1:
            raise StageError(
                "the photographs of a board must have one size, but the left one has {} × {} px and the right one "
                "{} × {}; use the cameras as they were set for the specimen".format(*sizes["left"], *sizes["right"])
            )
        found = {side: self._find(images[side]) for side in sides}
        return Product(
            "corners",
            {side: Variable(("corner", "component"), xy, "px", f"{side} corners") for side, (xy, _) in found.items()},
            {
                "size": list(self.size),
                "image_size": sizes["left"],
                "found": {side: len(xy) > 0 for side, (xy, _) in found.items()},
                "seen": {side: seen for side, (_, seen) in found.items()},
            },
        )

    def _find(self, image: np.ndarray) -> tuple[np.ndarray, list[int] | None]:
        """Corners (n or 0, 2) and the size of the board that is seen."""
        import numpy as np

        from dicflow.core.targets import board_size, find_board

        corners = find_board(image, self.size)
        if corners is not None:
            return corners, list(self.size)
        seen: Any = board_size(image)
        return np.empty((0, 2)), None if seen is None else list(seen)
