"""The marks of a calibration board in one photograph, or which other board it shows."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Grey
from dicflow.core.calibration.board import Board
from dicflow.core.calibration.charuco import Markers, find_charuco
from dicflow.core.calibration.circles import find_circles
from dicflow.core.calibration.identify import identify_board
from dicflow.core.calibration.targets import Size, board_points, determines_pose, find_board
from dicflow.core.photographs.grey import to_8bit

__all__ = ["Found", "find_marks"]


_SAMPLES = 8
"""Samples along each side of a square, in its middle part."""
_INK_SHARE = 0.15
"""Least standard deviation within squares that hold markers, over the range of grey levels."""


class Found(NamedTuple):
    """What was found in a photograph.

    marks : (n, 2) [px], NaN for hidden ones; None where the expected board is not found
    shown : the board that the photograph shows; None if it shows no board that is recognised
    reason : why there are no marks; "" if there are
    """

    marks: Array | None
    shown: Board | None
    reason: str = ""


def find_marks(image: Grey, board: Board) -> Found:
    """The marks of the expected board; where they are not found, the board that the photograph does show."""
    if board.target == "checkerboard":
        return _find_checkerboard(image, board)
    if board.target == "charuco":
        return _find_charuco(image, board)
    marks = find_circles(image, board.size, asymmetric=board.target == "asymmetric_circles")
    return Found(marks, board) if marks is not None else _another(identify_board(image))


def _find_charuco(image: Grey, board: Board) -> Found:
    """The corners of the part of a ChArUco board that is seen, if these suffice for its pose."""
    corners = find_charuco(image, board.size, Markers(board.dictionary or "", board.marker or 0.0))
    seen = np.isfinite(corners[:, 0])
    if determines_pose(board_points(board.size, 1.0), seen):
        return Found(corners, board)
    other = identify_board(image)
    alike = other is None or other.target != "charuco" or other._replace(marker=board.marker) == board
    if seen.any() and alike:
        return Found(None, board, f"too few corners, {np.count_nonzero(seen)} of {len(seen)}")
    return _another(other)


def _another(shown: Board | None) -> Found:
    return Found(None, shown, "no board found" if shown is None else f"shows {shown.text}")


def _find_checkerboard(image: Grey, board: Board) -> Found:
    """The corners of a checkerboard. A photograph that clearly shows another board is not searched thoroughly."""
    marks = find_board(image, board.size, thorough=False)
    if marks is not None and not _has_inked_squares(image, marks, board.size):
        return Found(marks, board)
    other = identify_board(image, thorough=False)
    if other is not None and (other.target, sorted(other.size)) != (board.target, sorted(board.size)):
        return _another(other)
    marks = find_board(image, board.size) if marks is None else marks
    return Found(marks, board) if marks is not None else _another(identify_board(image))


def _has_inked_squares(image: Grey, corners: Array, size: Size) -> bool:
    """Whether squares between corners (columns·rows, 2) are not of one brightness, as those that hold markers."""
    columns, rows = size
    inner = (np.arange(_SAMPLES) + 0.5) / _SAMPLES * 0.6 + 0.2
    across = (np.arange(columns - 1)[:, None] + inner).ravel()
    down = (np.arange(rows - 1)[:, None] + inner).ravel()
    grid = corners.reshape(rows, columns, 2).astype(np.float32)
    samples = np.stack(np.meshgrid(across, down), axis=-1).astype(np.float32)
    places = cv2.remap(grid, samples, None, cv2.INTER_LINEAR)
    levels = cv2.remap(to_8bit(image), places, None, cv2.INTER_LINEAR).astype(float)
    cells = levels.reshape(rows - 1, _SAMPLES, columns - 1, _SAMPLES).std(axis=(1, 3))
    parity = np.add.outer(np.arange(rows - 1), np.arange(columns - 1)) % 2
    spread = max(float(np.median(cells[parity == kind])) for kind in (0, 1))
    return spread > _INK_SHARE * float(np.ptp(np.percentile(levels, (5, 95))))
