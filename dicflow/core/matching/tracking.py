"""Subsets of a region followed from one image to the next, and all of its points with them.

Each subset has one plane transform from the matches in it. Between the subsets' centres the carried positions are
blended by bilinear weights, a partition of unity, so that what is carried stays continuous.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dicflow.core.arrays import Array, Mask
from dicflow.core.matching.pairs import consistent, local_motion
from dicflow.core.matching.transform import TransformKind, apply_transform, estimate_transform, jacobian, msac
from dicflow.core.photographs.region import Polygon, contains

__all__ = ["SubsetGrid", "Tracked", "carry_points", "follow_matches", "nearest_subset", "subset_grid", "track_subsets"]


AREA_CHANGE = 3.0  # a subset whose area changes by this factor more, or less, than that of the others is wrong
ENOUGH = 12  # matches below which nothing can be said about deviations
PROBES = 32  # points per side of a subset that tell whether the region reaches into it


class SubsetGrid(NamedTuple):
    """A regular grid of subsets.

    x : (cols,) float64 — centres [px]
    y : (rows,) float64 — centres [px]
    half_width_px, half_height_px : half the sides of one subset, its overlap included
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
        """Which points (n, 2) lie in a subset, overlap included."""
        dx, dy = np.abs(points[:, 0] - self.x[column]), np.abs(points[:, 1] - self.y[row])
        return np.asarray((dx <= self.half_width_px) & (dy <= self.half_height_px))


class Tracked(NamedTuple):
    """Transforms of all subsets, arrays of (rows, cols, …).

    transforms : (rows, cols, 3, 3) float64 — from the reference to the deformed image [px]
    features, matches, inliers : int32 — reference features, matches and matches that the transform fits, in the region
    residual_px : root mean square transfer error of the inliers; NaN in filled and empty subsets
    filled : the transform is that of the matches around the subset
    empty : no part of the region is in the subset
    """

    transforms: Array
    features: npt.NDArray[np.int32]
    matches: npt.NDArray[np.int32]
    inliers: npt.NDArray[np.int32]
    residual_px: Array
    filled: Mask
    empty: Mask


def subset_grid(box: tuple[float, float, float, float], shape: tuple[int, int], overlap: float) -> SubsetGrid:
    """Divide a box (x0, y0, x1, y1) [px] into rows × columns of subsets.

    overlap : share of its own size by which each side of a subset reaches into the next one, 0 … 1
    """
    x0, y0, x1, y1 = box
    rows, columns = shape
    cell = np.array([(x1 - x0) / columns, (y1 - y0) / rows])
    half = cell * (0.5 + overlap)
    x = x0 + (np.arange(columns) + 0.5) * cell[0]
    y = y0 + (np.arange(rows) + 0.5) * cell[1]
    return SubsetGrid(x, y, float(half[0]), float(half[1]), cell)


def track_subsets(
    grid: SubsetGrid,
    polygons: Sequence[Polygon],
    source: Array,
    target: Array,
    features: Array,
    *,
    kind: TransformKind = "projective",
    threshold_px: float = 1.5,
    confidence: float = 0.99,
    min_inliers: int = 8,
    seed: int = 0,
) -> Tracked | None:
    """Transform of each subset from the matches inside it and the region.

    source, target : (m, 2) — matches [px]
    features : (n, 2) — all features of the reference image [px]
    min_inliers : a subset with fewer is filled from its neighbours
    Returns None where no subset has a transform.
    """
    inside = contains(polygons, source)
    source, target = source[inside], target[inside]
    features = features[contains(polygons, features)]
    shape = grid.shape
    transforms, residual = np.full((*shape, 3, 3), np.nan), np.full(shape, np.nan)
    counts = np.zeros((3, *shape), dtype=np.int32)
    kept = np.zeros((*shape, len(source)), dtype=bool)
    for row, column in np.ndindex(*shape):
        here = np.flatnonzero(grid.members(row, column, source))
        found = msac(
            kind, source[here], target[here],
            threshold_px=threshold_px, confidence=confidence, seed=(seed, row, column),
        )  # fmt: skip
        number = int(found.inliers.sum())
        counts[:, row, column] = grid.members(row, column, features).sum(), len(here), number
        if number >= min_inliers:
            transforms[row, column], residual[row, column] = found.transform, found.residual_px
            kept[row, column, here[found.inliers]] = True
    sound = _sound(grid, transforms)
    if not sound.any():
        return None
    transforms[~sound], residual[~sound] = _from_neighbours(sound, kept, source, target), np.nan
    empty = _empty(grid, polygons)
    return Tracked(transforms, counts[0], counts[1], counts[2], residual, ~sound & ~empty, empty)


