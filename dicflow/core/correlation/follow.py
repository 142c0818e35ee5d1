"""A grid of subsets correlated, every point started from the warps of its neighbours.

First a coarse grid is correlated: points with a start, and from there outwards wave after wave of their neighbours
(after Pan, Applied Optics 48, 2009, who takes points one by one; here the points of a wave are independent of each
other, so that threads can share them). Then come grids of half the spacing, started in the same way; on each, points
without a value are tried again from the points found around them. At last, points that do not move as their neighbours
do, and lost ones, are searched for once more from where their neighbours predict them.
"""

from __future__ import annotations

import dataclasses
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Codes, Index, Iterations, Mask, all_finite
from dicflow.core.correlation.neighbours import (
    Prediction,
    disagreeing,
    influenced,
    mean_of_neighbours,
    predicted_by_neighbours,
)
from dicflow.core.correlation.subsets import Correlated, OwnSubsets, Subset, correlate
from dicflow.core.correlation.warp import TERMS, recentred
from dicflow.core.nearest import nearest
from dicflow.core.parts import Parts, are_apart, single_part
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.status import Status

__all__ = ["Field", "correlate_field", "sigma_by_residual"]


_STRIDES = (8, 4, 2, 1)
"""Spacings of the grids [points]."""
_MAX_TRIES, _MAX_REPAIRS = 3, 3
_MIN_RATIOS, _CONTRACTION_QUANTILE = 20, 0.95
"""Points that fix the contraction, and the quantile of theirs that it is."""
_FINAL_STATUSES = (Status.CUT_SUBSET, Status.LOW_TEXTURE)
"""A point with one of these is not tried again: the reason does not depend on the start."""


class Field(NamedTuple):
    """Correlated subsets on a grid.

    warp : (rows, cols, 2, 3 or 6) float64 — NaN where a subset was not found
    znssd : (rows, cols) float64; iterations : (rows, cols) int16; status : (rows, cols) uint8
    covariance : (rows, cols, 3) float64; texture : (rows, cols, 2) float64 — see
        :class:`dicflow.core.correlation.subsets.Correlated`
    """

    warp: Array
    znssd: Array
    iterations: Iterations
    status: Codes
    covariance: Array
    texture: Array


def sigma_by_residual(field: Field, at: tuple[Index, ...]) -> Array:
    """Standard deviations (n,) of the places of points of a field by white noise as strong as their residual [px]."""
    residual = np.maximum(field.znssd[at], 0.0) * field.texture[at][:, 0]
    return np.asarray(np.sqrt(0.5 * residual * (field.covariance[at][:, 0] + field.covariance[at][:, 2])))


def correlate_field(
    reference: OwnSubsets,
    target: Spline,
    grid: Array,
    starts: Array,
    subset: Subset,
    *,
    max_znssd: float = 0.6,
    threads: int = 1,
    parts: Parts | None = None,
) -> Field:
    """Find a grid of subsets in the target.

    reference : the subsets of the reference photograph
    grid : (rows, cols, 2) — centres, whole pixels of the reference photograph; NaN outside the region
    starts : (rows, cols, 2, 3) — affine warps to start from, right to a few pixels; NaN where unknown
    max_znssd : a subset that fits worse is not found and gets the status LOW_CORRELATION
    parts : of the grid; a point starts from neighbours of its own part only. None for a single part

    Points with neither a start nor a neighbour that was found stay UNTRACKED.
    """
    search = _FieldSearch(
        reference,
        target,
        grid,
        single_part(grid) if parts is None else parts,
        subset,
        max_znssd,
        threads,
        _untracked_field(grid, subset),
        np.zeros(grid.shape[:2]),
        np.ones(grid.shape[:2], dtype=bool),
    )
    for stride in _STRIDES:
        search.fill(stride, starts)
        search.update_contraction()
    search.repair()
    return search.field


