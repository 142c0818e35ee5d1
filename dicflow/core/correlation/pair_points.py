"""Points of a scene that both photographs of one moment show, for a rig that may not fit them.

Features give start values, so that no epipolar line is needed; where they fail, partners along the epipolar lines of
the rig as it is do. Subsets of the left photograph, side by side, are then found in the right one. Since they share no
pixels, the errors of the points are independent, as far as noise causes them.
"""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array, Grey, all_finite
from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.relative_orientation import MatchedPoints
from dicflow.core.correlation.edges import residual_variance
from dicflow.core.correlation.judgement import judge
from dicflow.core.correlation.partners import find_partners
from dicflow.core.correlation.search import Search, correlate_points, first_photograph, target_spline
from dicflow.core.correlation.seed import MIN_EPIPOLAR_PAIRS, Pairs, feature_pairs, seed_warps
from dicflow.core.correlation.subsets import Subset
from dicflow.core.matching.pairs import agreeing_matches
from dicflow.core.nearest import nearest
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.photographs.noise import ROUNDING_NOISE, residual_noise
from dicflow.core.status import Status

__all__ = ["pair_points"]

_WINDOW = 1.5
"""Side of the windows compared along epipolar lines, in subsets."""
_REACH = 2.0
"""Largest distance of a point from a pair of features, in subsets."""
_UNKNOWN = 1.0


def pair_points(rig: Rig, left: Photograph, right: Photograph, subset_size: int, threads: int = 1) -> MatchedPoints:
    """Points of the left photograph found in the right one.

    rig : the cameras as they were once
    subset_size : side of the subsets, which lie side by side [px]
    threads : how many share the points
    Without points where the photographs do not show the same.
    """
    grid = _grid(left.grey.shape, subset_size)
    pairs = _pairs(rig, left.grey, right.grey, grid, subset_size)
    if len(pairs.source) == 0:
        return MatchedPoints(*np.zeros((2, 0, 2)), *np.zeros((2, 0, 3)))
    far = nearest(pairs.source, grid.reshape(-1, 2))[0].reshape(grid.shape[:2]) > _REACH * subset_size
    grid[far] = np.nan
    starts = seed_warps(left.grey, right.grey, grid, pairs)
    search = Search(Subset(subset_size, "quadratic"), threads=threads, counts_misfit=True)
    first = first_photograph(left, np.ones(left.grey.shape, dtype=bool), grid, search)
    correlation = correlate_points(first, target_spline(right, search), starts, search)
    valid = correlation.field.status == Status.VALID
    noise = residual_noise(residual_variance(correlation.field)[valid], search.degree) if valid.any() else _UNKNOWN
    found = judge(first, correlation, search._replace(noise=max(noise, ROUNDING_NOISE)))
    kept = found.valid & all_finite(found.covariance + found.template_covariance)
    return MatchedPoints(grid[kept], found.warp[..., 0][kept], found.template_covariance[kept], found.covariance[kept])


def _grid(shape: tuple[int, ...], subset_size: int) -> Array:
    """Centres (rows, cols, 2) of subsets side by side."""
    half = subset_size // 2
    y, x = np.mgrid[half : shape[0] - half : subset_size, half : shape[1] - half : subset_size]
    return np.stack([x, y], axis=-1).astype(float)


def _pairs(rig: Rig, left: Grey, right: Grey, grid: Array, subset_size: int) -> Pairs:
    """Matched features, or partners along the epipolar lines where these are few."""
    found = feature_pairs(left, right, grid)
    keep = agreeing_matches(*found)
    if keep.sum() >= MIN_EPIPOLAR_PAIRS:
        return Pairs(found.source[keep], found.target[keep])
    return Pairs(*find_partners(rig, left, right, grid.reshape(-1, 2), _WINDOW * subset_size))
