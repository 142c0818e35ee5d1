"""Marks of the calibration target in one pair of photographs: corners of its squares, or centres of its circles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, model_validator

from dicflow.engine.node import Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.images import Images

if TYPE_CHECKING:
    import numpy as np

__all__ = ["Corners"]

Count = Annotated[int, Field(ge=3, le=100)]
Dictionary = Literal[
    "4x4_50", "4x4_100", "4x4_250", "4x4_1000", "5x5_50", "5x5_100", "5x5_250", "5x5_1000",
    "6x6_50", "6x6_100", "6x6_250", "6x6_1000", "7x7_50", "7x7_100", "7x7_250", "7x7_1000",
    "aruco_original", "apriltag_16h5", "apriltag_25h9", "apriltag_36h10", "apriltag_36h11",
]  # fmt: skip
OTHER_MARKERS = {
    "aruco_original": 1024,
    "apriltag_16h5": 30,
    "apriltag_25h9": 35,
    "apriltag_36h10": 2320,
    "apriltag_36h11": 587,
}
"""Number of markers in each dictionary whose name does not state it."""


class Corners(Node):
    """Find the target in the photographs of both cameras, to a few hundredths of a pixel.

    A photograph without a target of this size has no corners, which is not an error; ``seen`` is then the size of
    another checkerboard in it, if any. Of a ChArUco board any part may be seen; the other corners are NaN.
    """

    title: ClassVar = "find board corners"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"images": Port("images")}
    gives: ClassVar = "corners"
    impl_version: ClassVar = 2

    stage: Literal["corners"] = "corners"
    size: tuple[Count, Count] = parameter(
        ...,
        "inner corners of the board, where four squares meet, or circles of the grid: [columns, rows]; of an "
        "asymmetric grid the circles of one row, and the rows",
        unit="corners",
    )
    target: Literal["checkerboard", "charuco", "circles", "asymmetric_circles"] = parameter(
        "checkerboard", "what the target shows; in an asymmetric grid every other row of circles is shifted"
    )
    dictionary: Dictionary | None = parameter(None, "dictionary of the markers; for a ChArUco board only")
    marker: float | None = parameter(
        None, "side of a ChArUco board's marker as a share of that of a square", gt=0.0, lt=1.0
    )

    @model_validator(mode="after")
    def _markers_of_charuco(self) -> Self:
        given = [name for name in ("dictionary", "marker") if getattr(self, name) is not None]
        if self.target != "charuco" and given:
            raise ValueError(f"{given[0]} belongs to ChArUco boards only; remove it or set target to charuco")
        if self.target == "charuco" and len(given) < 2:
            raise ValueError("target charuco needs the dictionary of its markers and marker, a marker's side over a "
                             "square's")  # fmt: skip
        if self.dictionary is not None and _markers_needed(self.size) > _markers_in(self.dictionary):
            raise ValueError(
                "a board of {} × {} inner corners has {} markers, more than the {} of dictionary {}; name the "
                "dictionary of the printed board".format(
                    *self.size, _markers_needed(self.size), _markers_in(self.dictionary), self.dictionary
                )
            )
        return self

    def run(self, images: Product) -> Product:
        photographs = Images.read(images)
        sizes = {side: image.shape[::-1] for side, image in photographs.sides}
        if len(set(sizes.values())) > 1:
            raise StageError(
                "the photographs of a board must have one size, but the left one has {} × {} px and the right one "
                "{} × {}; use the cameras as they were set for the specimen".format(*sizes["left"], *sizes["right"])
            )
        boards = {side: self._find(image) for side, image in photographs.sides}
        return BoardMarks.write(
            {side: marks for side, (marks, _) in boards.items()},
            {side: seen for side, (_, seen) in boards.items()},
            self.target,
            self.size,
            photographs.size,
        )

    def _find(self, image: np.ndarray) -> tuple[np.ndarray, tuple[int, int] | None]:
        """Corners (n or 0, 2) and the size of the board in the photograph."""
        import numpy as np

        from dicflow.core.calibration.targets import board_size

        corners = self._marks(image)
        if corners is not None:
            return corners, self.size
        return np.empty((0, 2)), board_size(image) if self.target == "checkerboard" else None

    def _marks(self, image: Any) -> np.ndarray | None:
        from dicflow.core.calibration.charuco import Markers, find_charuco
        from dicflow.core.calibration.circles import find_circles
        from dicflow.core.calibration.targets import find_board

        if self.target == "checkerboard":
            return find_board(image, self.size)
        if self.target == "charuco":
            assert self.dictionary is not None
            assert self.marker is not None
            return find_charuco(image, self.size, Markers(self.dictionary, self.marker))
        return find_circles(image, self.size, asymmetric=self.target == "asymmetric_circles")


def _markers_needed(size: tuple[int, int]) -> int:
    """Markers on a board, one in each white square."""
    return (size[0] + 1) * (size[1] + 1) // 2


def _markers_in(dictionary: str) -> int:
    return OTHER_MARKERS[dictionary] if dictionary in OTHER_MARKERS else int(dictionary.split("_")[1])
