"""Calibration targets: what marks they bear, and the corners of checkerboards in photographs.

A board's size is (columns, rows) of **inner** corners, where four squares meet.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dicflow.core.arrays import Array
from dicflow.core.calibration.symmetry import centres_of_symmetry
from dicflow.core.photographs.grey import to_8bit

__all__ = [
    "Size",
    "Target",
    "board_orders",
    "board_points",
    "board_size",
    "checkerboard",
    "find_board",
]

Size = tuple[int, int]

_LARGE_PIXELS = 1_000_000
_SMALLEST_BOARD = (3, 3)
_RADIUS_SQUARES = 0.6
_LEAST_RADIUS_PX = 3


class Target(NamedTuple):
    """A flat target, whatever its marks are: corners of squares or centres of circles.

    points : (m, 3) — marks in the target's frame, z = 0 [mm]
    orders : (o, m) — orders in which a detector may give them, as indices into the marks; the first is the given one,
        each other one that of the target turned in its plane
    """

    points: Array
    orders: NDArray[np.intp]


def checkerboard(size: Size, square_mm: float) -> Target:
    """A checkerboard of (columns, rows) inner corners."""
    return Target(board_points(size, square_mm), board_orders(size))


def board_points(size: Size, square_mm: float) -> Array:
    """Corners in the board's frame: x along its columns, y along its rows, z = 0.

    Returns (columns·rows, 3) [mm], row by row.
    """
    columns, rows = size
    y, x = np.mgrid[:rows, :columns].reshape(2, -1) * float(square_mm)
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def board_orders(size: Size) -> NDArray[np.intp]:
    """Orders in which the corners of one board can come back from a detector that cannot tell its sides apart.

    A board looks the same turned by 180° where columns + rows is even, a square one also turned by 90°; a detector
    that is misled by the light may turn the others as well, so all turns that keep the outline are listed.

    Returns (2 or 4, columns·rows) — indices into the corners; the first order is the given one.
    """
    columns, rows = size
    grid = np.arange(columns * rows).reshape(rows, columns)
    turns = range(4) if columns == rows else (0, 2)
    return np.stack([np.rot90(grid, turn).reshape(-1) for turn in turns])


def find_board(image: NDArray[np.uint8] | NDArray[np.uint16], size: Size) -> Array | None:
    """Corners of a checkerboard, to half a hundredth of a pixel.

    The board is located by sectors of its local Radon transform (Duda and Frese 2018), on the half-sized image where
    that suffices; each corner is then moved to the centre of symmetry there
    (:func:`~dicflow.core.calibration.symmetry.centres_of_symmetry`).

    Returns (columns·rows, 2) [px], row by row; None where the photograph shows no board of this size.
    """
    located = _locate(to_8bit(image), size)
    if located is None:
        return None
    grid = located.reshape(size[1], size[0], 2)
    spacing = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min()) for axis in (0, 1))
    return centres_of_symmetry(image, located, max(_LEAST_RADIUS_PX, round(_RADIUS_SQUARES * spacing)))


def board_size(image: NDArray[np.uint8] | NDArray[np.uint16]) -> Size | None:
    """Size (the longer side first) of whatever checkerboard a photograph shows, None where it shows none.

    Of a board that is cut off by the frame it is the size of the part that is seen.
    """
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    found, _, marks = cv2.findChessboardCornersSBWithMeta(to_8bit(image), _SMALLEST_BOARD, flags)
    return (max(marks.shape), min(marks.shape)) if found else None


def _locate(grey: NDArray[np.uint8], size: Size) -> Array | None:
    """Corners to about a pixel, from the half-sized image where that suffices."""
    if grey.size > _LARGE_PIXELS:
        half = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        corners = _detect(half, size, 0)
        if corners is not None:
            return 2.0 * corners + 0.5
    corners = _detect(grey, size, 0)
    return _detect(grey, size, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE) if corners is None else corners


def _detect(grey: NDArray[np.uint8], size: Size, flags: int) -> Array | None:
    found, corners = cv2.findChessboardCornersSB(grey, size, flags=flags)
    return corners.reshape(-1, 2).astype(float) if found else None
