"""The checkerboard: black and white squares on white, its first outer corner at (0, 0), X along its columns."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.kernels import KERNEL

__all__ = ["Checkerboard", "board_corners", "board_darkness", "board_outline"]


class Checkerboard(NamedTuple):
    """A flat board.

    columns, rows : number of squares, one more than the inner corners in each direction
    square : side of a square [mm]
    margin : width of the white paper around the squares [mm]
    edge : width of the transition from black to white [mm]
    """

    columns: int = 10
    rows: int = 7
    square: float = 14.5
    margin: float = 5.0
    edge: float = 0.12


def board_corners(board: Checkerboard) -> Array:
    """Inner corners (rows − 1, columns − 1, 2) on the board [mm]."""
    x, y = np.meshgrid(np.arange(1, board.columns), np.arange(1, board.rows))
    return board.square * np.stack([x, y], axis=-1).astype(float)


def board_outline(board: Checkerboard) -> Array:
    """The four corners (4, 2) of the paper on the board's plane [mm], in order around it."""
    left = -board.margin
    right, bottom = board.columns * board.square + board.margin, board.rows * board.square + board.margin
    return np.array([[left, left], [right, left], [right, bottom], [left, bottom]])


def board_darkness(board: Checkerboard, points: ArrayLike) -> Array:
    """Darkness (...) of points (..., 2) of the board [mm]: 0 white … 1 black; the first square is black."""
    points = np.asarray(points, dtype=float)
    return np.asarray(_darkness_at(board, points.reshape(-1, 2))).reshape(points.shape[:-1])


@njit(**KERNEL)
def _soft_step(distance: float, width: float) -> float:
    """Smooth step from 0 to 1 over a width, ½ at distance 0."""
    t = min(max(0.5 + distance / width, 0.0), 1.0)
    return t * t * (3.0 - 2.0 * t)


@njit(**KERNEL)
def _square_wave(coordinate: float, count: int, square: float, edge: float) -> float:
    """Wave between −1 and 1 over the squares of one direction; the outermost squares extend beyond the board."""
    line = min(max(round(coordinate / square), 1), count - 1)
    wave: float = 2.0 * _soft_step(coordinate - line * square, edge) - 1.0
    return wave if line % 2 == 0 else -wave


@njit(**KERNEL)
def _inside_squares(coordinate: float, count: int, square: float, edge: float) -> float:
    """1 on the squares, 0 outside them, with soft edges."""
    inside: float = _soft_step(coordinate, edge) * _soft_step(count * square - coordinate, edge)
    return inside


@njit(**KERNEL)
def _ink(board: Checkerboard, x: float, y: float) -> float:
    """Darkness of one point of the board, 0 … 1."""
    inside = _inside_squares(x, board.columns, board.square, board.edge) * _inside_squares(
        y, board.rows, board.square, board.edge
    )
    if inside == 0.0:
        return 0.0
    wave_x = _square_wave(x, board.columns, board.square, board.edge)
    wave_y = _square_wave(y, board.rows, board.square, board.edge)
    darkness: float = 0.5 * inside * (1.0 + wave_x * wave_y)
    return darkness


@njit(**KERNEL)
def _darkness_at(board: Checkerboard, points: Array) -> Array:
    """Darkness (n,) of points (n, 2) of the board."""
    out = np.empty(len(points))
    for i in range(len(points)):
        out[i] = _ink(board, points[i, 0], points[i, 1])
    return out
