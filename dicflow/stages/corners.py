"""Marks of the calibration target in one pair of photographs: corners of its squares, or centres of its circles."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal, Self

from pydantic import Field, model_validator

from dicflow.core.calibration.board import MARKER_COUNTS, Board
from dicflow.engine.node import Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.kinds.boards import BoardMarks
from dicflow.kinds.images import Images

if TYPE_CHECKING:
    import numpy as np

__all__ = ["Corners", "sentence"]

Count = Annotated[int, Field(ge=3, le=100)]
Dictionary = Literal[
    "4x4_50", "4x4_100", "4x4_250", "4x4_1000", "5x5_50", "5x5_100", "5x5_250", "5x5_1000",
    "6x6_50", "6x6_100", "6x6_250", "6x6_1000", "7x7_50", "7x7_100", "7x7_250", "7x7_1000",
    "aruco_original", "apriltag_16h5", "apriltag_25h9", "apriltag_36h10", "apriltag_36h11",
]  # fmt: skip


class Corners(Node):
    """Find the target in the photographs of both cameras, to a few hundredths of a pixel.

    A photograph without this target has no corners, which is not an error; ``shown`` is then the board that it does
    show, if any. Of a ChArUco board any part may be seen, and its first square may be black or white; the corners that
    are not seen are NaN.
    """

    title: ClassVar = "find board corners"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"images": Port("images")}
    gives: ClassVar = "corners"
    impl_version: ClassVar = 3
    is_quick: ClassVar = True

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
        if self.dictionary is not None and _markers_needed(self.size) > MARKER_COUNTS[self.dictionary]:
            raise ValueError(
                "a board of {} × {} inner corners has {} markers, more than the {} of dictionary {}; name the "
                "dictionary of the printed board".format(
                    *self.size, _markers_needed(self.size), MARKER_COUNTS[self.dictionary], self.dictionary
                )
            )
        return self

    def run(self, images: Product) -> Product:
        from dicflow.core.calibration.find import find_marks

        photographs = dict(Images.read(images).sides)
        board = Board(self.target, self.size, self.dictionary, self.marker)
        found = {side: find_marks(image, board) for side, image in photographs.items()}
        return BoardMarks.write(
            {side: _or_none(one.marks) for side, one in found.items()},
            {side: one.shown for side, one in found.items()},
            board,
            {side: (image.shape[1], image.shape[0]) for side, image in photographs.items()},
            {side: one.reason for side, one in found.items()},
        )


def _or_none(marks: np.ndarray | None) -> np.ndarray:
    """The marks, or none of them (0, 2)."""
    import numpy as np

    return np.empty((0, 2)) if marks is None else marks


def _markers_needed(size: tuple[int, int]) -> int:
    """Markers on a board, one in each white square."""
    return (size[0] + 1) * (size[1] + 1) // 2


def sentence(stage: Corners, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    columns, rows = stage.size
    if "circles" in stage.target:
        form = "an asymmetric grid" if stage.target == "asymmetric_circles" else "a grid"
        return f"The centres of {form} of {columns} × {rows} circles were located in photographs by both cameras."
    named = "ChArUco board [garrido2014]" if stage.target == "charuco" else "checkerboard [duda2018]"
    return (
        f"The {columns} × {rows} inner corners of a {named} were located with sub-pixel accuracy in photographs by "
        "both cameras."
    )
