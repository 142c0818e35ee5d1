"""The nearest of many places in a plane, found by sorting these into cells.

Compiled with the kernels that use it. ``scipy.spatial`` finds the same, but takes longer to load than a pair of
photographs of 5 million pixels to search; it serves where a process takes long anyway.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Index
from dicflow.core.kernels import INNER, KERNEL, MAKER

__all__ = ["nearest"]

_PER_CELL = 2.0
"""Places in a cell, on average."""


def nearest(places: Array | Index, points: Array | Index, count: int = 1) -> tuple[Array, Index]:
    """Distances and numbers (n, count) of the places nearest to each point, the nearest one first.

    places : (m, 2) — finite, m at least ``count``; points : (n, 2) — finite
    Of places equally far away any may come first, but always the same. Raises ValueError for too few places.
    """
    if len(places) < count:
        raise ValueError(f"{count} nearest places are wanted of {len(places)}")
    distance, index = np.empty((len(points), count)), np.empty((len(points), count), dtype=np.int64)
    given = (np.ascontiguousarray(table, dtype=np.float64) for table in (places, points))
    _find_nearest(*given, distance, index)
    return distance, index


@njit(**KERNEL)
def _find_nearest(places: Array, points: Array, distance: Array, index: Index) -> None:
    """The loop of :func:`nearest`: cells in growing squares around a point, until what they leave out is farther."""
    if len(places) == 0:
        return
    low, side, size = _cells(places)
    first, order, ordered = _sorted_into_cells(places, low, side, size)
    last = distance.shape[1] - 1
    for n in range(len(points)):
        for k in range(last + 1):
            distance[n, k] = np.inf
        x, y = (points[n, 0] - low[0]) / side, (points[n, 1] - low[1]) / side
        row, col, reach = _cell(y, size[0]), _cell(x, size[1]), 0
        while True:
            for i in range(max(row - reach, 0), min(row + reach + 1, size[0])):
                step = 1 if abs(i - row) == reach else max(2 * reach, 1)
                for j in range(col - reach, col + reach + 1, step):
                    if 0 <= j < size[1]:
                        cell = i * size[1] + j
                        _take_nearer(ordered, first[cell], first[cell + 1], points[n], distance[n], index[n])
            outside = side * min(_outside(x, col, reach, size[1]), _outside(y, row, reach, size[0]))
            if distance[n, last] <= outside * outside:
                break
            reach += 1
        for k in range(last + 1):
            distance[n, k], index[n, k] = np.sqrt(distance[n, k]), order[index[n, k]]


@njit(**INNER)
def _outside(place: float, cell: int, reach: int, size: int) -> float:
    """Least distance along one axis from a place to cells farther than the reach, in cells; infinite without any."""
    before = place - (cell - reach) if cell - reach > 0 else np.inf
    after = (cell + reach + 1) - place if cell + reach + 1 < size else np.inf
    return min(before, after)


@njit(**MAKER)
def _cells(places: Array) -> tuple[Array, float, tuple[int, int]]:
    """The corner (x, y) of least coordinates, the side of square cells, and how many are in a column and a row."""
    low, high = places[0].copy(), places[0].copy()
    for m in range(len(places)):
        for axis in range(2):
            low[axis], high[axis] = min(low[axis], places[m, axis]), max(high[axis], places[m, axis])
    wide, tall = high[0] - low[0], high[1] - low[1]
    cells = max(len(places) / _PER_CELL, 1.0)
    side = max(np.sqrt(wide * tall / cells), max(wide, tall) / cells)
    if side <= 0.0:
        side = 1.0
    return low, side, (int(tall / side) + 1, int(wide / side) + 1)


@njit(**INNER)
def _cell(place: float, size: int) -> int:
    """Number of the cell of a place along one axis, or of the one nearest to it. place : in cells"""
    return int(min(max(np.floor(place), 0.0), size - 1.0))


@njit(**MAKER)
def _sorted_into_cells(places: Array, low: Array, side: float, size: tuple[int, int]) -> tuple[Index, Index, Array]:
    """Where each cell begins (cell + 1,) in the places sorted by cell, their numbers (m,), and these places (m, 2)."""
    cell = np.empty(len(places), dtype=np.int64)
    first = np.zeros(size[0] * size[1] + 1, dtype=np.int64)
    for m in range(len(places)):
        row, col = _cell((places[m, 1] - low[1]) / side, size[0]), _cell((places[m, 0] - low[0]) / side, size[1])
        cell[m] = row * size[1] + col
        first[cell[m] + 1] += 1
    for k in range(1, len(first)):
        first[k] += first[k - 1]
    order, ordered, filled = np.empty(len(places), dtype=np.int64), np.empty(places.shape), first.copy()
    for m in range(len(places)):
        k = filled[cell[m]]
        order[k], ordered[k, 0], ordered[k, 1] = m, places[m, 0], places[m, 1]
        filled[cell[m]] += 1
    return first, order, ordered


@njit(**INNER)
def _take_nearer(places: Array, first: int, end: int, point: Array, distance: Array, index: Index) -> None:
    """Insert some places into the nearest ones so far, with squares of their distances, in their order."""
    last = len(distance) - 1
    for m in range(first, end):
        square = (places[m, 0] - point[0]) ** 2 + (places[m, 1] - point[1]) ** 2
        if square < distance[last]:
            k = last
            while k > 0 and square < distance[k - 1]:
                distance[k], index[k] = distance[k - 1], index[k - 1]
                k -= 1
            distance[k], index[k] = square, m
