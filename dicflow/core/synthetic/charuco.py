"""The ChArUco board: a checkerboard with a marker in each white square, which identifies the squares."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.calibration.charuco import marker_dictionary
from dicflow.core.synthetic.checkerboard import Checkerboard, board_darkness
from dicflow.core.synthetic.render import Extent

__all__ = ["CharucoBoard", "charuco_darkness", "charuco_extent"]


class CharucoBoard(NamedTuple):
    """A checkerboard with markers, numbered row by row.

    board : the squares; the first one is black
    marker : side of a marker as a share of that of a square [-]
    dictionary : name of the marker dictionary
    """

    board: Checkerboard = Checkerboard()
    marker: float = 0.7
    dictionary: str = "4x4_50"


def charuco_extent(marked: CharucoBoard) -> Extent:
    """Extent of the paper [mm]."""
    board = marked.board
    right, bottom = board.columns * board.square + board.margin, board.rows * board.square + board.margin
    return Extent(-board.margin, right, -board.margin, bottom)


def charuco_darkness(marked: CharucoBoard, points: ArrayLike) -> Array:
    """Darkness (...) of points (..., 2) of the board [mm]: 0 white … 1 black."""
    points = np.asarray(points, dtype=float)
    return np.maximum(board_darkness(marked.board, points), _marker_darkness(marked, points))


def _marker_darkness(marked: CharucoBoard, points: Array) -> Array:
    """Darkness (...) of the markers alone at points (..., 2) [mm]."""
    board, modules = marked.board, _modules(marked)
    square = np.floor(points / board.square).astype(int)
    count = modules.shape[-1]
    place = np.floor(((points / board.square - square) - 0.5 + marked.marker / 2.0) / marked.marker * count).astype(int)
    column, row = np.moveaxis(square, -1, 0)
    white = (column >= 0) & (column < board.columns) & (row >= 0) & (row < board.rows) & ((column + row) % 2 == 1)
    inked = white & np.all((place >= 0) & (place < count), axis=-1)
    number = np.where(inked, (row * board.columns + column) // 2, 0)
    across, down = np.moveaxis(np.where(inked[..., None], place, 0), -1, 0)
    return np.where(inked, modules[number, down, across], 0.0)


def _modules(marked: CharucoBoard) -> Array:
    """Darkness of each marker's modules (marker, row, col), including the black border: 0 or 1."""
    dictionary = marker_dictionary(marked.dictionary)
    side = dictionary.markerSize + 2
    count = marked.board.columns * marked.board.rows // 2
    drawn = [cv2.aruco.generateImageMarker(dictionary, number, side, borderBits=1) for number in range(count)]
    return 1.0 - np.stack(drawn) / 255.0
