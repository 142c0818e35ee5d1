"""Pairs of features that show the same material point in two images."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.kernels import KERNEL
from dicflow.core.matching.features import Descriptors, Features
from dicflow.core.matching.transform import MINIMUM_PAIRS, apply_transform, msac
from dicflow.core.nearest import nearest

__all__ = [
    "LocalMotion",
    "Seen",
    "agreeing_matches",
    "consistent_matches",
    "guided_matches",
    "local_motion",
    "match_features",
]

Pairs = Index
Seen = Callable[[Index, Index], Mask]
"""Which matches count at points: numbers of points and of matches, two arrays that broadcast → whether they do."""

NEIGHBOURS = 24  # matches around a point from which its motion is estimated
_MAX_COLLINEAR_RATIO = 1e-6  # variance across over variance along below which neighbours are collinear
_CANDIDATES = 4  # times as many matches are looked at where not all count
_MIN_SEEN = 3  # matches determine an affine transform
DESCRIPTORS_PER_BLOCK = 512  # descriptors compared at once with all others, so that their distances fit into the cache
CANDIDATES = 8  # nearest features to a predicted position that are compared


class LocalMotion(NamedTuple):
    """Motion at points, from the matches around them.

    position : (n, 2) float64 — of the points in the deformed image [px]
    gradient : (n, 2, 2) float64 — ∂(deformed)/∂(reference) there
    """

    position: Array
    gradient: Array


def match_features(reference: Features, deformed: Features, *, ratio: float = 0.8, mutual: bool = True) -> Pairs:
    """Pairs of indices (m, 2) of features that are each other's nearest by descriptor, in order of the reference.

    ratio : nearest distance over the second nearest, at most (Lowe, Int. J. Computer Vision 60, 2004)
    mutual : the reference feature must also be the nearest one of its partner
    """
    if len(reference.xy) == 0 or len(deformed.xy) < 2:
        return np.zeros((0, 2), dtype=np.intp)
    distance, nearest = _nearest(reference.descriptors, deformed.descriptors, 2)
    chosen = np.flatnonzero(distance[:, 0] < ratio * distance[:, 1])
    partner = nearest[chosen, 0]
    if mutual and len(chosen):
        _, back = _nearest(deformed.descriptors[partner], reference.descriptors, 1)
        chosen, partner = chosen[back[:, 0] == chosen], partner[back[:, 0] == chosen]
    return np.stack([chosen, partner], axis=1)


def guided_matches(
    reference: Features, deformed: Features, predicted: Array, *, radius_px: float = 4.0, ratio: float = 0.95
) -> Pairs:
    """Pairs of indices (m, 2) of features that are each other's nearest among those near the predicted positions.

    predicted : (n, 2) — where each reference feature is expected in the deformed image, NaN where unknown [px]
    radius_px : radius of the search around the predicted position [px]
    ratio : as in :func:`match_features`, among the candidates only; a single candidate is accepted
    """
    if len(reference.xy) == 0 or len(deformed.xy) == 0:
        return np.zeros((0, 2), dtype=np.intp)
    known = np.isfinite(predicted).all(axis=1)
    candidate = np.full((len(predicted), min(CANDIDATES, len(deformed.xy))), len(deformed.xy))
    distance, near = nearest(deformed.xy.astype(float), predicted[known], candidate.shape[1])
    candidate[known] = np.where(distance < radius_px, near, len(deformed.xy))
    row, column = np.nonzero(candidate < len(deformed.xy))
    partner = candidate[row, column]
    distance = _distances(reference.descriptors[row], deformed.descriptors[partner])
    table = np.full(candidate.shape, np.inf)
    table[row, column] = distance
    ranked = np.sort(table, axis=1)
    chosen = np.flatnonzero(np.isfinite(ranked[:, 0]) & (ranked[:, 0] <= ratio * ranked[:, 1]))
    partner = candidate[chosen, table[chosen].argmin(axis=1)]
    best = np.full(len(deformed.xy), np.inf)
    np.minimum.at(best, partner, ranked[chosen, 0])
    mutual = ranked[chosen, 0] <= best[partner]
    _, first = np.unique(partner[mutual], return_index=True)
    order = np.sort(first)
    return np.stack([chosen[mutual][order], partner[mutual][order]], axis=1)


def consistent_matches(source: Array, target: Array, *, tolerance_px: float = 2.0, seed: int = 0) -> Mask:
    """Which matches have the motion of their neighbours, (n,) bool; all where they are too few to compare.

    source, target : (n, 2) [px]
    tolerance_px : deviation from the median motion of the neighbours that is always allowed [px]

    Motion is taken relative to the affine transform that most matches fit. A match is consistent where it differs from
    the median of its neighbours by at most the tolerance plus twice their median deviation (after Westerweel and
    Scarano, Experiments in Fluids 39, 2005).
    """
    if len(source) <= NEIGHBOURS:
        return np.ones(len(source), dtype=bool)
    overall = msac("affine", source, target, threshold_px=0.1 * float(np.ptp(source, axis=0).max()), seed=seed)
    deviation = target - apply_transform(overall.transform, source)
    keep = overall.inliers
    for _ in range(2):
        if keep.sum() <= NEIGHBOURS:
            break
        _, near = nearest(source[keep], source, NEIGHBOURS + 1)
        around = deviation[keep][near[:, 1:]]
        usual = np.median(around, axis=1)
        spread = np.median(np.linalg.norm(around - usual[:, None], axis=2), axis=1)
        keep = np.linalg.norm(deviation - usual, axis=1) <= tolerance_px + 2 * spread
    return keep


def agreeing_matches(source: Array, target: Array, *, threshold_px: float = 4.0) -> Mask:
    """Which matches agree: by :func:`consistent_matches` where they are many, else with an affine transform, (n,) bool.

    source, target : (n, 2) [px]
    threshold_px : largest distance from the affine transform that most matches fit [px]
    """
    if len(source) > NEIGHBOURS:
        return consistent_matches(source, target)
    if len(source) <= MINIMUM_PAIRS["affine"]:
        return np.ones(len(source), dtype=bool)
    return msac("affine", source, target, threshold_px=threshold_px).inliers


def local_motion(source: Array, target: Array, points: Array, seen: Seen | None = None) -> LocalMotion:
    """Motion at points by moving least squares: an affine transform of the nearest matches, weighted by distance.

    source, target : (m, 2) — correct matches, m at least 3 [px]
    points : (n, 2) — in the reference image [px]
    seen : which matches count at which points; all if absent. Where fewer than 3 of those around a point do, the
        position is NaN, and the gradient the identity

    The weight (1 − d²/d_max²)² vanishes at the farthest neighbour, so that the motion is continuous (Lancaster and
    Salkauskas, Mathematics of Computation 37, 1981). Where the neighbours are collinear, the gradient is estimated
    along their line only.
    """
    distance, neighbours = _neighbours(source, points, seen)
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.nan_to_num((1 - (distance / distance[:, -1:]) ** 2) ** 2, nan=1.0)
    weight = np.where(weight.sum(axis=1, keepdims=True) > 0, weight, 1.0)
    weight /= weight.sum(axis=1, keepdims=True)
    centre, mean_motion, spread, mixed = _moments(source, target - source, neighbours, weight)
    slope = mixed @ _pseudo_inverse(spread)
    position = points + mean_motion + (slope @ (points - centre)[..., None])[..., 0]
    unknown = np.isnan(distance[:, -1])
    position[unknown], slope[unknown] = np.nan, 0.0
    return LocalMotion(position, slope + np.eye(2))


def _neighbours(source: Array, points: Array, seen: Seen | None) -> tuple[Array, Index]:
    """Distances and numbers (n, k) of the matches nearest to each point, of those that count there.

    Where there are fewer, others fill up the row, at the distance of the farthest that counts, so that their weight
    vanishes. Distances are NaN where fewer than 3 count.
    """
    count = min(NEIGHBOURS + 1, len(source))
    if seen is None:
        return nearest(source, points, count)
    distance, near = nearest(source, points, min(_CANDIDATES * count, len(source)))
    counts = seen(np.arange(len(points))[:, None], near)
    order = np.argsort(~counts, axis=1, kind="stable")[:, :count]
    counts = np.take_along_axis(counts, order, axis=1)
    distance, near = np.take_along_axis(distance, order, axis=1), np.take_along_axis(near, order, axis=1)
    farthest = np.where(counts, distance, 0.0).max(axis=1, keepdims=True)
    farthest[counts.sum(axis=1) < _MIN_SEEN] = np.nan
    return np.where(counts, distance, farthest) + 0.0 * farthest, near


@njit(**KERNEL)
def _moments(places: Array, motions: Array, near: Index, weight: Array) -> tuple[Array, Array, Array, Array]:
    """Weighted moments of the neighbours of n points.

    places, motions : (m, 2); near : (n, k) — indices of the neighbours; weight : (n, k)
    Returns the means of places and motions (n, 2), the second central moments of the places (n, 2, 2), and the mixed
    ones of motion and place (n, 2, 2).
    """
    count = len(near)
    centre, mean = np.zeros((count, 2)), np.zeros((count, 2))
    spread, mixed = np.zeros((count, 2, 2)), np.zeros((count, 2, 2))
    for n in range(count):
        for k in range(near.shape[1]):
            for i in range(2):
                centre[n, i] += weight[n, k] * places[near[n, k], i]
                mean[n, i] += weight[n, k] * motions[near[n, k], i]
        for k in range(near.shape[1]):
            for j in range(2):
                lever = weight[n, k] * (places[near[n, k], j] - centre[n, j])
                for i in range(2):
                    spread[n, i, j] += lever * (places[near[n, k], i] - centre[n, i])
                    mixed[n, i, j] += lever * (motions[near[n, k], i] - mean[n, i])
    return centre, mean, spread, mixed


def _pseudo_inverse(matrix: Array) -> Array:
    """Pseudo-inverses of positive semidefinite matrices (n, 2, 2)."""
    a, b, c = matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 1]
    apart = np.hypot(0.5 * (a - c), b)
    large = 0.5 * (a + c) + apart
    small = (a * c - b * b) / np.where(large > 0.0, large, 1.0)
    is_line = small <= _MAX_COLLINEAR_RATIO * large
    scale = np.where(is_line, 2.0 * apart * large, small * large)
    adjugate = np.stack([c, -b, -b, a], axis=-1).reshape(-1, 2, 2)
    along = matrix - (small[:, None, None] * np.eye(2))
    chosen = np.where(is_line[:, None, None], along, adjugate)
    return np.asarray(chosen * np.where(scale > 0.0, 1.0 / np.where(scale > 0.0, scale, 1.0), 0.0)[:, None, None])


def _nearest(queries: Descriptors, others: Descriptors, count: int) -> tuple[Array, Pairs]:
    """Distances and indices (n, count) of the nearest descriptors: number of different bits, or Euclidean distance."""
    if queries.dtype == np.uint8:
        distance, index = cv2.batchDistance(queries, others, cv2.CV_32S, normType=cv2.NORM_HAMMING, K=count)
        return distance.astype(np.float64), index.astype(np.intp)
    blocks = [
        _nearest_euclidean(queries[k : k + DESCRIPTORS_PER_BLOCK], others, count)
        for k in range(0, len(queries), DESCRIPTORS_PER_BLOCK)
    ]
    index = np.concatenate(blocks)
    return np.stack([_distances(queries, others[column]) for column in index.T], axis=1), index


def _nearest_euclidean(queries: Descriptors, others: Descriptors, count: int) -> Pairs:
    """Indices (n, count) of the nearest descriptors by |o|² − 2 q·o, one matrix product instead of n² differences.

    Its rounding errors are relative to the squared descriptors: good enough to rank, not for the distances themselves.
    """
    table = np.einsum("ij,ij->i", others, others) - 2.0 * (queries @ others.T)
    rows, index = np.arange(len(queries)), np.empty((len(queries), count), dtype=np.intp)
    for rank in range(count):
        index[:, rank] = table.argmin(axis=1)
        table[rows, index[:, rank]] = np.inf
    return index


def _distances(a: Descriptors, b: Descriptors) -> Array:
    """Distance of each descriptor from the one in the same row, (n,)."""
    if a.dtype == np.uint8:
        return np.asarray(np.bitwise_count(a ^ b).sum(axis=1), dtype=np.float64)
    return np.asarray(np.linalg.norm(a - b, axis=1), dtype=np.float64)
