"""Plane transforms from point pairs: least squares, and robust estimation with false pairs.

A transform is a 3 × 3 matrix H in homogeneous pixel coordinates, H[2, 2] = 1: x' ~ H (x, y, 1).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Index, Mask

__all__ = [
    "MINIMUM_PAIRS",
    "Consensus",
    "TransformKind",
    "apply_transform",
    "estimate_transform",
    "jacobian",
    "msac",
    "transfer_error",
]

TransformKind = Literal["similarity", "affine", "projective"]

MINIMUM_PAIRS: dict[str, int] = {"similarity": 2, "affine": 3, "projective": 4}
"""Number of point pairs that each kind of transform needs."""

HYPOTHESES_PER_BLOCK = 32  # hypotheses that are evaluated at once
MAX_REFITS = 20  # refits that have not converged by then alternate between two equally good sets of inliers


class Consensus(NamedTuple):
    """Result of the sample consensus.

    transform : (3, 3) float64 — NaN with too few pairs
    inliers : (n,) bool — pairs whose transfer error is below the threshold
    residual_px : root mean square transfer error of the inliers [px]; NaN without inliers
    trials : number of hypotheses that were evaluated
    """

    transform: Array
    inliers: Mask
    residual_px: float
    trials: int


def apply_transform(transform: Array, points: Array) -> Array:
    """Points after a transform.

    transform : (..., 3, 3) float64
    points : (..., n, 2) float64 — (x, y) [px]; leading axes broadcast against those of ``transform``
    Returns (..., n, 2) float64 [px]; NaN for points on or beyond the transform's horizon, where it is undefined.

    >>> apply_transform(np.array([[2.0, 0, 1], [0, 2, 0], [0, 0, 1]]), np.array([[3.0, 4.0]]))
    array([[7., 8.]])
    """
    image = points @ np.swapaxes(transform[..., :2], -1, -2) + transform[..., None, :, 2]
    scale = image[..., 2:]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where(scale > 0, image[..., :2] / scale, np.nan)


def jacobian(transform: Array, points: Array) -> Array:
    """∂(x', y')/∂(x, y) of transforms at points.

    transform : (..., 3, 3); points : (..., n, 2) [px]
    Returns (..., n, 2, 2); its determinant is the local change of area, negative where the transform folds.
    """
    image = points @ np.swapaxes(transform[..., :2], -1, -2) + transform[..., None, :, 2]
    scale = image[..., 2, None, None]
    carried = image[..., :2] / image[..., 2:]
    gradient: Array = (transform[..., None, :2, :2] - carried[..., :, None] * transform[..., None, None, 2, :2]) / scale
    return gradient


def transfer_error(transform: Array, source: Array, target: Array) -> Array:
    """Distance of each transformed source point from its target, (..., n) [px]; infinite beyond the horizon."""
    difference = apply_transform(transform, source) - target
    distance = np.sqrt(np.einsum("...i,...i->...", difference, difference))
    return np.where(np.isnan(distance), np.inf, distance)


def estimate_transform(kind: TransformKind, source: Array, target: Array) -> Array:
    """Least-squares transforms from point pairs.

    source, target : (..., n, 2) float64 [px], n at least ``MINIMUM_PAIRS[kind]``; leading axes are batch
    Returns (..., 3, 3) float64; NaN where the points do not determine it (coincident or collinear).
    Raises ValueError with fewer pairs than the kind needs.

    Similarity and affine minimise the transfer error; projective is the normalised direct linear transform
    (Hartley, IEEE Trans. PAMI 19, 1997).
    """
    if source.shape[-2] < MINIMUM_PAIRS[kind]:
        raise ValueError(f"{kind} needs at least {MINIMUM_PAIRS[kind]} pairs, got {source.shape[-2]}")
    to_source, to_target = _normalisation(source), _normalisation(target)
    with np.errstate(all="ignore"):
        unit = _ESTIMATORS[kind](apply_transform(to_source, source), apply_transform(to_target, target))
        transform: Array = _inverse_normalisation(to_target) @ unit @ to_source
        transform = transform / transform[..., 2:, 2:]
    bad = ~np.isfinite(transform).all(axis=(-2, -1))
    transform[bad] = np.nan
    return transform


def msac(
    kind: TransformKind,
    source: Array,
    target: Array,
    *,
    threshold_px: float = 1.5,
    confidence: float = 0.99,
    max_trials: int = 2000,
    seed: int | Sequence[int] = 0,
) -> Consensus:
    """Transform that fits most pairs, by M-estimator sample consensus.

    source, target : (n, 2) float64 — matched points, some of them wrong [px]
    threshold_px : transfer error from which a pair counts as wrong [px]
    confidence : probability with which at least one sample has no wrong pair
    seed : of the random samples; equal seeds give equal results to the last bit

    The cost of a hypothesis from a minimal sample is Σ min(e², threshold²) (Torr and Zisserman, Computer Vision and
    Image Understanding 78, 2000); the best one is refitted to its inliers until they no longer change.
    """
    minimum = MINIMUM_PAIRS[kind]
    if len(source) < minimum:
        return Consensus(np.full((3, 3), np.nan), np.zeros(len(source), dtype=bool), float("nan"), 0)
    generator = np.random.default_rng(seed)
    best, best_cost, trials, trials_needed = np.full((3, 3), np.nan), np.inf, 0, max_trials
    while trials < trials_needed:
        picks = _samples(generator, HYPOTHESES_PER_BLOCK, len(source), minimum)
        hypotheses = estimate_transform(kind, source[picks], target[picks])
        errors = transfer_error(hypotheses, source, target)
        costs = np.minimum(errors**2, threshold_px**2).sum(axis=-1)
        trials += HYPOTHESES_PER_BLOCK
        if costs.min() < best_cost:
            cheapest = int(costs.argmin())
            best, best_cost = hypotheses[cheapest], float(costs[cheapest])
            share = float(np.mean(errors[cheapest] < threshold_px))
            trials_needed = min(max_trials, _trials_needed(share, minimum, confidence))
    transform, inliers = _refit(kind, best, source, target, threshold_px)
    errors = transfer_error(transform, source[inliers], target[inliers])
    residual = float(np.sqrt(np.mean(errors**2))) if inliers.any() else float("nan")
    return Consensus(transform, inliers, residual, trials)


def _samples(generator: np.random.Generator, count: int, population: int, size: int) -> Index:
    """``count`` samples of ``size`` different indices below ``population``: each draw skips the earlier ones."""
    picks = generator.integers(0, population - np.arange(size), (count, size))
    for column in range(1, size):
        for earlier in np.sort(picks[:, :column], axis=1).T:
            picks[:, column] += picks[:, column] >= earlier
    return picks


def _trials_needed(inlier_share: float, sample_size: int, confidence: float) -> int:
    """Number of samples of which one is free of outliers: log(1 − confidence) / log(1 − share^size)."""
    clean = inlier_share**sample_size
    if clean <= 0:
        return np.iinfo(np.int64).max
    if clean >= 1:
        return 1
    return int(np.ceil(np.log1p(-confidence) / np.log1p(-clean)))


def _refit(
    kind: TransformKind, transform: Array, source: Array, target: Array, threshold_px: float
) -> tuple[Array, Mask]:
    """Transform and inliers after repeated fits to the inliers of the last fit, until these stay the same."""
    inliers = transfer_error(transform, source, target) < threshold_px
    for _ in range(MAX_REFITS):
        if inliers.sum() < MINIMUM_PAIRS[kind]:
            break
        fitted = estimate_transform(kind, source[inliers], target[inliers])
        agree = transfer_error(fitted, source, target) < threshold_px
        if agree.sum() < inliers.sum():
            break
        transform, settled, inliers = fitted, bool((agree == inliers).all()), agree
        if settled:
            break
    return transform, inliers


def _normalisation(points: Array) -> Array:
    """Similarity that brings points (..., n, 2) to centroid 0 and mean distance √2; NaN if all are one point."""
    centre = points.mean(axis=-2)
    distance = np.linalg.norm(points - centre[..., None, :], axis=-1).mean(axis=-1)
    with np.errstate(divide="ignore"):
        scale = np.where(distance > 0, np.sqrt(2) / distance, np.nan)
    transform = np.zeros((*points.shape[:-2], 3, 3))
    transform[..., 0, 0] = transform[..., 1, 1] = scale
    transform[..., :2, 2] = -scale[..., None] * centre
    transform[..., 2, 2] = 1.0
    return transform


def _inverse_normalisation(transform: Array) -> Array:
    """Inverse of a transform by :func:`_normalisation`."""
    scale = transform[..., 0, 0]
    inverse = np.zeros_like(transform)
    inverse[..., 0, 0] = inverse[..., 1, 1] = 1 / scale
    inverse[..., :2, 2] = -transform[..., :2, 2] / scale[..., None]
    inverse[..., 2, 2] = 1.0
    return inverse


def _similarity(source: Array, target: Array) -> Array:
    """x' = s R x + t of centred points, with the plane read as complex numbers: z' = c z, c = Σ z̄ z' / Σ z̄ z."""
    z, w = source[..., 0] + 1j * source[..., 1], target[..., 0] + 1j * target[..., 1]
    factor = (z.conj() * w).sum(axis=-1) / (abs(z) ** 2).sum(axis=-1)
    transform = np.zeros((*factor.shape, 3, 3))
    transform[..., 0, 0] = transform[..., 1, 1] = factor.real
    transform[..., 1, 0], transform[..., 0, 1] = factor.imag, -factor.imag
    transform[..., 2, 2] = 1.0
    return transform


