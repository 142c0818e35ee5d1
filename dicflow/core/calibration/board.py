"""What a calibration board shows, as the stage that looks for it describes it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from typing import Literal, NamedTuple

__all__ = ["MARKER_COUNTS", "Board", "BoardTarget", "common_board"]

BoardTarget = Literal["checkerboard", "charuco", "circles", "asymmetric_circles"]

MARKER_COUNTS: dict[str, int] = {
    **{f"{bits}x{bits}_{count}": count for bits in (4, 5, 6, 7) for count in (50, 100, 250, 1000)},
    "aruco_original": 1024,
    "apriltag_16h5": 30,
    "apriltag_25h9": 35,
    "apriltag_36h10": 2320,
    "apriltag_36h11": 587,
}
"""Dictionaries that a ChArUco board can be printed with, and the number of markers in each."""

_MARKER_ACCURACY = 0.05
"""Difference of the marker's side from the one that is given, up to which both are the same [-]."""

_TITLES: dict[str, str] = {
    "checkerboard": "a checkerboard of {} × {} inner corners",
    "charuco": "a ChArUco board of {} × {} inner corners",
    "circles": "a grid of {} × {} circles",
    "asymmetric_circles": "an asymmetric grid of {} × {} circles",
}


class Board(NamedTuple):
    """A calibration board.

    target : what it shows
    size : (columns, rows) of inner corners or circles; of an asymmetric grid the circles of one row, and the rows
    dictionary : of the markers of a ChArUco board, else None
    marker : side of these markers as a share of that of a square [-], else None
    """

    target: BoardTarget
    size: tuple[int, int]
    dictionary: str | None = None
    marker: float | None = None

    @property
    def text(self) -> str:
        """The board in words."""
        markers = "" if self.dictionary is None else f", dictionary {self.dictionary}, marker {self.marker:g}"
        return _TITLES[self.target].format(*self.size) + markers

    def settings(self, given: Board) -> str:
        """The parameters of this board that differ from those given, as a pipeline file has them."""
        values = {"target": self.target, "size": list(self.size), "dictionary": self.dictionary, "marker": self.marker}
        differ = [name for name, old in given._asdict().items() if getattr(self, name) not in (old, None)]
        if self.marker and given.marker and abs(self.marker - given.marker) < _MARKER_ACCURACY:
            differ = [name for name in differ if name != "marker"]
        return ", ".join(f"{name}: {values[name]}" for name in differ)


def common_board(boards: Sequence[Board]) -> tuple[Board, int]:
    """The board that most photographs show, and their number.

    boards : one per photograph, at least one; photographs of a ChArUco board that cut it off say less about its size
    """
    target = Counter(board.target for board in boards).most_common(1)[0][0]
    alike = [board for board in boards if board.target == target]
    if target != "charuco":
        return Counter(alike).most_common(1)[0]
    columns = Counter(board.size[0] for board in alike).most_common(1)[0][0]
    largest = max((board for board in alike if board.size[0] == columns), key=lambda board: board.size)
    shares = sorted(board.marker or 0.0 for board in alike)
    return largest._replace(marker=shares[len(shares) // 2]), len(alike)
