"""How much points scatter about smooth motion, over what their stated errors make of it.

Noise of the photographs is known, but what misfit makes of a subset's place is an estimate, which rests on assumptions
about residuals and pattern. The scatter of the points tests it: a polynomial of degree 3 in a window differs from the
point at its centre by a weighted sum of the points, whose variance is known. Motion that the polynomial does not follow
adds to the scatter, the more the wider the window. So the least of the ratios of scatter to σ in windows of three sizes
counts. Errors that the points of a window share are missing in it, so that a ratio below 1 tells nothing.
"""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array, Index
from dicflow.core.strain.deformation_gradient import ErrorShare, MeasuredSurface
from dicflow.core.strain.small_jumps import GridOfSubsets
from dicflow.core.strain.window_fits import places_of, terms_of_degree
from dicflow.core.uncertainty.covariance import displacement_covariance

__all__ = ["scatter_over_stated"]


_SIDES = (1.1, 1.6, 2.5)
"""Sides of the windows in sides of a subset."""
_DEGREE, _LEAST_SIDE = 3, 5
_POINTS = 2000
"""Points at which the scatter is seen, at most."""
_NORMAL_MEDIAN = 0.6745
"""Median of the size of a normal variable, in standard deviations."""
_NEGLIGIBLE, _STANDARD_ERRORS = 0.1, 3.0
"""Up to which a ratio above 1 counts for nothing: the excess itself, and in its standard errors."""
_RELATIVE_ERROR = 1.17
"""Relative standard error of a standard deviation that a median tells, times the root of the number of values."""


def scatter_over_stated(surface: MeasuredSurface, subsets: GridOfSubsets) -> Array:
    """Ratios (3,) of the scatter of the displacements to their σ, along each axis; 1 where it hardly exceeds that."""
    at = places_of(surface.known)
    independent = max(1.0, len(at) * (subsets.step / subsets.size) ** 2)
    limit = max(_NEGLIGIBLE, _STANDARD_ERRORS * _RELATIVE_ERROR / np.sqrt(independent))
    some = np.ascontiguousarray(at[:: 1 + len(at) // _POINTS])
    least = np.full(3, np.inf)
    for side in _sides(subsets):
        least = np.minimum(least, _ratios(surface, some, side))
        if (least <= 1.0 + limit).all():
            break
    return np.asarray(np.where(least > 1.0 + limit, least, 1.0))


def _sides(subsets: GridOfSubsets) -> list[int]:
    """Sides of the windows [points], odd and each larger than the one before."""
    sides = [_LEAST_SIDE - 2]
    for relative in _SIDES:
        sides.append(max(sides[-1] + 2, 2 * round((relative * subsets.size / subsets.step - 1.0) / 2.0) + 1))
    return sides[1:]


def _ratios(surface: MeasuredSurface, at: Index, side: int) -> Array:
    """Ratios (3,) of scatter to σ of fits less points in windows of a side at rows and columns (n, 2).

    0 without windows that have enough points.
    """
    functional = np.zeros((1, 1, terms_of_degree(_DEGREE)))
    functional[..., 0] = 1.0
    weights = surface.points.functional_weights(at, (side, side), functional)
    weights[..., side // 2, side // 2] -= 1.0
    sums = surface.points.sums(at, weights)[:, 0]
    variance = np.sum([_variances(surface, at, weights, share) for share in surface.errors], axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        scaled = np.abs(sums[:, :3] - sums[:, 3:]) / np.sqrt(variance)
    columns = (column[np.isfinite(column)] for column in scaled.T)
    return np.array([np.median(column) if len(column) else 0.0 for column in columns]) / _NORMAL_MEDIAN


def _variances(surface: MeasuredSurface, at: Index, weights: Array, share: ErrorShare) -> Array:
    """Variances (n, 3) of sums of displacements with weights (n, 1, side, side), by a share in the errors."""
    each = displacement_covariance(share.covariance[at[:, 0], at[:, 1]])
    return surface.points.variances(at, weights, share.rho)[..., 0] * np.diagonal(each, axis1=-2, axis2=-1)
