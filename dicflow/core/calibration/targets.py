"""Calibration targets: their marks, and the corners of checkerboards in photographs.

A board's size is (columns, rows) of **inner** corners, where four squares meet.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Bytes, Grey, Index, Mask
from dicflow.core.calibration.symmetry import centres_of_symmetry
from dicflow.core.matching.transform import estimate_transform
from dicflow.core.photographs.grey import to_8bit

__all__ = [
    "SMALLEST_BOARD",
    "Size",
    "Target",
    "board_orders",
    "board_points",
    "board_size",
    "checkerboard_target",
    "detect_checkerboard",
    "determines_pose",
    "find_board",
]

Size = tuple[int, int]

_MIN_PIXELS_TO_HALVE = 1_000_000
SMALLEST_BOARD = (3, 3)
_MIN_MARKS = 6
_RADIUS_SQUARES = 0.6
_MIN_RADIUS_PX = 3


class Target(NamedTuple):
    """A flat target; its marks are corners of squares or centres of circles.

    points : (m, 3) — marks in the target's frame, z = 0 [mm]
    orders : (o, m) — orders in which a detector may return them, as indices into the marks; the first is the given
        order, the others are those of the target turned in its plane
    """

    points: Array
    orders: Index


def checkerboard_target(size: Size, square_mm: float) -> Target:
    """A checkerboard of (columns, rows) inner corners."""
    return Target(board_points(size, square_mm), board_orders(size))


def board_points(size: Size, square_mm: float) -> Array:
    """Corners in the board's frame: x along its columns, y along its rows, z = 0.

    Returns (columns·rows, 3) [mm], row by row.
    """
    columns, rows = size
    y, x = np.mgrid[:rows, :columns].reshape(2, -1) * float(square_mm)
    return np.stack([x, y, np.zeros_like(x)], axis=-1)


def board_orders(size: Size) -> Index:
    """Orders in which a detector may return the corners of a board, because it looks the same after a turn.

    A board looks the same after a turn by 180° where columns + rows is even, a square one also after 90°. Under uneven
    light a detector may turn other boards as well, so all turns that keep the outline are listed.

    Returns (2 or 4, columns·rows) — indices into the corners; the first order is the given one.
    """
    columns, rows = size
    grid = np.arange(columns * rows).reshape(rows, columns)
    turns = range(4) if columns == rows else (0, 2)
    return np.stack([np.rot90(grid, turn).reshape(-1) for turn in turns])


def determines_pose(points: Array, seen: Mask) -> bool:
    """Whether the marks that a photograph shows determine the pose of the target: six or more, not all but one in line.

    points : (m, 3) — marks in the target's frame; seen : (m,)
    """
    shown = points[seen, :2]
    return len(shown) >= _MIN_MARKS and bool(np.isfinite(estimate_transform("projective", shown, shown)).all())


def find_board(image: Grey, size: Size, thorough: bool = True) -> Array | None:
    """Corners of a checkerboard, accurate to about 0.005 px.

    The board is located by sectors of its local Radon transform (Duda and Frese 2018), on the half-sized image where
    that suffices; each corner is then moved to the centre of symmetry near it
    (:func:`~dicflow.core.calibration.symmetry.centres_of_symmetry`).

    thorough : search again with many thresholds where a board does not show at once, which takes ten times longer
    Returns (columns·rows, 2) [px], row by row; None where the photograph does not show a board of this size.
    """
    located = _locate_corners(to_8bit(image), size, thorough)
    if located is None:
        return None
    grid = located.reshape(size[1], size[0], 2)
    spacing = min(float(np.linalg.norm(np.diff(grid, axis=axis), axis=-1).min()) for axis in (0, 1))
    return centres_of_symmetry(image, located, max(_MIN_RADIUS_PX, round(_RADIUS_SQUARES * spacing)))


def board_size(image: Grey) -> Size | None:
    """Size (the longer side first) of the checkerboard in a photograph; None if it is not detected.

    Of a board that the photograph cuts off, the size of the visible part.
    """
    flags = cv2.CALIB_CB_LARGER | cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE
    grid = detect_checkerboard(to_8bit(image), SMALLEST_BOARD, flags)
    return None if grid is None else (max(grid.shape[:2]), min(grid.shape[:2]))


def detect_checkerboard(grey: Bytes, size: Size, flags: int) -> Array | None:
    """Corners (rows, cols, 2) by OpenCV's detector with some flags [px]; None if not detected.

    The detector draws random numbers: from a state of its own, a photograph always gives the same.
    """
    cv2.setRNGSeed(0)
    found, corners, marks = cv2.findChessboardCornersSBWithMeta(grey, size, flags)
    return corners.reshape(*marks.shape, 2).astype(float) if found else None


def _locate_corners(grey: Bytes, size: Size, thorough: bool) -> Array | None:
    """Corners accurate to about a pixel, from the half-sized image where that suffices."""
    if grey.size > _MIN_PIXELS_TO_HALVE:
        half = cv2.resize(grey, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        corners = detect_checkerboard(half, size, 0)
        if corners is not None:
            return 2.0 * corners.reshape(-1, 2) + 0.5
    corners = detect_checkerboard(grey, size, 0)
    if corners is None and thorough:
        corners = detect_checkerboard(grey, size, cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_NORMALIZE_IMAGE)
    return None if corners is None else corners.reshape(-1, 2)
