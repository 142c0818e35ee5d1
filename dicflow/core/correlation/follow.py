"""A grid of subsets followed from one image into another, every point started from what its neighbours found.

First a coarse grid is correlated, from given starts and from there outwards, wave after wave of points that start where
their neighbours say (after Pan, Applied Optics 48, 2009, who takes points one by one; here all points of a wave are
independent of each other, so that they can be shared between threads). Then grids of half the spacing, started in the
same way; on each, points without a value are tried again from what has been found around them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit
from scipy.spatial import cKDTree

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.correlation.subsets import Correlated, Subset, Template, correlate
from dicflow.core.correlation.warp import TERMS, recentred
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.status import Status

__all__ = ["Field", "correlate_field"]


_STRIDES = (8, 4, 2, 1)
_TRIES = 3
_ENOUGH, _SHARE = 20, 0.95
_BEST_ZNSSD = 1e-3
_VALID = int(Status.VALID)
_HOPELESS = (Status.CUT_SUBSET, Status.LOW_TEXTURE)


class Field(NamedTuple):
    """Correlated subsets on a grid.

    warp : (rows, cols, 2, 3 or 6) float64 — NaN where there is no value
    znssd : (rows, cols) float64; iterations : (rows, cols) int16; status : (rows, cols) uint8
    covariance : (rows, cols, 3) float64 — as in core.correlate.Correlated
    """

    warp: Array
    znssd: Array
    iterations: npt.NDArray[np.int16]
    status: npt.NDArray[np.uint8]
    covariance: Array


def correlate_field(
    reference: Template,
    target: Spline,
    grid: Array,
    starts: Array,
    subset: Subset,
    *,
    max_znssd: float = 0.6,
    threads: int = 1,
) -> Field:
    """Follow a grid of subsets.

    grid : (rows, cols, 2) — centres, whole pixels of the reference; NaN outside the region
    starts : (rows, cols, 2, 3) — affine warps to start from, right to a few pixels; NaN where nothing is known
    max_znssd : what fits worse is no match and gets the status LOW_CORRELATION

    Points that no start and no neighbour leads to stay UNTRACKED.
    """
    search = _Search(
        reference, target, grid, subset, max_znssd, threads, _empty(grid, subset), np.zeros(grid.shape[:2])
    )
    for stride in _STRIDES:
        search.fill(stride, starts)
        search.learn()
    return search.field


@dataclasses.dataclass
class _Search:
    """A field under way.

    tries : (rows, cols) — how often each point was looked for
    ratios : by how much increments shrank, of points so far; contraction : what nearly all of them stay below
    """

    reference: Template
    target: Spline
    grid: Array
    subset: Subset
    max_znssd: float
    threads: int
    field: Field
    tries: Array
    ratios: list[Array] = dataclasses.field(default_factory=list)
    contraction: float = 1.0

    def fill(self, stride: int, starts: Array) -> None:
        """Find every ``stride``-th point of the grid, each way, that neighbours on this lattice or a start lead to."""
        lattice = (slice(None, None, stride),) * 2
        status, tries, inside = self.field.status[lattice], self.tries[lattice], np.isfinite(self.grid[..., 0])[lattice]
        points = stride * np.argwhere(status == Status.UNTRACKED)
        self.attempt(points, self.first_guess(points, stride, starts))
        fresh = status == Status.VALID
        while fresh.any():
            before = status == Status.VALID
            lost = inside & ~before & ~np.isin(status, _HOPELESS) & (tries < _TRIES)
            points = stride * np.argwhere(lost & _around(fresh))
            self.attempt(points, self.predicted(points, stride))
            fresh = (status == Status.VALID) & ~before

    def first_guess(self, points: Index, stride: int, starts: Array) -> Array:
        """Warps (n, 2, 3) that the neighbours say, or else the starts at the points (n, 2), or the nearest start."""
        guess = self.predicted(points, stride)
        unknown = np.isnan(guess[:, 0, 0])
        guess[unknown] = starts[tuple(points[unknown].T)]
        unknown = np.isnan(guess[:, 0, 0])
        guess[unknown] = _nearest(starts, self.grid, points[unknown], stride)
        return guess

    def attempt(self, points: Index, starts: Array) -> None:
        """Correlate points (n, 2) of the grid from affine warps (n, 2, 3), those that have one."""
        known = np.isfinite(starts).all(axis=(-2, -1))
        rows, cols = points[known].T
        start = np.zeros((len(rows), 2, TERMS[self.subset.shape_function]))
        start[..., :3] = starts[known]
        found = correlate(
            self.reference, self.target, self.grid[rows, cols], start, self.subset, self.threads, self.contraction
        )
        self.ratios.append(found.contraction[np.isfinite(found.contraction)])
        self.tries[rows, cols] += 1
        pairs: Iterable[tuple[Any, Any]] = zip(self.field, self._judged(found), strict=False)
        for kept, new in pairs:
            kept[rows, cols] = new

    def learn(self) -> None:
        """Take the contraction from the points so far, once they are enough to tell."""
        ratios = np.concatenate(self.ratios)
        if self.contraction == 1.0 and len(ratios) >= _ENOUGH:
            self.contraction = min(1.0, float(np.quantile(ratios, _SHARE)))

    def _judged(self, found: Correlated) -> Correlated:
        """What fits badly is no match."""
        bad = (found.status == Status.VALID) & ~(found.znssd <= self.max_znssd)
        found.status[bad] = Status.LOW_CORRELATION
        found.warp[bad] = np.nan
        found.covariance[bad] = np.nan
        return found

    def predicted(self, points: Index, stride: int) -> Array:
        """Affine warps (n, 2, 3) that the eight points ``stride`` away say of points (n, 2); NaN where none is good."""
        warps = np.full((len(points), 2, 3), np.nan)
        _predict(points, self.field.status, self.field.warp, self.grid, self.field.znssd, stride, warps)
        return warps


def _empty(grid: Array, subset: Subset) -> Field:
    shape = grid.shape[:2]
    status = np.where(np.isfinite(grid).all(axis=-1), Status.UNTRACKED, Status.OUTSIDE).astype(np.uint8)
    return Field(
        np.full((*shape, 2, TERMS[subset.shape_function]), np.nan),
        np.full(shape, np.nan),
        np.zeros(shape, dtype=np.int16),
        status,
        np.full((*shape, 3), np.nan),
    )


def _nearest(starts: Array, grid: Array, points: Index, stride: int) -> Array:
    """The start nearest on the grid to each point (n, 2) of a lattice, at most half a stride away; NaN without any."""
    warps = np.full((len(points), 2, 3), np.nan)
    given = np.argwhere(np.isfinite(starts[..., 0, 0]))
    if not len(points) or not len(given):
        return warps
    away, which = cKDTree(given).query(points, p=np.inf, distance_upper_bound=stride / 2 + 1e-9)
    known = np.isfinite(away)
    here, there = tuple(points[known].T), tuple(given[which[known]].T)
    warps[known] = recentred(starts[there], grid[here] - grid[there])
    return warps


def _around(mask: Mask) -> Mask:
    """Points with one of the mask among themselves and their eight neighbours."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), dtype=np.uint8)) > 0, dtype=np.bool_)


