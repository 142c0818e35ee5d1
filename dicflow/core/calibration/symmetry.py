"""Centres of symmetry in photographs: corners of squares, accurate to a few thousandths of a pixel."""

from __future__ import annotations

import cv2
import numpy as np

from dicflow.core.arrays import Array, Grey, Image, Mask

__all__ = ["centres_of_symmetry", "spline_weights"]


_MAX_STEPS = 20
_TOLERANCE_PX = 1e-3
_MIN_DETERMINANT_RATIO = 1e-4
_SPLINE_DEGREE = 5


def centres_of_symmetry(
    image: Grey,
    places: Array,
    radius_px: int,
    windows: Mask | None = None,
) -> Array:
    """Move places to the points about which the image is symmetric under a turn by 180°.

    The crossing of two edges is such a point in any affine view, so foreshortening, blur and uneven contrast do not
    move it. With A(x) the image around a place, a shift s of the place changes A(x) − A(−x) by
    (∇A(x) − ∇A(−x)) · s, which gives s by least squares under a Gaussian window.

    A is the photograph smoothed by the B-spline of degree 5 (σ = 0.7 px), which can be evaluated exactly between the
    pixels. Interpolation of sharp edges would bias the centre towards the pixels by several times the remaining error.

    places : (n, 2) [px], accurate to about a third of the radius
    radius_px : half the side of the window
    windows : (n, side, side) with side = 2 radius_px + 1 — pixels around each place that are used, symmetric about it;
        all if absent
    Returns (n, 2) [px]; a place that would move by more than the radius, or lacks contrast, is left unchanged.
    """
    margin = 2 * radius_px + _SPLINE_DEGREE + 2
    grey = cv2.copyMakeBorder(image.astype(np.float32), margin, margin, margin, margin, cv2.BORDER_REPLICATE)
    bell = np.exp(-2.0 * (np.arange(-radius_px, radius_px + 1, dtype=np.float32) / radius_px) ** 2)
    weight = np.outer(bell, bell)
    weights = np.broadcast_to(weight, (len(places), *weight.shape)) if windows is None else windows * weight
    found = [_centre_of_symmetry(grey, place + margin, own) for place, own in zip(places, weights, strict=True)]
    return np.stack(found) - margin


def spline_weights(fraction: float, degree: int) -> Array:
    """Weights (degree + 1,) of the centred B-spline for the pixels around a place between two of them.

    By the recursion of Cox and de Boor. For an odd degree, the pixel before the place has index (degree − 1) / 2.

    fraction : distance of the place from the pixel before it [px]

    >>> spline_weights(0.25, 1)
    array([0.75, 0.25])
    """
    weights = np.ones(1)
    for order in range(1, degree + 1):
        behind = fraction + np.arange(order + 1)
        weights = (behind * np.append(weights, 0.0) + (order + 1 - behind) * np.append(0.0, weights)) / order
    return weights[::-1]


def _centre_of_symmetry(grey: Image, start: Array, weight: Image) -> Array:
    """The centre (2,) of symmetry near a start (2,), or the start, as in :func:`centres_of_symmetry`."""
    place, radius = start, len(weight) // 2
    for _ in range(_MAX_STEPS):
        around = _smoothed_window(grey, place, radius + 1)
        middle = around[1:-1, 1:-1]
        slopes = np.stack([around[1:-1, 2:] - around[1:-1, :-2], around[2:, 1:-1] - around[:-2, 1:-1]]) / 2.0
        slopes = slopes - slopes[:, ::-1, ::-1]
        normal = np.einsum("iyx,jyx,yx->ij", slopes, slopes, weight)
        if not np.linalg.det(normal) > _MIN_DETERMINANT_RATIO * np.trace(normal) ** 2:
            return start
        step = np.linalg.solve(normal, np.einsum("iyx,yx,yx->i", slopes, middle - middle[::-1, ::-1], weight))
        place = place - step
        if np.abs(place - start).max() > radius + 0.5:
            return start
        if np.abs(step).max() < _TOLERANCE_PX:
            break
    return place


def _smoothed_window(grey: Image, place: Array, reach: int) -> Image:
    """Smoothed grey levels (2 reach + 1, 2 reach + 1) at a place and at whole-pixel offsets from it."""
    column, row = np.floor(place).astype(int)
    across, down = (spline_weights(float(fraction), _SPLINE_DEGREE) for fraction in place - np.floor(place))
    before = _SPLINE_DEGREE // 2
    low, high = reach + before, reach + before + 2
    block = grey[row - low : row + high, column - low : column + high]
    smooth = cv2.sepFilter2D(block, cv2.CV_32F, across, down, anchor=(before, before))
    return np.asarray(smooth[before : before + 2 * reach + 1, before : before + 2 * reach + 1])