def _affine(source: Array, target: Array) -> Array:
    """A = (Σ x' xᵀ)(Σ x xᵀ)⁻¹ of centred points."""
    xx = np.einsum("...ni,...nj->...ij", source, source)
    yx = np.einsum("...ni,...nj->...ij", target, source)
    determinant = xx[..., 0, 0] * xx[..., 1, 1] - xx[..., 0, 1] ** 2
    collinear = determinant < 1e-20 * np.trace(xx, axis1=-2, axis2=-1) ** 2
    adjugate = np.stack([xx[..., 1, 1], -xx[..., 0, 1], -xx[..., 1, 0], xx[..., 0, 0]], axis=-1).reshape(xx.shape)
    transform = np.zeros((*xx.shape[:-2], 3, 3))
    transform[..., :2, :2] = yx @ adjugate / np.where(collinear, np.nan, determinant)[..., None, None]
    transform[..., 2, 2] = 1.0
    return transform


def _projective(source: Array, target: Array) -> Array:
    """Null vector of the 2n × 9 system x' × H x = 0, brought to 9 × 9 by QR first."""
    ones, zeros = np.ones_like(source[..., :1]), np.zeros((*source.shape[:-1], 3))
    homogeneous = np.concatenate([source, ones], axis=-1)
    rows_x = np.concatenate([homogeneous, zeros, -target[..., :1] * homogeneous], axis=-1)
    rows_y = np.concatenate([zeros, homogeneous, -target[..., 1:] * homogeneous], axis=-1)
    system = np.concatenate([rows_x, rows_y], axis=-2)
    valid = np.isfinite(system).all(axis=(-2, -1))
    safe = np.where(valid[..., None, None], system, 0.0)
    if safe.shape[-2] > 9:
        safe = np.asarray(np.linalg.qr(safe, mode="r"))
    _, singular, basis = np.linalg.svd(safe, full_matrices=system.shape[-2] < 9)
    determined = valid & (singular[..., 7] > 1e-9 * singular[..., 0])
    transform: Array = basis[..., 8, :].reshape(*basis.shape[:-2], 3, 3)
    return np.where(determined[..., None, None], transform, np.nan)


_ESTIMATORS: dict[str, Callable[[Array, Array], Array]] = {
    "similarity": _similarity,
    "affine": _affine,
    "projective": _projective,
}
