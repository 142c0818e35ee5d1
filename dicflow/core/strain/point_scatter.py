"""How much points scatter about smooth motion, over what their stated errors make of it.

Noise of the photographs is known, but what misfit makes of a subset's place is an estimate, which rests on assumptions
about residuals and pattern. The scatter of the points tests it: a polynomial of degree 5 in a window of 2.5 subsets
differs from the point at its centre by a weighted sum of the points, whose variance is known. The window is so wide
that neighbours whose subsets share pixels share little of the difference, and the degree so high that it follows
motion which affine or quadratic subsets follow. The bias that is known of the places is taken out. Beside a narrow band
no such window follows the motion; so of a scatter above σ counts what a small window has too.
"""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array, Index
from dicflow.core.strain.deformation_gradient import ErrorShare, MeasuredSurface
from dicflow.core.strain.small_jumps import GridOfSubsets
from dicflow.core.strain.window_fits import places_of, terms_of_degree
from dicflow.core.uncertainty.covariance import displacement_covariance

__all__ = ["scatter_over_stated"]


_SIDE, _LEAST_SIDE, _DEGREE = 2.5, 7, 5
"""Side of the windows in subsets, the least one in points, and the degree of the polynomials."""
_SMALL_SIDE, _SMALL_LEAST_SIDE, _SMALL_DEGREE = 1.1, 5, 3
"""The same of small windows, beside bands narrower than the others."""
_POINTS = 500
"""Points at which the scatter is seen, at most."""
_QUANTILES, _NORMAL_SIZES = (0.5, 0.6), np.array([0.6745, 0.8416])
"""Median of the sizes of differences, and a larger one, below which σ is not lowered; those of a normal variable, in
standard deviations."""
_NEGLIGIBLE, _STANDARD_ERRORS = 0.05, 2.0
"""Difference of a ratio from 1 that counts for nothing: itself, and in its standard errors."""
_RELATIVE_ERROR = 1.17
"""Relative standard error of a standard deviation that a median tells, times the root of the number of values."""


def scatter_over_stated(
    surface: MeasuredSurface, subsets: GridOfSubsets, bias: Array | None = None, misfit_share: float = 0.0
) -> Array:
    """Ratios (3,) of the scatter of the displacements to their σ, along each axis; 1 where it hardly differs from that.

    The difference of r² from 1 counts by the share 1 − (l / (r − 1))², where l is what may be chance. Below 1 it is at
    most that by misfit: noise is known.

    bias : (row, col, 3) — of the displacements, of which the squares are taken out of r² > 1; None if unknown
    misfit_share : of misfit in the variances
    """
    at = places_of(surface.known)
    independent = max(1.0, len(at) * (subsets.step / subsets.size) ** 2)
    limit = np.hypot(_NEGLIGIBLE, _STANDARD_ERRORS * _RELATIVE_ERROR / np.sqrt(independent))
    some = np.ascontiguousarray(at[:: 1 + len(at) // _POINTS])
    small = _ratios(surface, some, _odd_side(subsets, _SMALL_SIDE, _SMALL_LEAST_SIDE), _SMALL_DEGREE)[0]
    if (small <= 1.0 + limit).all() and misfit_share <= limit:
        return np.ones(3)
    usual, larger = _ratios(surface, some, _odd_side(subsets, _SIDE, _LEAST_SIDE), _DEGREE)
    square = np.where(usual < 1.0, np.clip(larger, usual, 1.0), np.clip(small, 1.0, usual)) ** 2
    if bias is not None:
        square = np.where(square > 1.0, np.maximum(square - _share_of_bias(surface, some, bias), 1.0), square)
    square = np.maximum(square, 1.0 - misfit_share)
    share = 1.0 - (limit / np.maximum(np.abs(np.sqrt(square) - 1.0), limit)) ** 2
    return np.asarray(np.sqrt(1.0 + share * (square - 1.0)))


def _odd_side(subsets: GridOfSubsets, relative: float, least: int) -> int:
    """Side of windows [points], from that in subsets."""
    return max(least, 2 * round((relative * subsets.size / subsets.step - 1.0) / 2.0) + 1)


def _share_of_bias(surface: MeasuredSurface, at: Index, bias: Array) -> Array:
    """Means (3,) of the squares of biases (row, col, 3) over the variances at rows and columns (n, 2); 0 if unknown."""
    covariance = np.sum([share.covariance[at[:, 0], at[:, 1]] for share in surface.errors], axis=0)
    variance = np.diagonal(displacement_covariance(covariance), axis1=-2, axis2=-1)
    with np.errstate(invalid="ignore", divide="ignore"):
        shares = bias[at[:, 0], at[:, 1]] ** 2 / variance
    columns = (column[np.isfinite(column)] for column in shares.T)
    return np.array([column.mean() if len(column) else 0.0 for column in columns])


def _ratios(surface: MeasuredSurface, at: Index, side: int, degree: int) -> Array:
    """Ratios (2, 3) of scatter to σ of fits less points in windows of a side at rows and columns (n, 2).

    By the median of their sizes, and by that of the larger ones; 1 without windows that have enough points.
    """
    functional = np.zeros((1, 1, terms_of_degree(degree)))
    functional[..., 0] = 1.0
    weights = surface.points.functional_weights(at, (side, side), functional)
    weights[..., side // 2, side // 2] -= 1.0
    sums = surface.points.sums(at, weights)[:, 0]
    variance = np.sum([_variances(surface, at, weights, share) for share in surface.errors], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = np.abs(sums[:, :3] - sums[:, 3:]) / np.sqrt(variance)
    columns = (column[np.isfinite(column)] for column in scaled.T)
    sizes = [np.quantile(column, _QUANTILES) / _NORMAL_SIZES if len(column) else np.ones(2) for column in columns]
    return np.stack(sizes, axis=-1)


def _variances(surface: MeasuredSurface, at: Index, weights: Array, share: ErrorShare) -> Array:
    """Variances (n, 3) of sums of displacements with weights (n, 1, side, side), by a share in the errors."""
    each = displacement_covariance(share.covariance[at[:, 0], at[:, 1]])
    return surface.points.variances(at, weights, share.rho)[..., 0] * np.diagonal(each, axis1=-2, axis2=-1)
