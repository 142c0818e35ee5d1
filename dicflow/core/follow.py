"""A grid of subsets followed from one image into another, every point started from what its neighbours found.

First a coarse grid is correlated from given starts. Then grids of half the spacing, started where the points around
them say. Last, points without a value are tried again from their best neighbours, wave after wave, so that the
measured area grows outwards (after Pan, Applied Optics 48, 2009, who takes points one by one; here all points of a
level or a wave are independent of each other, so that they can be shared between threads).
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from dicflow.core.correlate import Correlated, Subset, Template, correlate
from dicflow.core.interpolate import Spline
from dicflow.core.status import Status
from dicflow.core.warp import TERMS

__all__ = ["Field", "correlate_field"]

Array = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

_COARSE = 4
_TRIES = 3
_WAVES = 200
_ENOUGH = 0.1
_BEST_ZNSSD = 1e-3


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
    search = _Search(reference, target, grid, subset, max_znssd, threads, _empty(grid, subset))
    inside = _finite(grid[..., 0])
    coarse = (slice(None, None, _COARSE),) * 2
    stride = _COARSE if _finite(starts[..., 0, 0])[coarse].sum() > _ENOUGH * inside[coarse].sum() else 1
    level = np.zeros(inside.shape, dtype=np.bool_)
    level[::stride, ::stride] = True
    search.attempt(inside & level, starts)
    search.grow(inside & level, stride)
    while stride > 1:
        stride //= 2
        level[::stride, ::stride] = True
        predicted = search.predicted(stride)
        known = _finite(predicted[..., 0, 0])[..., None, None]
        search.attempt(inside & level & search.untried, np.where(known, predicted, starts))
    search.grow(inside, 1)
    return search.field


class _Search(NamedTuple):
    """A field under way."""

    reference: Template
    target: Spline
    grid: Array
    subset: Subset
    max_znssd: float
    threads: int
    field: Field

    @property
    def untried(self) -> Mask:
        return np.asarray(self.field.status == Status.UNTRACKED, dtype=np.bool_)

    @property
    def good(self) -> Mask:
        return np.asarray(self.field.status == Status.VALID, dtype=np.bool_)

    def attempt(self, where: Mask, starts: Array) -> None:
        """Correlate the points of a mask (rows, cols) that have a start."""
        where = where & _finite(starts.sum(axis=(-2, -1)))
        start = np.zeros((int(where.sum()), 2, TERMS[self.subset.shape_function]))
        start[..., :3] = starts[where][..., :3]
        found = correlate(self.reference, self.target, self.grid[where], start, self.subset, self.threads)
        pairs: Iterable[tuple[Any, Any]] = zip(self.field, self._judged(found), strict=True)
        for kept, new in pairs:
            kept[where] = new

    def _judged(self, found: Correlated) -> Correlated:
        """What fits badly is no match."""
        bad = (found.status == Status.VALID) & ~(found.znssd <= self.max_znssd)
        found.status[bad] = Status.LOW_CORRELATION
        found.warp[bad] = np.nan
        found.covariance[bad] = np.nan
        return found

    def predicted(self, stride: int) -> Array:
        """Affine warps (rows, cols, 2, 3) that the good points around say, at most ``stride`` away; NaN without any."""
        warps = np.full((*self.good.shape, 2, 3), np.nan)
        _predict(self.good, self.field.warp, self.grid, self.field.znssd, stride, warps)
        return warps

    def grow(self, where: Mask, stride: int) -> None:
        """Try points without value from their neighbours until none is gained; each a few times at most."""
        tries = np.zeros(where.shape, dtype=np.int8)
        fresh = self.good
        hopeless = (Status.CUT_SUBSET, Status.LOW_TEXTURE)
        for _ in range(_WAVES):
            lost = where & ~self.good & (tries < _TRIES) & ~np.isin(self.field.status, hopeless)
            lost &= _around(fresh, stride)
            if not lost.any():
                break
            before = self.good
            self.attempt(lost, self.predicted(stride))
            tries[lost] += 1
            fresh = self.good & ~before


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


def _finite(values: Array) -> Mask:
    return np.asarray(np.isfinite(values), dtype=np.bool_)


def _around(mask: Mask, stride: int) -> Mask:
    """Points with one of the mask among the eight that are ``stride`` away."""
    wide = np.pad(mask, stride)
    rows, cols = mask.shape
    shifts = (0, stride, 2 * stride)
    near: Mask = np.any([wide[i : i + rows, j : j + cols] for i in shifts for j in shifts], axis=0)
    return near


@njit(cache=True, nogil=True)
def _predict(good: Any, warp: Any, grid: Any, znssd: Any, stride: int, out: Any) -> None:
    """Mean over the good ones of the eight neighbours of where their warps put a point, the better the weightier."""
    for i in range(len(good)):
        for j in range(good.shape[1]):
            if good[i, j] or np.isnan(grid[i, j, 0]):
                continue
            total = 0.0
            sums = np.zeros((2, 3))
            for a in range(max(i % stride, i - stride), min(len(good), i + stride + 1), stride):
                for b in range(max(j % stride, j - stride), min(good.shape[1], j + stride + 1), stride):
                    if good[a, b]:
                        weight = 1.0 / (znssd[a, b] + _BEST_ZNSSD)
                        total += weight
                        x, y = grid[i, j, 0] - grid[a, b, 0], grid[i, j, 1] - grid[a, b, 1]
                        _add_recentred(warp[a, b], x, y, weight, sums)
            if total > 0.0:
                out[i, j] = sums / total


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
