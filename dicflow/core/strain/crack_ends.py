"""Bias of strains around the end of a crack, where polynomials do not converge to the motion.

At the end of a crack displacements grow with the root of the distance. A window there has points on both sides of lost
ones. Its polynomial errs by about as much as a higher degree would change it, and so does each further degree, so that
a pilot in a wider window tells nothing. What remains after the chosen degree lies between nothing and all of what this
degree has changed since the lowest one, in every component: a field of this kind has all of them.
"""

from __future__ import annotations

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.strain.deformation_gradient import MeasuredSurface
from dicflow.core.strain.degree_choice import ChosenGradient
from dicflow.core.strain.remaining_bias import at_least
from dicflow.core.strain.window_fits import places_of

__all__ = ["stated_at_crack_ends"]


_DIRECTIONS = np.array([[1, 0], [0, 1], [1, 1], [1, -1]])
_SHARE = 1.0 / 3.0**0.5
"""Standard deviation of what remains over a change: any share of it is as likely."""


def stated_at_crack_ends(chosen: ChosenGradient, surface: MeasuredSurface, lost: Mask) -> Array:
    """Second moments (row, col, 4, 4) of the bias of the chosen gradients, at least those around ends of cracks.

    lost : (row, col) — points at which a jump was found
    """
    bias = chosen.bias.copy()
    if not lost.any():
        return bias
    for window in np.unique(chosen.window[chosen.window > 0]):
        for degree in np.unique(chosen.degree[chosen.window == window]):
            at = places_of((chosen.window == window) & (chosen.degree == degree))
            at, square = _squares_of_change(surface, at, lost, (int(window), int(window)), int(degree))
            rows, cols = at.T
            bias[rows, cols] = at_least(bias[rows, cols], _SHARE**2 * square[:, None, None] * np.eye(4))
    return bias


def _squares_of_change(
    surface: MeasuredSurface, at: Index, lost: Mask, window: tuple[int, int], degree: int
) -> tuple[Index, Array]:
    """Of rows and columns (n, 2) those (m, 2) whose windows have points on both sides of lost ones, and at these the
    mean square (m,) over the components of the gradient, of the change by the degree, less that by noise."""
    high, wide = window
    squares = sliding_window_view(np.pad(lost, [(high // 2,) * 2, (wide // 2,) * 2]), window)
    at = np.ascontiguousarray(at[squares[at[:, 0], at[:, 1]].any(axis=(1, 2))])
    lowest = surface.points.slope_weights(at, window, 1)
    ends = _between((lowest != 0.0).any(axis=1), squares[at[:, 0], at[:, 1]])
    at, lowest = np.ascontiguousarray(at[ends]), lowest[ends]
    own = surface.points.slope_weights(at, window, degree)
    other = lowest if degree > 1 else surface.points.slope_weights(at, window, 2)
    response, weights = surface.gradient_by(at, own).response, own - other
    change = np.einsum("nfai,nai->nf", response, surface.points.sums(at, weights))
    noise = np.diagonal(surface.covariance_by(at, weights, response), axis1=-2, axis2=-1)
    return at, np.maximum(np.nan_to_num((change**2 - noise).mean(axis=-1)), 0.0)


def _between(used: Mask, lost: Mask) -> Mask:
    """Which windows (n, high, wide) have a lost point with used ones on both sides, in any of four directions."""
    found = np.zeros(len(used), dtype=np.bool_)
    for direction in _DIRECTIONS:
        before, after = (_beyond(used, sign * direction) for sign in (-1, 1))
        found |= (before & after & lost).any(axis=(1, 2))
    return found


def _beyond(used: Mask, direction: Index) -> Mask:
    """Points (n, high, wide) of windows from which used ones lie in a direction (row, col)."""
    high, wide = used.shape[1:]
    down, right = direction
    here = (slice(max(0, -down), high - max(0, down)), slice(max(0, -right), wide - max(0, right)))
    there = (slice(max(0, down), high + min(0, down)), slice(max(0, right), wide + min(0, right)))
    found = np.zeros_like(used)
    for _ in range(max(high, wide) - 1):
        found[:, *here] = (found | used)[:, *there]
    return found
