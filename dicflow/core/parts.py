"""Parts of a grid of points that move on their own: separate polygons of the region, and the two sides of a cut.

Scipy is loaded where it is used: most who have parts need none of it, and it takes longer to load than they compute.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Counts, Mask
from dicflow.core.kernels import INNER, KERNEL

__all__ = ["Parts", "are_apart", "beside_borders", "cut_segments", "grid_parts", "islands", "sees", "single_part"]


class Parts(NamedTuple):
    """The part of each point of a grid.

    number : (rows, cols) int32 — of the part; 0 for points outside the region
    places : (rows, cols, 2) float64 — of the points in the first photograph [px]
    cuts : (k, 4) float64 — ends (x0, y0, x1, y1) of the straight pieces of the cuts there [px]. A cut that ends inside
        the region separates points of one part.
    """

    number: Counts
    places: Array
    cuts: Array

    @property
    def is_single(self) -> bool:
        """Whether all points belong together."""
        return len(self.cuts) == 0 and int(self.number.max(initial=0)) <= 1


def single_part(places: Array) -> Parts:
    """All points (rows, cols, 2) with a place as one part."""
    return grid_parts(places, np.ones(places.shape[:2], dtype=np.int32), np.zeros((0, 4)))


def grid_parts(places: Array, polygon: Counts, cuts: Array) -> Parts:
    """The parts of a grid of points.

    places : (rows, cols, 2) — in the first photograph; NaN outside the region [px]
    polygon : (rows, cols) — number of the polygon around each point, from 1
    cuts : (k, 4) — ends (x0, y0, x1, y1) of their straight pieces [px]
    """
    number = np.where(np.isfinite(places).all(axis=-1), polygon, 0).astype(np.int32)
    parts = Parts(number, np.ascontiguousarray(places, dtype=np.float64), cuts)
    return parts if len(cuts) == 0 else parts._replace(number=_connected(parts))


def cut_segments(cuts: Sequence[Array]) -> Array:
    """The straight pieces (k, 4) of polylines, each (n, 2) [px]."""
    return np.concatenate([np.zeros((0, 4)), *(np.hstack([line[:-1], line[1:]]) for line in cuts)])


def islands(known: Mask, parts: Parts | None = None) -> Counts:
    """Connected islands of known points (rows, cols), numbered from 1; 0 elsewhere. None of them has two parts."""
    if parts is None or parts.is_single:
        return _numbered(known)
    numbered = np.zeros(known.shape, dtype=np.int32)
    for part in range(1, int(parts.number.max()) + 1):
        here = known & (parts.number == part)
        numbered[here] = _numbered(here)[here] + numbered.max()
    return numbered


def _numbered(known: Mask) -> Counts:
    """Numbers of the islands of known points, of which each touches the next at a side or a corner."""
    return np.asarray(cv2.connectedComponents(known.astype(np.uint8), connectivity=8)[1], dtype=np.int32)


def sees(place: Array, others: Array, cuts: Array) -> Mask:
    """Which places (..., 2) no cut (k, 4) separates from one place (2,) [px]."""
    flat = np.ascontiguousarray(others.reshape(-1, 2))
    return np.asarray(~_crossed(np.broadcast_to(place, flat.shape).copy(), flat, cuts).reshape(others.shape[:-1]))


@njit(forceinline=True, **KERNEL)
def are_apart(parts: Parts, i: int, j: int, a: int, b: int) -> bool:
    """Whether the points at (i, j) and (a, b) of the grid belong to different parts, or to different sides of a cut."""
    if parts.number[i, j] != parts.number[a, b]:
        return True
    for k in range(len(parts.cuts)):  # noqa: SIM110 (numba has no any)
        if _cross(parts.places[i, j], parts.places[a, b], parts.cuts[k]):
            return True
    return False


def beside_borders(parts: Parts) -> Mask:
    """Points (rows, cols) with a neighbour on the grid in another part or beyond a cut."""
    beside = np.zeros(parts.number.shape, dtype=np.bool_)
    if not parts.is_single:
        _mark_borders(parts, beside)
    return beside


@njit(**KERNEL)
def _mark_borders(parts: Parts, beside: Mask) -> None:
    rows, cols = parts.number.shape
    for i in range(rows):
        for j in range(cols):
            for down, right in ((0, 1), (1, 0)):
                a, b = i + down, j + right
                inside = a < rows and b < cols and parts.number[i, j] > 0 and parts.number[a, b] > 0
                if inside and are_apart(parts, i, j, a, b):
                    beside[i, j] = beside[a, b] = True


@njit(**KERNEL)
def _crossed(start: Array, end: Array, cuts: Array) -> Mask:
    """Which of the straight lines from start (n, 2) to end (n, 2) a cut crosses."""
    crossed = np.zeros(len(start), dtype=np.bool_)
    for n in range(len(start)):
        for k in range(len(cuts)):
            crossed[n] |= _cross(start[n], end[n], cuts[k])
    return crossed


@njit(**INNER)
def _cross(p: Array, q: Array, cut: Array) -> bool:
    """Whether the straight line from p to q crosses a piece (4,) of a cut or touches it."""
    ax, ay, bx, by = cut[0], cut[1], cut[2], cut[3]
    first = (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax)
    second = (bx - ax) * (q[1] - ay) - (by - ay) * (q[0] - ax)
    third = (q[0] - p[0]) * (ay - p[1]) - (q[1] - p[1]) * (ax - p[0])
    fourth = (q[0] - p[0]) * (by - p[1]) - (q[1] - p[1]) * (bx - p[0])
    return first * second <= 0.0 and third * fourth <= 0.0 and not (first == 0.0 and second == 0.0)


def _connected(parts: Parts) -> Counts:
    """Numbers of the parts (rows, cols) after the cuts: of points connected with their neighbours."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components

    rows, cols = parts.number.shape
    index = np.arange(rows * cols).reshape(rows, cols)
    edges = []
    for down, right in ((0, 1), (1, 0), (1, 1), (1, -1)):
        here = (slice(0, rows - down), slice(max(0, -right), cols - max(0, right)))
        there = (slice(down, rows), slice(max(0, right), cols - max(0, -right)))
        joined = (parts.number[here] > 0) & (parts.number[here] == parts.number[there])
        start, end = parts.places[here][joined], parts.places[there][joined]
        edges.append(np.stack([index[here][joined], index[there][joined]])[:, ~_crossed(start, end, parts.cuts)])
    one, other = np.concatenate(edges, axis=1)
    graph = coo_array((np.ones(len(one)), (one, other)), shape=(rows * cols,) * 2)
    inside = parts.number.ravel() > 0
    numbers = connected_components(graph, directed=False)[1]
    number = np.zeros(rows * cols, dtype=np.int32)
    number[inside] = np.unique(numbers[inside], return_inverse=True)[1] + 1
    return number.reshape(rows, cols)