@dataclasses.dataclass
class _FieldSearch:
    """A search that fills ``field``.

    tries : (rows, cols) — how often each point was searched for
    changed : (rows, cols) — points that were searched for, or lost, since outliers were last looked for
    ratios : last increment over the one before, of the points so far
    contraction : estimate from ``ratios`` for the next points, 1 until there are enough
    """

    reference: OwnSubsets
    target: Spline
    grid: Array
    parts: Parts
    subset: Subset
    max_znssd: float
    threads: int
    field: Field
    tries: Array
    changed: Mask
    ratios: list[Array] = dataclasses.field(default_factory=list)
    contraction: float = 1.0

    def fill(self, stride: int, starts: Array) -> None:
        """Find the points on every ``stride``-th row and column that have a start or a neighbour that was found."""
        lattice = (slice(None, None, stride),) * 2
        status, tries, inside = self.field.status[lattice], self.tries[lattice], np.isfinite(self.grid[..., 0])[lattice]
        points = stride * np.argwhere(status == Status.UNTRACKED)
        self.correlate_points(points, self.starting_warps(points, stride, starts))
        newly_found = status == Status.VALID
        while newly_found.any():
            found_before = status == Status.VALID
            lost = inside & ~found_before & ~np.isin(status, _FINAL_STATUSES) & (tries < _MAX_TRIES)
            points = stride * np.argwhere(lost & _dilated(newly_found))
            self.correlate_points(points, self.predicted_warps(points, stride))
            newly_found = (status == Status.VALID) & ~found_before

    def starting_warps(self, points: Index, stride: int, starts: Array) -> Array:
        """Warps (n, 2, 3 or 6) of points (n, 2): by neighbours, or else the start there, or the nearest one."""
        warps = self.predicted_warps(points, stride)
        unknown = np.isnan(warps[:, 0, 0])
        warps[unknown] = 0.0
        warps[unknown, :, :3] = starts[tuple(points[unknown].T)]
        unknown = np.isnan(warps[:, 0, 0])
        warps[unknown, :, :3] = _nearest(starts, self.grid, self.parts, points[unknown], stride)
        return warps

    def correlate_points(self, points: Index, starts: Array) -> None:
        """Correlate points (n, 2) of the grid from warps (n, 2, 3 or 6), except where these are NaN."""
        known = all_finite(starts, 2)
        rows, cols = points[known].T
        found = correlate(
            self.reference.template,
            self.target,
            self.grid[rows, cols],
            starts[known],
            self.subset,
            self.threads,
            self.contraction,
            self.reference.sums,
        )
        self.ratios.append(found.contraction[np.isfinite(found.contraction)])
        self.tries[rows, cols] += 1
        self.changed[rows, cols] = True
        found = self._without_bad_fits(found)
        for name, kept in self.field._asdict().items():
            kept[rows, cols] = getattr(found, name)

    def repair(self) -> None:
        """Find lost points and outliers from what their neighbours predict, as long as that finds any."""
        self.lose_outliers()
        for _ in range(_MAX_REPAIRS):
            status = self.field.status
            inside = np.isfinite(self.grid[..., 0])
            points = np.argwhere(inside & (status != Status.VALID) & ~np.isin(status, _FINAL_STATUSES))
            predicted = self.predicted(points)
            self.correlate_points(points, predicted.warp)
            self.lose_outliers()
            if not (self.field.status[tuple(points.T)] == Status.VALID).any():
                break

    def lose_outliers(self) -> None:
        """Take their value from points that do not move as their neighbours do."""
        field, at = self.field, np.nonzero((self.field.status == Status.VALID) & influenced(self.changed))
        away = disagreeing(field.warp[at][..., 0], sigma_by_residual(field, at), self.predicted(np.stack(at, axis=1)))
        rows, cols = (index[away] for index in at)
        field.status[rows, cols] = Status.OUTLIER
        field.warp[rows, cols], field.covariance[rows, cols] = np.nan, np.nan
        self.changed[:] = False
        self.changed[rows, cols] = True

    def predicted(self, points: Index) -> Prediction:
        """What the neighbours of points (n, 2) say of them."""
        field = self.field
        return predicted_by_neighbours(points, field.status, field.warp, self.grid, self.parts, self.threads)

    def update_contraction(self) -> None:
        """Estimate the contraction once, from the points so far, as soon as there are enough."""
        ratios = np.concatenate(self.ratios)
        if self.contraction == 1.0 and len(ratios) >= _MIN_RATIOS:
            self.contraction = min(1.0, float(np.quantile(ratios, _CONTRACTION_QUANTILE)))

    def _without_bad_fits(self, found: Correlated) -> Correlated:
        """The results, with the status LOW_CORRELATION and no value for subsets that fit badly."""
        bad = (found.status == Status.VALID) & ~(found.znssd <= self.max_znssd)
        found.status[bad] = Status.LOW_CORRELATION
        found.warp[bad] = np.nan
        found.covariance[bad] = np.nan
        return found

    def predicted_warps(self, points: Index, stride: int) -> Array:
        """Warps (n, 2, 3 or 6) of points (n, 2) from their eight neighbours ``stride`` away; NaN without any."""
        field = self.field
        return mean_of_neighbours(points, field.status, field.warp, self.grid, self.parts, field.znssd, stride)


def _untracked_field(grid: Array, subset: Subset) -> Field:
    shape = grid.shape[:2]
    status = np.where(all_finite(grid), Status.UNTRACKED, Status.OUTSIDE).astype(np.uint8)
    return Field(
        np.full((*shape, 2, TERMS[subset.shape_function]), np.nan),
        np.full(shape, np.nan),
        np.zeros(shape, dtype=np.int16),
        status,
        np.full((*shape, 3), np.nan),
        np.full((*shape, 2), np.nan),
    )


def _nearest(starts: Array, grid: Array, parts: Parts, points: Index, stride: int) -> Array:
    """Warps (n, 2, 3) by the start nearest to each point (n, 2); NaN where it is over half a stride away, or apart."""
    warps = np.full((len(points), 2, 3), np.nan)
    with_start = np.argwhere(np.isfinite(starts[..., 0, 0]))
    if not len(points) or not len(with_start):
        return warps
    index = nearest(with_start, points)[1][:, 0]
    known = np.abs(points - with_start[index]).max(axis=1) <= stride / 2
    here, there = tuple(points[known].T), tuple(with_start[index[known]].T)
    warps[known] = recentred(starts[there], grid[here] - grid[there])
    if not parts.is_single:
        apart = [
            are_apart(parts, *one, *other) for one, other in zip(points[known], with_start[index[known]], strict=True)
        ]
        warps[np.flatnonzero(known)[apart]] = np.nan
    return warps


def _dilated(mask: Mask) -> Mask:
    """The mask grown by one point in all eight directions."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), np.ones((3, 3), dtype=np.uint8)) > 0, dtype=np.bool_)
