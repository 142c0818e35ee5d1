"""Whether the motion jumps at a point: what the points on its two sides predict.

A straight line through a point, in one of four directions, parts the points around it. Those of each side predict its
place by their own warps. Smooth motion, however curved, gives both sides the same place but for terms of the third
order; across a crack or the border of a part the two differ by the jump. A place that lies between them, off from
either by more than the residual of its subset allows for two motions in it, is that of a steep gradient.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Codes, Index, Mask
from dicflow.core.correlation.edges import Edges, most_off
from dicflow.core.correlation.follow import Field, sigma_by_residual
from dicflow.core.correlation.subsets import Subset
from dicflow.core.correlation.warp import set_recentred
from dicflow.core.kernels import INNER, KERNEL
from dicflow.core.medians import median
from dicflow.core.parts import Parts, are_apart
from dicflow.core.status import Status

__all__ = ["Sides", "find_jumps", "predicted_by_sides"]


_DIRECTIONS = np.array([[1.0, 0.0], [0.0, 1.0], [0.7071, 0.7071], [0.7071, -0.7071]])
"""Normals (row, col) of the lines."""
_HALF_WIDTH = 2.1
"""Distance from the normal up to which points of a side count [points]."""
_MIN_POINTS = 6
"""Points that each side needs."""
_FREE_PX, _SPREADS = 0.1, 3.0
"""Pixels, and sums of the median deviations of both sides, above which their difference is a jump."""
_BEYOND = 2
"""Points of the grid beyond a subset's side that still count."""
_NEAR_PX, _SIGMAS, _LOST_PX, _LOST_SIGMAS = 0.005, 2.0, 0.02, 4.0
"""Pixels and standard deviations by the residual, whose sum a place beside a jump may differ from its own side, and up
to which it is less certain rather than lost; the predictions of a single side of a bent field lie as far off as they
scatter."""
_VALID = int(Status.VALID)


class Sides(NamedTuple):
    """What the two sides of n points predict, by the line across which they differ most.

    place : (n, 2, 2) — by side and axis [px]; NaN without enough points on either
    spread : (n,) — median deviations of the predictions, of both sides together [px]
    """

    place: Array
    spread: Array

    @property
    def jump(self) -> Mask:
        """At which points (n,) the motion jumps."""
        size = np.linalg.norm(self.place[:, 1] - self.place[:, 0], axis=1)
        return np.asarray(size > _FREE_PX + _SPREADS * self.spread)

    def enclose(self, place: Array) -> Mask:
        """Which places (n, 2) lie between both predictions; curved motion puts both on one side of the place."""
        return np.asarray(((self.place[:, 0] - place) * (self.place[:, 1] - place)).sum(axis=1) < 0.0)

    def away(self, place: Array) -> Array:
        """Distances (n,) of places (n, 2) from the nearer prediction [px]."""
        return np.asarray(np.linalg.norm(self.place - place[:, None], axis=2).min(axis=1))


def find_jumps(
    edges: Edges, centres: Array, field: Field, parts: Parts, subset: Subset, known: Mask | None = None
) -> Edges:
    """The edges of a field, with those of them where the motion jumps as DISCONTINUITY.

    A point beside a jump whose place is that of neither side is lost too, or less certain where the jump is too small
    to tell. From there the jump is followed, as long as it goes on.

    known : (rows, cols) bool — points at which the motion jumps in another photograph; None without any
    """
    reach, found, warp = _reach(centres, subset.size), edges, np.ascontiguousarray(field.warp[..., :3])
    measured = field.status == Status.VALID
    suspect = measured & ((edges.reason != Status.VALID) | (edges.variance > 0.0))
    clean, tested = measured & ~suspect, np.zeros_like(suspect)
    if known is not None:
        suspect |= measured & _within(known, reach)
    while suspect.any():
        tested |= suspect
        points = np.argwhere(suspect)
        sides = predicted_by_sides(points, _code(clean), warp, centres, parts, reach)
        found = _with_sides(found, sides, points, field, subset)
        jumps = found.reason == Status.DISCONTINUITY
        clean &= ~jumps
        suspect = measured & _within(jumps, reach) & ~tested
    return found


def _code(clean: Mask) -> Codes:
    return np.where(clean, np.uint8(Status.VALID), np.uint8(Status.MISFIT))