def carry_points(grid: SubsetGrid, transforms: Array, points: Array, *, blend: bool = True) -> Array:
    """Carry points (..., 2) [px]; each by the transforms of the nearest subsets, blended, or by its own subset's alone.

    Outside the outermost centres the outermost transforms hold.
    """
    flat = points.reshape(-1, 2)
    (j, u), (i, v) = _place(grid.x, flat[:, 0]), _place(grid.y, flat[:, 1])
    if not blend:
        u, v = np.rint(u), np.rint(v)
    rows, columns = grid.shape
    carried = np.zeros_like(flat)
    for di, dj in np.ndindex(2, 2):
        weight = (u if dj else 1 - u) * (v if di else 1 - v)
        own = transforms[np.minimum(i + di, rows - 1), np.minimum(j + dj, columns - 1)]
        carried += np.where(weight > 0, weight, 0)[:, None] * apply_transform(own, flat[:, None])[:, 0]
    return carried.reshape(points.shape)


def follow_matches(grid: SubsetGrid, transforms: Array, source: Array, target: Array, points: Array) -> Array:
    """Carry points (..., 2) [px] by the blended transforms and by what the matches around each deviate from these.

    source, target : (m, 2) — matches [px]; those that move unlike their neighbours are left out

    A plane transform per subset misses what varies inside the subset, such as a neck; the matches do not.
    """
    keep = consistent(source, target)
    source, deviation = source[keep], target[keep] - carry_points(grid, transforms, source[keep])
    flat, carried = points.reshape(-1, 2), carry_points(grid, transforms, points)
    exist = np.flatnonzero(np.isfinite(flat).all(axis=1))
    if len(source) >= ENOUGH and len(exist):
        local = local_motion(source, source + deviation, flat[exist]).position - flat[exist]
        carried.reshape(-1, 2)[exist] += local
    return carried


def nearest_subset(grid: SubsetGrid, points: Array) -> tuple[npt.NDArray[np.intp], npt.NDArray[np.intp]]:
    """Row and column (each (...)) of the subset whose centre is nearest to each point (..., 2)."""
    (j, u), (i, v) = _place(grid.x, points[..., 0]), _place(grid.y, points[..., 1])
    rows, columns = grid.shape
    row = np.minimum(i + np.rint(v).astype(np.intp), rows - 1)
    return row, np.minimum(j + np.rint(u).astype(np.intp), columns - 1)


def _place(centres: Array, values: Array) -> tuple[npt.NDArray[np.intp], Array]:
    """Index of the centre before each value, and the share of the way to the next one, both within the centres."""
    if len(centres) == 1:
        return np.zeros(values.shape, dtype=np.intp), np.zeros(values.shape)
    steps = np.nan_to_num((values - centres[0]) / (centres[1] - centres[0]))
    steps = np.clip(steps, 0, len(centres) - 1)
    index = np.minimum(steps.astype(np.intp), len(centres) - 2)
    return index, steps - index


def _sound(grid: SubsetGrid, transforms: Array) -> Mask:
    """Subsets whose transform neither folds nor changes the area unlike the others.

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
    return np.asarray((change > max(usual, 0) / AREA_CHANGE).all(axis=-1) & (change < usual * AREA_CHANGE).all(axis=-1))


def _from_neighbours(sound: Mask, kept: Mask, source: Array, target: Array) -> Array:
    """Transforms (n, 3, 3) of the subsets that have none: affine, by the inliers of the nearest ring of sound ones.

    kept : (rows, cols, m) — inliers of each subset
    """
    rows, columns = np.indices(sound.shape)
    found = []
    for row, column in np.argwhere(~sound):
        ring = np.maximum(abs(rows - row), abs(columns - column))
        nearest = ring == ring[sound].min()
        pooled = kept[nearest & sound].any(axis=0)
        found.append(estimate_transform("affine", source[pooled], target[pooled]))
    return np.array(found).reshape(-1, 3, 3)


def _empty(grid: SubsetGrid, polygons: Sequence[Polygon]) -> Mask:
    """Subsets, without overlap, that the region does not reach into."""
    share = (np.arange(PROBES) + 0.5) / PROBES - 0.5
    x = (grid.x[:, None] + share * grid.cell_px[0]).ravel()
    y = (grid.y[:, None] + share * grid.cell_px[1]).ravel()
    covered: npt.NDArray[Any] = contains(polygons, np.stack(np.meshgrid(x, y), axis=-1))
    return ~np.asarray(covered.reshape(len(grid.y), PROBES, len(grid.x), PROBES).any(axis=(1, 3)))
