"""The polynomials of each point's strain, chosen by the data.

A polynomial of too low a degree has a bias b (:mod:`dicflow.core.strain.remaining_bias`), one of too high a degree much
noise σ. Candidates are those of degree 1, 2 and 3 in the window, and of degree 3 in a smaller one. The first counts
whose bias is at most σ / 4 in each component of the gradient; without one, that with the least sum of σ² + (4 b)². So
a bias is removed if the variance grows by less than sixteen times its square. In a whole window the slopes of degree 2
are those of degree 1; at rims they are not.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Codes, Counts, Index
from dicflow.core.strain.deformation_gradient import MeasuredSurface, SurfaceGradient
from dicflow.core.strain.remaining_bias import (
    CUBIC,
    RelativeBias,
    WindowFit,
    at_least,
    relative_bias,
    relative_bias_at_rims,
)
from dicflow.core.strain.unseen_jumps import UnseenJumps
from dicflow.core.strain.window_fits import places_of, terms_of_degree

__all__ = ["ChosenGradient", "candidate_fits", "chosen_gradient"]


_WEIGHT = 16.0
"""Of the square of a bias beside σ²: neighbours share a bias, and it may be larger than its estimate."""
_SMALLER = 0.7
"""Side of the smaller window in sides of the window."""


class ChosenGradient(NamedTuple):
    """Deformation gradients on the grid, by the fit that was chosen for each point.

    surface : NaN where the point or too much of its window is missing
    bias : (row, col, 4, 4) — second moments of the systematic error that remains in F₁₁, F₁₂, F₂₁, F₂₂ [-]
    degree : (row, col) — of the polynomial; 0 where unknown
    window : (row, col) — rows of its window [points]; 0 where unknown
    """

    surface: SurfaceGradient
    bias: Array
    degree: Codes
    window: Counts


def candidate_fits(window: tuple[int, int], degree: int | Literal["auto"]) -> list[WindowFit]:
    """The fits among which is chosen, those of less noise first; a single one for a degree that is given."""
    if degree != "auto":
        return [WindowFit(window, degree)]
    rows, cols = (2 * round((_SMALLER * side - 1.0) / 2.0) + 1 for side in window)
    smaller = [WindowFit((rows, cols), CUBIC)] if rows * cols >= 1.5 * terms_of_degree(CUBIC) else []
    return [*(WindowFit(window, one) for one in range(1, CUBIC + 1)), *smaller]


def chosen_gradient(
    surface: MeasuredSurface, fits: Sequence[WindowFit], jumps: UnseenJumps | None = None
) -> ChosenGradient:
    """Deformation gradients by the first fit at each point whose bias is small beside its noise, or by the best one.

    jumps : across which the windows reach; None without any
    """
    chosen, least = _unknown(surface.known.shape), np.full(surface.known.shape, np.inf)
    left, taken = surface.known, np.full(surface.known.shape, -1)
    for number, fit in enumerate(fits):
        if not left.any():
            break
        relative = relative_bias(surface, fit, left)
        taken[tuple(_take_better(chosen, least, surface, fit, relative, places_of(left)).T)] = number
        left = left & (_WEIGHT * np.diagonal(relative.near, axis1=-2, axis2=-1).max(axis=-1) > 1.0)
    for number, fit in enumerate(fits):
        at = places_of(taken == number)
        _state_rims(chosen, surface, fit, at)
        if jumps is not None:
            chosen.bias[tuple(at.T)] = _with_jumps(chosen, jumps, surface, fit, at)
    return chosen


def _state_rims(chosen: ChosenGradient, surface: MeasuredSurface, fit: WindowFit, at: Index) -> None:
    """Set the bias of a fit at rows and columns (n, 2) whose windows have gaps to what these points show alone."""
    rims, moments = relative_bias_at_rims(surface, fit, at, chosen.surface)
    scale = _scale(chosen.surface.covariance[tuple(rims.T)])
    chosen.bias[tuple(rims.T)] = scale * at_least(chosen.bias[tuple(rims.T)] / scale, moments)


def _scale(covariance: Array) -> Array:
    """Products (n, 4, 4) of the standard deviations of covariances (n, 4, 4)."""
    sigma = np.sqrt(np.diagonal(covariance, axis1=-2, axis2=-1))
    return np.asarray(sigma[:, :, None] * sigma[:, None])


def _with_jumps(
    chosen: ChosenGradient, jumps: UnseenJumps, surface: MeasuredSurface, fit: WindowFit, at: Index
) -> Array:
    """Second moments (n, 4, 4) of the bias of a fit at rows and columns (n, 2), that by jumps if it is larger.

    chosen : with the gradients by this fit there
    """
    bias = chosen.bias[at[:, 0], at[:, 1]]
    crossed = np.flatnonzero((jumps.jump[at[:, 0], at[:, 1]] != 0.0).any(axis=-1))
    if not len(crossed):
        return bias
    here, larger = at[crossed], bias.copy()
    weights = surface.points.slope_weights(here, *fit)
    response = chosen.surface.response[here[:, 0], here[:, 1]]
    shares = np.einsum("nfai,nkai->nkf", response[..., :3], jumps.of_slopes(here, weights))
    moments = np.einsum("nkf,nkg->nfg", shares, shares)
    more = np.trace(moments, axis1=-2, axis2=-1) > np.trace(bias[crossed], axis1=-2, axis2=-1)
    larger[crossed[more]] = moments[more]
    return larger


def _unknown(shape: tuple[int, ...]) -> ChosenGradient:
    """Unknown gradients of a grid."""
    sides = ((2, 2), (4, 4), (4, 2, 6), (4, 4))
    *surface, bias = (np.full((*shape, *side), np.nan) for side in sides)
    degree, window = np.zeros(shape, dtype=np.uint8), np.zeros(shape, dtype=np.int32)
    return ChosenGradient(SurfaceGradient(*surface), bias, degree, window)


def _take_better(
    chosen: ChosenGradient, least: Array, surface: MeasuredSurface, fit: WindowFit, relative: RelativeBias, at: Index
) -> Index:
    """Set the gradients at rows and columns (n, 2) where a fit is better than those before; returns these.

    least : the sums of variance and bias, of those before
    """
    found = surface.gradient(at, *fit)
    scale = _scale(found.covariance)
    near, bias = (scale * moments[at[:, 0], at[:, 1]] for moments in relative)
    total = np.trace(found.covariance + _WEIGHT * near, axis1=-2, axis2=-1)
    better = total < least[at[:, 0], at[:, 1]]
    rows, cols = at[better].T
    least[rows, cols] = total[better]
    for field, values in zip((*chosen.surface, chosen.bias), (*found, bias), strict=True):
        field[rows, cols] = values[better]
    chosen.degree[rows, cols], chosen.window[rows, cols] = fit.degree, fit.window[0]
    return np.ascontiguousarray(at[better])
