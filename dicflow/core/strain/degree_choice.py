"""The polynomials of each point's strain, chosen by the data.

A polynomial of too low a degree has a bias, one of too high a degree much noise. At each point the first fit is chosen
whose bias (:mod:`dicflow.core.strain.remaining_bias`) is small beside its noise: of degree 1, 2 and 3 in the window,
and of degree 3 in a smaller one. In a whole window the slopes of degree 2 are those of degree 1; at rims they are not.
If no bias is small, the highest degree is chosen, in the window with the smaller sum of both variances.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Codes, Mask
from dicflow.core.strain.deformation_gradient import MeasuredSurface, SurfaceGradient
from dicflow.core.strain.remaining_bias import CUBIC, WindowFit, relative_bias
from dicflow.core.strain.window_fits import places_of, terms_of_degree

__all__ = ["ChosenGradient", "candidate_fits", "chosen_gradient"]


_MAX_BIAS = 1.0 / 3.0
"""Bias of a component of the gradient that a fit may have [its σ]."""
_SMALLER = 0.7
"""Side of the smaller window in sides of the window."""


class ChosenGradient(NamedTuple):
    """Deformation gradients on the grid, by the fit that was chosen for each point.

    surface : NaN where the point or too much of its window is missing
    bias : (row, col, 4, 4) — second moments of the systematic error that remains in F₁₁, F₁₂, F₂₁, F₂₂ [-]
    degree : (row, col) — of the polynomial; 0 where unknown
    """

    surface: SurfaceGradient
    bias: Array
    degree: Codes

    @property
    def known(self) -> Mask:
        """(row, col) — the points with a gradient."""
        return self.degree > 0


def candidate_fits(window: tuple[int, int], degree: int | Literal["auto"]) -> list[WindowFit]:
    """The fits among which is chosen, those of less noise first; a single one for a degree that is given."""
    if degree != "auto":
        return [WindowFit(window, degree)]
    rows, cols = (2 * round((_SMALLER * side - 1.0) / 2.0) + 1 for side in window)
    smaller = [WindowFit((rows, cols), CUBIC)] if rows * cols >= 1.5 * terms_of_degree(CUBIC) else []
    return [*(WindowFit(window, one) for one in range(1, CUBIC + 1)), *smaller]


def chosen_gradient(surface: MeasuredSurface, fits: Sequence[WindowFit]) -> ChosenGradient:
    """Deformation gradients by the first fit at each point whose bias is small beside its noise."""
    chosen = _unknown(surface.known.shape)
    left, biased = surface.known, []
    for fit in fits:
        relative = relative_bias(surface, fit, left)
        small = np.diagonal(relative, axis1=-2, axis2=-1).max(axis=-1) <= _MAX_BIAS**2
        _take(chosen, surface, fit, relative, left & small)
        biased.append((fit, relative))
        left = left & ~chosen.known
        if not left.any():
            return chosen
    for fit, relative in reversed(biased):
        _take(chosen, surface, fit, relative, left)
    return chosen


def _unknown(shape: tuple[int, ...]) -> ChosenGradient:
    """Unknown gradients of a grid."""
    sides = ((2, 2), (4, 4), (4, 2, 6), (4, 4))
    *surface, bias = (np.full((*shape, *side), np.nan) for side in sides)
    return ChosenGradient(SurfaceGradient(*surface), bias, np.zeros(shape, dtype=np.uint8))


def _take(chosen: ChosenGradient, surface: MeasuredSurface, fit: WindowFit, relative: Array, wanted: Mask) -> None:
    """Set the gradients of some points by a fit, where it is known and better than one of at least its degree."""
    at = places_of(wanted)
    if len(at) == 0:
        return
    found = surface.gradient(at, *fit)
    sigma = np.sqrt(np.diagonal(found.covariance, axis1=-2, axis2=-1))
    rows, cols = at.T
    bias = relative[rows, cols] * sigma[:, :, None] * sigma[:, None]
    before = chosen.surface.covariance[rows, cols] + chosen.bias[rows, cols]
    better = _trace(found.covariance + bias) < np.nan_to_num(_trace(before), nan=np.inf)
    taken = np.isfinite(_trace(bias)) & (chosen.degree[rows, cols] <= fit.degree) & better
    for field, values in zip((*chosen.surface, chosen.bias), (*found, bias), strict=True):
        field[rows[taken], cols[taken]] = values[taken]
    chosen.degree[rows[taken], cols[taken]] = fit.degree


def _trace(matrices: Array) -> Array:
    return np.asarray(np.trace(matrices, axis1=-2, axis2=-1))