@njit(cache=True, nogil=True)
def _predict(points: Any, status: Any, warp: Any, grid: Any, znssd: Any, stride: int, out: Any) -> None:
    """Mean over the good ones of the eight neighbours of where their warps put a point, the better the weightier."""
    rows, cols = status.shape
    sums = np.empty((2, 3))
    for k in range(len(points)):
        i, j = points[k]
        total, sums[:] = 0.0, 0.0
        for a in range(i - stride, i + stride + 1, stride):
            for b in range(j - stride, j + stride + 1, stride):
                if 0 <= a < rows and 0 <= b < cols and status[a, b] == _VALID:
                    weight = 1.0 / (znssd[a, b] + _BEST_ZNSSD)
                    total += weight
                    x, y = grid[i, j, 0] - grid[a, b, 0], grid[i, j, 1] - grid[a, b, 1]
                    _add_recentred(warp[a, b], x, y, weight, sums)
        if total > 0.0:
            out[k] = sums / total


@njit(cache=True, nogil=True)
def _add_recentred(warp: Any, x: float, y: float, weight: float, out: Any) -> None:
    """Add the affine part of a warp about the point at (x, y) from its centre."""
    for axis in range(2):
        c = warp[axis]
        place, by_x, by_y = c[0] + c[1] * x + c[2] * y, c[1], c[2]
        if len(c) == 6:
            place += c[3] * x * x + c[4] * x * y + c[5] * y * y
            by_x, by_y = by_x + 2.0 * c[3] * x + c[4] * y, by_y + c[4] * x + 2.0 * c[5] * y
        out[axis, 0] += weight * place
        out[axis, 1] += weight * by_x
        out[axis, 2] += weight * by_y
