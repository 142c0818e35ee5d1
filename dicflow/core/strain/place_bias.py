"""Bias of strains by that of places.

A subset leaves out what its shape function does not follow, so that places have a bias b of which only the size is
known. Neighbours share it as far as their subsets overlap, as they share noise. So slopes s = Σₙ wₙ Xₙ have the bias
Σₙₘ wₙ bₙ ρₙₘ bₘ wₘ, along each axis, with the correlation ρ of the errors of two points.
"""

from __future__ import annotations

import cv2
import numpy as np

from dicflow.core.arrays import Array, Index
from dicflow.core.strain.deformation_gradient import MeasuredSurface
from dicflow.core.strain.degree_choice import ChosenGradient
from dicflow.core.strain.remaining_bias import at_least
from dicflow.core.strain.window_fits import places_of

__all__ = ["with_bias_of_places"]


_COUNTS = 0.3
"""Bias of a place over its standard deviation from which it counts in the strains around."""
_LEAST_MM = 1e-12


def with_bias_of_places(chosen: ChosenGradient, surface: MeasuredSurface, places: Array | None) -> ChosenGradient:
    """The chosen gradients, with at least the bias that they have by that of the places.

    places : (row, col, 3) — remaining bias of the displacements [mm]; NaN where unknown, None if all are
    """
    if places is None:
        return chosen
    places = np.nan_to_num(places)
    large = (places**2).sum(axis=-1) > (_COUNTS * surface.points.sigma) ** 2
    reach = np.ones((int(chosen.window.max(initial=1)),) * 2, dtype=np.uint8)
    at = places_of((cv2.dilate((large & surface.known).astype(np.uint8), reach) > 0) & (chosen.degree > 0))
    bias = chosen.bias.copy()
    sides, degrees = (field[tuple(at.T)] for field in (chosen.window, chosen.degree))
    for side, degree in sorted(set(zip(sides.tolist(), degrees.tolist(), strict=True))):
        here = np.ascontiguousarray(at[(sides == side) & (degrees == degree)])
        weights = surface.points.slope_weights(here, (side, side), degree)
        rows, cols = here.T
        moments = _moments(surface, here, weights, places, chosen.surface.response[rows, cols])
        bias[rows, cols] = at_least(bias[rows, cols], moments)
    return chosen._replace(bias=bias)


def _moments(surface: MeasuredSurface, at: Index, weights: Array, places: Array, response: Array) -> Array:
    """Second moments (n, 4, 4) of the bias of gradients by weights (n, 2, high, wide) in the slopes."""
    moments = np.zeros((len(at), 4, 4))
    for axis, size in enumerate(np.moveaxis(places, -1, 0)):
        size = np.maximum(size, _LEAST_MM)
        unit = surface.points._replace(sigma=size).variances(at, weights, surface.errors[0].rho)
        slopes = unit * size[at[:, 0], at[:, 1]][:, None, None] ** 2
        by_axis = response[..., axis]
        moments += by_axis @ slopes @ np.swapaxes(by_axis, -1, -2)
    return moments