def _with_sides(edges: Edges, sides: Sides, points: Index, field: Field, subset: Subset) -> Edges:
    """The edges with what the sides say of points (n, 2)."""
    at, reason, variance = tuple(points.T), edges.reason.copy(), edges.variance.copy()
    noise = sigma_by_residual(field, at)
    place = field.warp[at][..., 0]
    away, enclosed = np.nan_to_num(sides.away(place)), sides.enclose(place)
    steep = enclosed & (away > most_off(field, at, edges.usual, subset))
    between = enclosed & ~steep & (away > _NEAR_PX + _SIGMAS * noise)
    lost = (
        sides.jump & ~steep & ((away > _LOST_PX + _LOST_SIGMAS * noise + sides.spread) | (reason[at] != Status.VALID))
    )
    reason[at] = np.where(lost, np.uint8(Status.DISCONTINUITY), reason[at])
    variance[at] = np.where(reason[at] == Status.VALID, np.maximum(variance[at], np.where(between, away**2, 0.0)), 0.0)
    return edges._replace(reason=reason, variance=variance)


def _within(mask: Mask, reach: int) -> Mask:
    """The mask grown by so many points in all directions."""
    square = np.ones((2 * reach + 1,) * 2, dtype=np.uint8)
    return np.asarray(cv2.dilate(mask.astype(np.uint8), square) > 0, dtype=np.bool_)


def _reach(centres: Array, size: int) -> int:
    """Points of the grid within a subset's side, and two more."""
    across, down = np.moveaxis(np.diff(centres, axis=1), -1, 0)
    apart = np.hypot(across, down)
    apart = apart[apart > 0.0]
    return _BEYOND + (int(np.ceil(size / np.median(apart))) if len(apart) else 0)


def predicted_by_sides(points: Index, status: Codes, warp: Array, grid: Array, parts: Parts, reach: int) -> Sides:
    """What the valid points on either side of points (n, 2) of a grid predict.

    status : (rows, cols); warp : (rows, cols, 2, 3) — the second derivatives of a subset carry too much noise that far
    grid : (rows, cols, 2) — centres of the subsets [px]
    reach : how many points away they are at most along both axes of the grid
    """
    found = Sides(np.full((len(points), 2, 2), np.nan), np.full(len(points), np.nan))
    _compare(np.ascontiguousarray(points), status, warp, grid, parts, reach, found.place, found.spread)
    return found


@njit(**KERNEL)
def _compare(
    points: Index, status: Codes, warp: Array, grid: Array, parts: Parts, reach: int, place: Array, spread: Array
) -> None:
    """The loop of :func:`predicted_by_sides` over points, into ``place`` and ``spread``."""
    rows, cols = status.shape
    terms, most = warp.shape[3], (2 * reach + 1) ** 2
    values, away, count = np.empty((2 * terms, most)), np.empty((most, 2)), 0
    side, scratch, middles = np.empty(most), np.empty(most), np.empty((2, 2))
    for k in range(len(points)):
        i, j, count = points[k, 0], points[k, 1], 0
        for a in range(max(0, i - reach), min(rows, i + reach + 1)):
            for b in range(max(0, j - reach), min(cols, j + reach + 1)):
                if status[a, b] == _VALID and not are_apart(parts, i, j, a, b):
                    x, y = grid[i, j, 0] - grid[a, b, 0], grid[i, j, 1] - grid[a, b, 1]
                    set_recentred(warp[a, b], x, y, values, count)
                    away[count, 0], away[count, 1] = a - i, b - j
                    count += 1
        largest = -1.0
        for d in range(len(_DIRECTIONS)):
            for n in range(count):
                beside = abs(away[n, 1] * _DIRECTIONS[d, 0] - away[n, 0] * _DIRECTIONS[d, 1])
                side[n] = away[n, 0] * _DIRECTIONS[d, 0] + away[n, 1] * _DIRECTIONS[d, 1]
                side[n] = side[n] if beside < _HALF_WIDTH else 0.0
            total = _medians(values, terms, side[:count], scratch, middles)
            jump = np.hypot(middles[1, 0] - middles[0, 0], middles[1, 1] - middles[0, 1])
            if jump / (_FREE_PX + total) > largest:
                largest, spread[k] = jump / (_FREE_PX + total), total
                for s in range(2):
                    place[k, s, 0], place[k, s, 1] = middles[s, 0], middles[s, 1]


@njit(**INNER)
def _medians(values: Array, terms: int, side: Array, scratch: Array, middles: Array) -> float:
    """Set the median predictions (side, axis); NaN without enough. Returns the sum of their median deviations."""
    total = 0.0
    for s in range(2):
        for axis in range(2):
            count = 0
            for n in range(len(side)):
                if side[n] < -0.1 if s == 0 else side[n] > 0.1:
                    scratch[count] = values[axis * terms, n]
                    count += 1
            if count < _MIN_POINTS:
                middles[0, 0] = middles[0, 1] = middles[1, 0] = middles[1, 1] = np.nan
                return np.nan
            middles[s, axis] = median(scratch, count)
            for n in range(count):
                scratch[n] = abs(scratch[n] - middles[s, axis])
            total += median(scratch, count)
    return total
