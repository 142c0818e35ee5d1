"""Bias of strains around the end of a crack, where polynomials do not converge to the motion.

At the end of a crack displacements grow with the root of the distance. A window there has points on both sides of lost
ones. Each degree of its polynomials changes the slopes by about as much as all further ones together would, so that a
pilot of a higher degree or in a wider window tells too little. What the chosen degree has changed against the lowest
one is stated, in each component alike: such a field has strains of the same size in all of them. The change of a
single point may be small by chance where its error is not, so that the mean of the points around it counts too.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.strain.deformation_gradient import MeasuredSurface
from dicflow.core.strain.degree_choice import ChosenGradient
from dicflow.core.strain.remaining_bias import WindowFit, at_least
from dicflow.core.strain.window_fits import places_of, widened

__all__ = ["with_crack_ends"]


_DIRECTIONS = np.array([[1, 0], [0, 1], [1, 1], [1, -1]])
"""Steps (row, col) along four lines through a point."""


def with_crack_ends(chosen: ChosenGradient, surface: MeasuredSurface, lost: Mask, widest: WindowFit) -> ChosenGradient:
    """The chosen gradients, with at least the bias that they have around the ends of cracks.

    lost : (row, col) — points at which a jump was found
    widest : the fit of least noise among those of which was chosen
    """
    bias = chosen.bias.copy()
    ends = _around_ends(surface, places_of(chosen.degree > 0), widest.window, lost)
    sides, degrees = (field[tuple(ends.T)] for field in (chosen.window, chosen.degree))
    squares = np.full(lost.shape, np.nan)
    for side, degree in set(zip(sides.tolist(), degrees.tolist(), strict=True)):
        at = np.ascontiguousarray(ends[(sides == side) & (degrees == degree)])
        squares[tuple(at.T)] = _square_of_change(surface, at, WindowFit((side, side), degree), widest)
    rows, cols = ends.T
    square = np.fmax(squares, _mean_of_neighbours(squares))[rows, cols]
    bias[rows, cols] = at_least(bias[rows, cols], square[:, None, None] * np.eye(4))
    return chosen._replace(bias=bias)


def _mean_of_neighbours(values: Array) -> Array:
    """Means over each point (row, col) and those next to it that are known; NaN where none is."""
    known = np.isfinite(values)
    total, count = (cv2.blur(np.where(known, part, 0.0), (3, 3)) for part in (values, np.ones_like(values)))
    return np.asarray(np.divide(total, count, out=np.full_like(total, np.nan), where=count > 0.0))


def _around_ends(surface: MeasuredSurface, at: Index, window: tuple[int, int], lost: Mask) -> Index:
    """Those of rows and columns (n, 2) whose windows have points on both sides of lost ones."""
    if not lost.any():
        return at[:0]
    high, wide = window
    windows = sliding_window_view(np.pad(lost, [(high // 2,) * 2, (wide // 2,) * 2]), window)
    at = np.ascontiguousarray(at[windows[at[:, 0], at[:, 1]].any(axis=(1, 2))])
    used = (surface.points.slope_weights(at, window, 1) != 0.0).any(axis=1)
    return np.ascontiguousarray(at[_has_between(used, windows[at[:, 0], at[:, 1]])])


def _has_between(used: Mask, lost: Mask) -> Mask:
    """Which windows (n, high, wide) have a lost point with used ones on both sides, in any of four directions."""
    found = np.zeros(len(used), dtype=np.bool_)
    for down, right in _DIRECTIONS.tolist():
        found |= (_seen(used, down, right) & _seen(used, -down, -right) & lost).any(axis=(1, 2))
    return found


def _seen(used: Mask, down: int, right: int) -> Mask:
    """Points (n, high, wide) of windows from which used ones lie in a direction."""
    high, wide = used.shape[1:]
    here = (slice(max(0, -down), high - max(0, down)), slice(max(0, -right), wide - max(0, right)))
    next_one = (slice(max(0, down), high + min(0, down)), slice(max(0, right), wide + min(0, right)))
    found = np.zeros_like(used)
    for _ in range(max(high, wide) - 1):
        found[:, *here] = (found | used)[:, *next_one]
    return found


def _square_of_change(surface: MeasuredSurface, at: Index, fit: WindowFit, widest: WindowFit) -> Array:
    """Mean square (n,) over the components of the gradient of what a fit changes against degree 1, less that by noise.

    Of degree 1 itself against degree 2, and 0 where too few points fix that.
    """
    own = surface.points.slope_weights(at, *fit)
    other = surface.points.slope_weights(at, widest.window, 1 if fit.degree > 1 else 2)
    response, weights = surface.gradient_by(at, own).response, widened(own, widest.window) - other
    change = np.einsum("nfai,nai->nf", response, surface.points.sums(at, weights))
    noise = np.diagonal(surface.covariance_by(at, weights, response), axis1=-2, axis2=-1)
    return np.asarray(np.maximum(np.nan_to_num((change**2 - noise).mean(axis=-1)), 0.0))
