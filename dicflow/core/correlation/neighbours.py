"""Whether the place of a point agrees with those of the points around it.

Each neighbour predicts the place by its own warp, so that the motion's gradient is accounted for. Half of the
predictions may be wrong: their median tells where the point should be, their median deviation from it how well they
know (after the normalised median test of Westerweel and Scarano, Experiments in Fluids 39, 2005). A subset that has
locked onto something else, on the rim of a part or beside a gap, differs from them by more than they differ from each
other and more than noise explains.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Codes, Index, Mask
from dicflow.core.correlation.warp import set_recentred
from dicflow.core.kernels import INNER, KERNEL
from dicflow.core.medians import median
from dicflow.core.parts import Parts, are_apart
from dicflow.core.status import Status
from dicflow.core.threads import over

__all__ = ["Prediction", "disagreeing", "influenced", "mean_of_neighbours", "predicted_by_neighbours"]


_REACH = 2
"""Neighbours of a point are at most so many points away along both axes of the grid."""
_CHUNK = 4096
"""Points that one thread takes at a time."""
_MIN_NEIGHBOURS = 5
"""With fewer, half of them may be wrong by chance, and nothing is said of the point."""
_SPREADS, _SIGMAS, _FREE_PX = 4.0, 5.0, 0.1
"""Median deviations of the predictions, standard deviations by the residual, and pixels, whose sum a point may differ
from its neighbours. Curved motion at a rim differs by some hundredths of a pixel."""
_ZNSSD_OFFSET = 1e-3
"""Added to the ZNSSD of a neighbour, whose weight is the inverse."""
_VALID = int(Status.VALID)


class Prediction(NamedTuple):
    """What the neighbours of n points say of them.

    warp : (n, 2, 3 or 6) — medians of their warps about the point; NaN with too few neighbours
    spread : (n, 2) — median deviations of the places from the median [px]
    """

    warp: Array
    spread: Array


def predicted_by_neighbours(
    points: Index, status: Codes, warp: Array, grid: Array, parts: Parts, threads: int = 1
) -> Prediction:
    """Warps of points (n, 2) of a grid by the valid ones of their neighbours in the same part.

    status : (rows, cols); warp : (rows, cols, 2, 3 or 6); grid : (rows, cols, 2) — centres of the subsets [px]
    NaN also for points with a place that most neighbours predict to within a tenth of a pixel.
    """
    found = Prediction(np.full((len(points), *warp.shape[2:]), np.nan), np.full((len(points), 2), np.nan))
    points = np.ascontiguousarray(points)

    def take(some: slice) -> None:
        _take_medians(points[some], status, warp, grid, parts, found.warp[some], found.spread[some])

    over(threads, take, (slice(first, first + _CHUNK) for first in range(0, len(points), _CHUNK)))
    return found


def mean_of_neighbours(
    points: Index, status: Codes, warp: Array, grid: Array, parts: Parts, znssd: Array, stride: int
) -> Array:
    """Warps (n, 2, 3 or 6) of points (n, 2) of a grid from their eight neighbours ``stride`` away; NaN without any.

    status, znssd : (rows, cols); warp : (rows, cols, 2, 3 or 6); grid : (rows, cols, 2) — centres of the subsets [px]
    """
    found = np.full((len(points), *warp.shape[2:]), np.nan)
    _predict_warps(np.ascontiguousarray(points), status, warp, grid, znssd, stride, parts, found)
    return found


def influenced(changed: Mask) -> Mask:
    """Points (rows, cols) of which the changed ones, or their predictions by these, may differ from before."""
    square = np.ones((2 * _REACH + 1,) * 2, dtype=np.uint8)
    return np.asarray(cv2.dilate(changed.astype(np.uint8), square) > 0, dtype=np.bool_)


def disagreeing(place: Array, sigma: Array, predicted: Prediction) -> Mask:
    """Which places (n, 2) of points differ from what is predicted.

    sigma : (n,) — standard deviations of the places by their residuals [px]
    """
    away = np.abs(predicted.warp[..., 0] - place)
    allowed = _FREE_PX + _SIGMAS * sigma[:, None] + _SPREADS * predicted.spread
    return np.asarray((away > allowed).any(axis=1))


@njit(**KERNEL)
def _take_medians(
    points: Index, status: Codes, warp: Array, grid: Array, parts: Parts, out: Array, spread: Array
) -> None:
    """The loop of :func:`predicted_by_neighbours` over points, into ``out`` and ``spread``."""
    rows, cols = status.shape
    terms, most = warp.shape[3], (2 * _REACH + 1) ** 2
    values = np.empty((2 * terms, most))
    for k in range(len(points)):
        i, j, count = points[k, 0], points[k, 1], 0
        for a in range(max(0, i - _REACH), min(rows, i + _REACH + 1)):
            for b in range(max(0, j - _REACH), min(cols, j + _REACH + 1)):
                if (a != i or b != j) and status[a, b] == _VALID and not are_apart(parts, i, j, a, b):
                    x, y = grid[i, j, 0] - grid[a, b, 0], grid[i, j, 1] - grid[a, b, 1]
                    set_recentred(warp[a, b], x, y, values, count)
                    count += 1
        if count >= _MIN_NEIGHBOURS and not _agree(values[0, :count], values[terms, :count], warp[i, j, :, 0]):
            for m in range(2 * terms):
                out[k, m // terms, m % terms] = median(values[m], count)
            for axis in range(2):
                place = values[axis * terms]
                for n in range(count):
                    place[n] = abs(place[n] - out[k, axis, 0])
                spread[k, axis] = median(place, count)


@njit(**INNER)
def _agree(x: Array, y: Array, place: Array) -> bool:
    """Whether most predictions x, y (n,) are close to a place (2,), so that their medians are; False for NaN."""
    near_x, near_y = 0, 0
    for n in range(len(x)):
        near_x += abs(x[n] - place[0]) < _FREE_PX
        near_y += abs(y[n] - place[1]) < _FREE_PX
    return 2 * min(near_x, near_y) > len(x) + 1


@njit(**KERNEL)
def _predict_warps(
    points: Index, status: Codes, warp: Array, grid: Array, znssd: Array, stride: int, parts: Parts, out: Array
) -> None:
    """Mean of what the warps of the valid ones of eight neighbours predict, weighted by how well these fit."""
    rows, cols = status.shape
    terms = out.shape[2]
    sums = np.empty((2, terms))
    for k in range(len(points)):
        i, j, total = points[k, 0], points[k, 1], 0.0
        for axis in range(2):
            for term in range(terms):
                sums[axis, term] = 0.0
        for a in range(i - stride, i + stride + 1, stride):
            for b in range(j - stride, j + stride + 1, stride):
                if 0 <= a < rows and 0 <= b < cols and status[a, b] == _VALID and not are_apart(parts, i, j, a, b):
                    weight = 1.0 / (znssd[a, b] + _ZNSSD_OFFSET)
                    total += weight
                    x, y = grid[i, j, 0] - grid[a, b, 0], grid[i, j, 1] - grid[a, b, 1]
                    _add_recentred(warp[a, b], x, y, weight, sums)
        if total > 0.0:
            for axis in range(2):
                for term in range(terms):
                    out[k, axis, term] = sums[axis, term] / total


@njit(**INNER)
def _add_recentred(warp: Array, x: float, y: float, weight: float, out: Array) -> None:
    """Add a weighted warp, taken about the point at (x, y) from its centre."""
    for axis in range(2):
        c = warp[axis]
        place, by_x, by_y = c[0] + c[1] * x + c[2] * y, c[1], c[2]
        if len(c) == 6:
            place += c[3] * x * x + c[4] * x * y + c[5] * y * y
            by_x, by_y = by_x + 2.0 * c[3] * x + c[4] * y, by_y + c[4] * x + 2.0 * c[5] * y
            out[axis, 3] += weight * c[3]
            out[axis, 4] += weight * c[4]
            out[axis, 5] += weight * c[5]
        out[axis, 0] += weight * place
        out[axis, 1] += weight * by_x
        out[axis, 2] += weight * by_y
