"""Calibration targets: checkerboards and their corners in photographs.

A board's size is (columns, rows) of **inner** corners, where four squares meet.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from dicflow.core.grey import to_8bit

__all__ = ["board_orders", "board_points", "board_size", "find_board"]

Array = NDArray[np.float64]
Size = tuple[int, int]

_LARGE_PIXELS = 1_000_000
_MARGIN_SQUARES = 2.0
_SMALLEST_BOARD = (3, 3)


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
    """Sub-pixel corners of a checkerboard by sectors of its local Radon transform (Duda and Frese 2018).

    The board is located on a coarse image first and then measured in the part of the photograph that holds it, at
    twice the resolution, so that the cost follows the board.

    Returns (columns·rows, 2) [px], row by row; None where the photograph shows no board of this size.
    """
    grey = to_8bit(image)
    coarse = _locate(grey, size)
    if coarse is None:
        return None
    part, corner = _part_around(grey, coarse, size)
    corners = _detect(part, size, cv2.CALIB_CB_ACCURACY)
    return coarse if corners is None else corners + corner


def board_size(image: NDArray[np.uint8] | NDArray[np.uint16]) -> Size | None:
    """Size (the longer side first) of whatever checkerboard a photograph shows, None where it shows none.

    Of a board that is cut off by the frame it is the size of the part that is seen.
    """
    found, _, marks = cv2.findChessboardCornersSBWithMeta(to_8bit(image), _SMALLEST_BOARD, cv2.CALIB_CB_LARGER)
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


def _part_around(grey: NDArray[np.uint8], corners: Array, size: Size) -> tuple[NDArray[np.uint8], Array]:
    """The part of the image that holds the board and its rim, and the pixel (x, y) where it starts."""
    grid = corners.reshape(size[1], size[0], 2)
    margin = _MARGIN_SQUARES * np.median(np.linalg.norm(np.diff(grid, axis=1), axis=-1))
    low = np.maximum(np.floor(corners.min(axis=0) - margin), 0).astype(int)
    high = np.ceil(corners.max(axis=0) + margin).astype(int) + 1
    return np.ascontiguousarray(grey[low[1] : high[1], low[0] : high[0]]), low.astype(float)
