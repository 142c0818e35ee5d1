"""Cells of a grid as pixels: which cell lies at each pixel of a picture."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["cells_at_pixels"]

Array = NDArray[Any]
_ROUNDING = 1e-6
"""Two cells that share an edge both count a pixel so near to it, so that none between them stays empty [px]."""


def cells_at_pixels(places: Array, size: tuple[int, int]) -> NDArray[np.int32]:
    """Number of the cell at the centre of each pixel, −1 outside all cells.

    places : (row, col, 2) of the grid's points in the picture [px], centres of pixels at integers; a cell with an
        unknown corner is left out
    size : (width, height) of the picture [px]
    Returns (height, width); cells are numbered row by row.
    """
    width, height = size
    index = np.full((height, width), -1, np.int32)
    corners = np.stack([places[:-1, :-1], places[:-1, 1:], places[1:, 1:], places[1:, :-1]]).reshape(4, -1, 2)
    numbers = np.flatnonzero(np.isfinite(corners).all(axis=(0, 2))).astype(np.int32)
    x, y = corners[:, numbers, 0], corners[:, numbers, 1]
    cell, line = _whole_numbers(y.min(axis=0), y.max(axis=0), height)
    left, right = _spans(x, y, cell, line)
    span, column = _whole_numbers(left, right, width)
    index[line[span], column] = numbers[cell[span]]
    return index


def _whole_numbers(low: Array, high: Array, count: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """All whole numbers in some intervals that are in 0 … count − 1: number of the interval, and the number in it."""
    first = np.ceil(np.clip(low - _ROUNDING, 0, count)).astype(np.int32)
    last = np.floor(np.clip(high + _ROUNDING, -1, count - 1)).astype(np.int32)
    lengths = np.maximum(last - first + 1, 0)
    interval = np.repeat(np.arange(len(lengths), dtype=np.int32), lengths)
    start = first - (np.cumsum(lengths, dtype=np.int32) - lengths)
    return interval, np.arange(len(interval), dtype=np.int32) + start[interval]


def _spans(x: Array, y: Array, cell: NDArray[np.int32], line: NDArray[np.int32]) -> tuple[Array, Array]:
    """Where cells begin and end on lines.

    x, y : (4, cells) of the corners in their order
    cell, line : number of the cell and of the line of each span
    """
    left, right = np.full(len(line), np.inf), np.full(len(line), -np.inf)
    for corner in range(4):
        x0, y0, x1, y1 = x[corner - 1], y[corner - 1], x[corner], y[corner]
        low, high = np.minimum(y0, y1) - _ROUNDING, np.maximum(y0, y1) + _ROUNDING
        crossed = np.flatnonzero((low[cell] <= line) & (line <= high[cell]))
        edge = cell[crossed]
        at = _crossing(x0[edge], y0[edge], x1[edge], y1[edge], line[crossed])
        left[crossed] = np.minimum(left[crossed], at)
        right[crossed] = np.maximum(right[crossed], at)
    return left, right


def _crossing(x0: Array, y0: Array, x1: Array, y1: Array, line: NDArray[np.int32]) -> Array:
    """Where edges cross lines; of a level edge its first end."""
    rise = y1 - y0
    share = np.divide(line - y0, rise, out=np.zeros_like(rise), where=rise != 0)
    return np.asarray(x0 + np.clip(share, 0.0, 1.0) * (x1 - x0))
