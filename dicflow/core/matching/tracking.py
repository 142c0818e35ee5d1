"""Transforms of the subsets of a region from one image to the next, and the motion of its points.

Each subset has one plane transform from the matches in it. Between the subsets' centres the transformed positions are
blended by bilinear weights, a partition of unity, so that the motion is continuous.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Counts, Index, Mask
from dicflow.core.matching.pairs import Seen, consistent_matches, local_motion
from dicflow.core.matching.transform import TransformKind, apply_transform, estimate_transform, jacobian, msac
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import contains

__all__ = [
    "Deviations",
    "SubsetGrid",
    "TrackedSubsets",
    "carry_points",
    "deviations",
    "follow_matches",
    "nearest_subset",
    "subset_grid",
    "track_subsets",
    "unknown_subsets",
]


MAX_AREA_CHANGE_RATIO = 3.0  # limit of a subset's change of area over the median change, or the reverse
MIN_MATCHES_FOR_DEVIATIONS = 12
PROBES_PER_SIDE = 32  # points per side of a subset at which it is tested whether the region reaches into it


class SubsetGrid(NamedTuple):
    """A regular grid of subsets.

    x : (cols,) float64 — centres [px]
    y : (rows,) float64 — centres [px]
    half_width_px, half_height_px : half the sides of one subset, including its overlap
    cell_px : (2,) float64 — width and height of one subset without overlap
    """

    x: Array
    y: Array
    half_width_px: float
    half_height_px: float
    cell_px: Array

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        return len(self.y), len(self.x)

    def members(self, row: int, column: int, points: Array) -> Mask:
        """Which points (n, 2) lie in a subset, including its overlap."""
        dx, dy = np.abs(points[:, 0] - self.x[column]), np.abs(points[:, 1] - self.y[row])
        return np.asarray((dx <= self.half_width_px) & (dy <= self.half_height_px))


class TrackedSubsets(NamedTuple):
    """Transforms of all subsets, arrays of (rows, cols, …).

    transforms : (rows, cols, 3, 3) float64 — from the reference to the deformed image [px]
    features, matches, inliers : int32 — numbers of reference features, of matches, and of inliers of the transform, in
        the region
    residual_px : root mean square transfer error of the inliers; NaN in filled and empty subsets
    filled : whether the transform is estimated from the matches of neighbouring subsets
    empty : whether the subset holds no part of the region
    """

    transforms: Array
    features: Counts
    matches: Counts
    inliers: Counts
    residual_px: Array
    filled: Mask
    empty: Mask


def unknown_subsets(shape: tuple[int, int]) -> TrackedSubsets:
    """Subsets (rows, cols) of unknown motion."""
    none, no = np.zeros(shape, dtype=np.int32), np.zeros(shape, dtype=bool)
    return TrackedSubsets(np.full((*shape, 3, 3), np.nan), none, none, none, np.full(shape, np.nan), no, no)


def subset_grid(box: tuple[float, float, float, float], shape: tuple[int, int], overlap: float) -> SubsetGrid:
    """Divide a box (x0, y0, x1, y1) [px] into rows × columns of subsets.

    overlap : share of its size by which a subset reaches into its neighbour on each side, 0 … 1
    """
    x0, y0, x1, y1 = box
    rows, columns = shape
    cell = np.array([(x1 - x0) / columns, (y1 - y0) / rows])
    half = cell * (0.5 + overlap)
    x = x0 + (np.arange(columns) + 0.5) * cell[0]
    y = y0 + (np.arange(rows) + 0.5) * cell[1]
    return SubsetGrid(x, y, float(half[0]), float(half[1]), cell)


class Estimation(NamedTuple):
    """How the transform of a subset is estimated from its matches by MSAC.

    threshold_px : distance from which a match counts as wrong [px]
    confidence : probability that one of the random samples has no wrong match
    min_inliers : a subset with fewer is filled from its neighbours
    seed : of the random samples
    """

    kind: TransformKind = "projective"
    threshold_px: float = 1.5
    confidence: float = 0.99
    min_inliers: int = 8
    seed: int = 0


def track_subsets(
    grid: SubsetGrid,
    polygons: Sequence[Polygon],
    source: Array,
    target: Array,
    features: Array,
    estimation: Estimation,
) -> TrackedSubsets | None:
    """Transform of each subset from the matches inside it and inside the region.

    source, target : (m, 2) — matches [px]
    features : (n, 2) — all features of the reference image [px]
    Returns None where all transforms are missing or implausible.
    """
    inside = contains(polygons, source)
    source, target = source[inside], target[inside]
    features = features[contains(polygons, features)]
    shape = grid.shape
    transforms, residual = np.full((*shape, 3, 3), np.nan), np.full(shape, np.nan)
    counts = np.zeros((3, *shape), dtype=np.int32)
    inliers = np.zeros((*shape, len(source)), dtype=bool)
    for row, column in np.ndindex(*shape):
        inside_subset = np.flatnonzero(grid.members(row, column, source))
        found = msac(
            estimation.kind, source[inside_subset], target[inside_subset], threshold_px=estimation.threshold_px,
            confidence=estimation.confidence, seed=(estimation.seed, row, column),
        )  # fmt: skip
        number = int(found.inliers.sum())
        counts[:, row, column] = grid.members(row, column, features).sum(), len(inside_subset), number
        if number >= estimation.min_inliers:
            transforms[row, column], residual[row, column] = found.transform, found.residual_px
            inliers[row, column, inside_subset[found.inliers]] = True
    plausible = _is_plausible(grid, transforms)
    if not plausible.any():
        return None
    transforms[~plausible], residual[~plausible] = (
        _transforms_from_neighbours(plausible, inliers, source, target),
        np.nan,
    )
    empty = _is_outside_region(grid, polygons)
    return TrackedSubsets(transforms, counts[0], counts[1], counts[2], residual, ~plausible & ~empty, empty)


def carry_points(grid: SubsetGrid, transforms: Array, points: Array, *, blend: bool = True) -> Array:
    """Points (..., 2) [px] after the transforms of the nearest subsets, blended, or of the nearest subset alone.

    Outside the outermost centres the outermost transforms apply.
    """
    flat = points.reshape(-1, 2)
    (j, u), (i, v) = _bracketing_centres(grid.x, flat[:, 0]), _bracketing_centres(grid.y, flat[:, 1])
    if not blend:
        u, v = np.rint(u), np.rint(v)
    rows, columns = grid.shape
    carried = np.zeros_like(flat)
    for di, dj in np.ndindex(2, 2):
        weight = (u if dj else 1 - u) * (v if di else 1 - v)
        own = transforms[np.minimum(i + di, rows - 1), np.minimum(j + dj, columns - 1)]
        carried += np.where(weight > 0, weight, 0)[:, None] * apply_transform(own, flat[:, None])[:, 0]
    return carried.reshape(points.shape)


class Deviations(NamedTuple):
    """Deviations of matches from the blended transforms.

    source : (m, 2) — of the consistent matches [px]
    deviation : (m, 2) [px]
    near : (m, 2) int — row and column of a point of the grid on their side of a cut; None without cuts
    """

    source: Array
    deviation: Array
    near: Index | None


def deviations(
    grid: SubsetGrid, transforms: Array, source: Array, target: Array, near: Index | None = None
) -> Deviations:
    """Deviations of the consistent ones of matches (m, 2) [px]; near : as there, of all matches."""
    keep = consistent_matches(source, target)
    deviation = target[keep] - carry_points(grid, transforms, source[keep])
    return Deviations(source[keep], deviation, None if near is None else near[keep])


def follow_matches(
    grid: SubsetGrid, transforms: Array, deviating: Deviations, points: Array, seen: Seen | None = None
) -> Array:
    """Points (..., 2) [px] after the blended transforms, corrected by the deviation of the matches around each point.

    seen : which matches count at which points, by the numbers of both (..., k); all if absent. A point at which too few
        count is NaN afterwards

    The correction includes motion that varies within a subset, such as a neck, which one plane transform cannot.
    """
    source, deviation, _ = deviating
    flat, carried = points.reshape(-1, 2), carry_points(grid, transforms, points)
    known = np.flatnonzero(np.isfinite(flat).all(axis=1))
    if len(source) >= MIN_MATCHES_FOR_DEVIATIONS and len(known):
        of_known: Seen | None = None if seen is None else lambda rows, matches: seen(known[rows], matches)
        moved = local_motion(source, source + deviation, flat[known], of_known)
        carried.reshape(-1, 2)[known] += moved.position - flat[known]
    return carried


def nearest_subset(grid: SubsetGrid, points: Array) -> tuple[Index, Index]:
    """Row and column (each (...)) of the subset whose centre is nearest to each point (..., 2)."""
    (j, u), (i, v) = _bracketing_centres(grid.x, points[..., 0]), _bracketing_centres(grid.y, points[..., 1])
    rows, columns = grid.shape
    row = np.minimum(i + np.rint(v).astype(np.intp), rows - 1)
    return row, np.minimum(j + np.rint(u).astype(np.intp), columns - 1)


def _bracketing_centres(centres: Array, values: Array) -> tuple[Index, Array]:
    """Index of the centre before each value, and the share of the way to the next one, clipped to the centres."""
    if len(centres) == 1:
        return np.zeros(values.shape, dtype=np.intp), np.zeros(values.shape)
    steps = np.nan_to_num((values - centres[0]) / (centres[1] - centres[0]))
    steps = np.clip(steps, 0, len(centres) - 1)
    index = np.minimum(steps.astype(np.intp), len(centres) - 2)
    return index, steps - index


def _is_plausible(grid: SubsetGrid, transforms: Array) -> Mask:
    """Subsets whose transform does not fold and changes the area about as the others do.

    The local change of area at the centre and corners of the subset must stay within a factor of the median of all.
    """
    x, y = np.meshgrid(grid.x, grid.y)
    offsets = np.array([[0, 0], [-1, -1], [1, -1], [-1, 1], [1, 1]]) * [grid.half_width_px, grid.half_height_px]
    probes = np.stack([x, y], axis=-1)[:, :, None] + offsets
    with np.errstate(all="ignore"):
        change = np.linalg.det(jacobian(transforms, probes))
    exists = np.isfinite(change).all(axis=-1)
    if not exists.any():
        return np.asarray(exists)
    change[~exists] = -1.0
    usual = float(np.median(change[exists, 0]))
    return np.asarray(
        (change > max(usual, 0) / MAX_AREA_CHANGE_RATIO).all(axis=-1)
        & (change < usual * MAX_AREA_CHANGE_RATIO).all(axis=-1)
    )


def _transforms_from_neighbours(plausible: Mask, inliers: Mask, source: Array, target: Array) -> Array:
    """Affine transforms (n, 3, 3) of the implausible subsets, from the inliers of the nearest ring of plausible ones.

    plausible : (rows, cols)
    inliers : (rows, cols, m) — of each subset
    """
    rows, columns = np.indices(plausible.shape)
    transforms = []
    for row, column in np.argwhere(~plausible):
        ring = np.maximum(abs(rows - row), abs(columns - column))
        nearest = ring == ring[plausible].min()
        pooled = inliers[nearest & plausible].any(axis=0)
        transforms.append(estimate_transform("affine", source[pooled], target[pooled]))
    return np.array(transforms).reshape(-1, 3, 3)


def _is_outside_region(grid: SubsetGrid, polygons: Sequence[Polygon]) -> Mask:
    """Subsets, without overlap, that hold no part of the region."""
    share = (np.arange(PROBES_PER_SIDE) + 0.5) / PROBES_PER_SIDE - 0.5
    x = (grid.x[:, None] + share * grid.cell_px[0]).ravel()
    y = (grid.y[:, None] + share * grid.cell_px[1]).ravel()
    covered = contains(polygons, np.stack(np.meshgrid(x, y), axis=-1))
    return ~np.asarray(covered.reshape(len(grid.y), PROBES_PER_SIDE, len(grid.x), PROBES_PER_SIDE).any(axis=(1, 3)))
