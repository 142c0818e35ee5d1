"""Centres of symmetry in photographs: where the corners of squares are, to a few thousandths of a pixel."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from dicflow.core.arrays import Array, Image, Mask

__all__ = ["centres_of_symmetry", "spline_weights"]


_STEPS = 20
_TOLERANCE_PX = 1e-3
_LEAST_DETERMINANT = 1e-4
_DEGREE = 5


def centres_of_symmetry(
    image: NDArray[np.uint8] | NDArray[np.uint16],
    places: Array,
    radius_px: int,
    windows: Mask | None = None,
) -> Array:
    """Move places to where the image around them is its own copy turned by 180°.

    The crossing of two edges is such a centre under any linear view of it, so neither foreshortening nor blur nor
    uneven contrast moves it. With A(x) the image around a place, a shift s of the place changes A(x) − A(−x) by
    (∇A(x) − ∇A(−x)) · s, which gives s by least squares under a Gaussian window.

    A is the photograph smoothed by the B-spline of degree 5, of σ = 0.7 px, whose values between the pixels follow
    exactly; interpolation of sharp edges would draw the centre towards the pixels by several times the error that
    remains.

    places : (n, 2) [px], right to about a third of the radius
    radius_px : half the side of the window
    windows : (n, side, side) with side = 2 radius_px + 1 — pixels around each place that may be used, alike on both
        sides of it; all when not given
    Returns (n, 2) [px]; a place that wanders off by more than the radius, or has no contrast, stays where it was.
    """
    margin = 2 * radius_px + _DEGREE + 2
    grey = cv2.copyMakeBorder(image.astype(np.float32), margin, margin, margin, margin, cv2.BORDER_REPLICATE)
    bell = np.exp(-2.0 * (np.arange(-radius_px, radius_px + 1, dtype=np.float32) / radius_px) ** 2)
    weight = np.outer(bell, bell)
    weights = np.broadcast_to(weight, (len(places), *weight.shape)) if windows is None else windows * weight
    found = [_centre_of_symmetry(grey, place + margin, own) for place, own in zip(places, weights, strict=True)]
    return np.stack(found) - margin


def spline_weights(fraction: float, degree: int) -> Array:
    """The degree + 1 values of the centred B-spline that weigh the pixels around a place between two of them.

    By the recursion of Cox and de Boor. The first of the two is number (degree − 1) / 2, for an odd degree.

    >>> spline_weights(0.25, 1)
    array([0.75, 0.25])
    """
    weights = np.ones(1)
    for order in range(1, degree + 1):
        behind = fraction + np.arange(order + 1)
        weights = (behind * np.append(weights, 0.0) + (order + 1 - behind) * np.append(0.0, weights)) / order
    return weights[::-1]


def _centre_of_symmetry(grey: Image, start: Array, weight: Image) -> Array:
    place, radius = start, len(weight) // 2
    for _ in range(_STEPS):
        around = _smoothed(grey, place, radius + 1)
        middle = around[1:-1, 1:-1]
        slopes = np.stack([around[1:-1, 2:] - around[1:-1, :-2], around[2:, 1:-1] - around[:-2, 1:-1]]) / 2.0
        slopes = slopes - slopes[:, ::-1, ::-1]
        normal = np.einsum("iyx,jyx,yx->ij", slopes, slopes, weight)
        if not np.linalg.det(normal) > _LEAST_DETERMINANT * np.trace(normal) ** 2:
            return start
        step = np.linalg.solve(normal, np.einsum("iyx,yx,yx->i", slopes, middle - middle[::-1, ::-1], weight))
        place = place - step
        if np.abs(place - start).max() > radius + 0.5:
            return start
        if np.abs(step).max() < _TOLERANCE_PX:
            break
    return place


def _smoothed(grey: Image, place: Array, reach: int) -> Image:
    """Values on the grid of whole pixels around a place, out to a reach on all four sides."""
    column, row = np.floor(place).astype(int)
    across, down = (spline_weights(float(fraction), _DEGREE) for fraction in place - np.floor(place))
    before = _DEGREE // 2
    low, high = reach + before, reach + before + 2
    block = grey[row - low : row + high, column - low : column + high]
    smooth = cv2.sepFilter2D(block, cv2.CV_32F, across, down, anchor=(before, before))
    return np.asarray(smooth[before : before + 2 * reach + 1, before : before + 2 * reach + 1])
