"""Grey levels between pixels: an image as a B-spline, its values anywhere and its slopes at the pixels.

The spline of degree 3 or 5 passes through all pixels. Its coefficients come from recursive filters along columns and
rows (Unser, IEEE Signal Processing Magazine 16(6), 1999). Each image is filtered once for all samples.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from dicflow.core.arrays import Array, Grey, Image, Mask
from dicflow.core.kernels import INNER, KERNEL

__all__ = ["FAST_MATH", "PAD", "Spline", "interpolate", "slopes", "spline"]


PAD = 3
"""Rows and columns of mirrored coefficients beyond each border, so that the spline can be sampled up to the border."""
FAST_MATH = {"reassoc", "contract", "nsz", "arcp"}
"""Fast-math flags that allow vectorised sums; NaN and infinity are still handled correctly."""

_POLES = {
    3: (math.sqrt(3.0) - 2.0,),
    5: (
        math.sqrt(67.5 - math.sqrt(4436.25)) + math.sqrt(26.25) - 6.5,
        math.sqrt(67.5 + math.sqrt(4436.25)) - math.sqrt(26.25) - 6.5,
    ),
}
_VALUES_AT_INTEGERS = {3: ([1, 4, 1], 6.0), 5: ([1, 26, 66, 26, 1], 120.0)}
_SLOPES_AT_INTEGERS = {3: ([-1, 0, 1], 2.0), 5: ([-1, -10, 0, 10, 1], 24.0)}
_NEGLIGIBLE_WEIGHT = 1e-9


Weights = tuple[np.float32, np.float32, np.float32, np.float32, np.float32, np.float32]
"""Values of the six quintic B-splines that overlap a point."""


class Spline(NamedTuple):
    """An image that can be sampled between its pixels.

    image : (rows, cols) float32 — grey levels
    coefficients : (rows + 2 PAD, cols + 2 PAD) float32
    degree : 3 or 5
    measured : (rows, cols) bool — pixels that are measured; None for all
    """

    image: Image
    coefficients: Image
    degree: int
    measured: Mask | None = None


def spline(image: Grey, degree: int = 5, measured: Mask | None = None) -> Spline:
    """The B-spline through an image.

    image : (rows, cols) grey; at least PAD + 1 pixels each way
    degree : 3 (bicubic) or 5 (biquintic)
    measured : (rows, cols) bool — pixels that are measured; None for all
    """
    grey = np.ascontiguousarray(image, dtype=np.float32)
    coefficients = grey.copy()
    for _ in range(2):  # along the columns of the image, then along those of its transpose
        for pole in _POLES[degree]:
            _filter_columns(coefficients, pole)
        coefficients = np.asarray(cv2.transpose(coefficients), dtype=np.float32)
    return Spline(
        grey,
        np.pad(coefficients, PAD, mode="reflect"),
        degree,
        None if measured is None else np.ascontiguousarray(measured),
    )


def slopes(image: Spline) -> tuple[Image, Image]:
    """Derivatives of a spline along x and y at the pixels, (rows, cols) float32 each [grey levels per px]."""
    (value, whole), (slope, half) = _VALUES_AT_INTEGERS[image.degree], _SLOPES_AT_INTEGERS[image.degree]
    across, along = np.array(value) / whole, np.array(slope) / half
    inner, filters = slice(PAD, -PAD), ((along, across), (across, along))
    by_x, by_y = (cv2.sepFilter2D(image.coefficients, -1, *pair)[inner, inner] for pair in filters)
    return np.ascontiguousarray(by_x, dtype=np.float32), np.ascontiguousarray(by_y, dtype=np.float32)


def interpolate(image: Spline, xy: npt.ArrayLike) -> Image:
    """Grey levels at points (..., 2) [px]; NaN outside the image."""
    points = np.asarray(xy, dtype=np.float64)
    values = np.full(points.shape[:-1], np.nan, dtype=np.float32)
    _interpolate(image.coefficients, image.degree, points.reshape(-1, 2), values.reshape(-1))
    return values


def _filter_columns(grey: Image, pole: float) -> None:
    """Causal and anticausal filter of one pole along all columns, in place, with mirrored borders."""
    reach = np.arange(math.ceil(math.log(_NEGLIGIBLE_WEIGHT) / math.log(abs(pole))))
    powers, folded = (pole**reach).astype(np.float32), reach % (2 * len(grey) - 2)
    grey *= np.float32((1.0 - pole) * (1.0 - 1.0 / pole))
    grey[0] = powers @ grey[np.minimum(folded, 2 * len(grey) - 2 - folded)]
    _causal_filter(grey, np.float32(pole))
    grey[-1] = np.float32(pole / (pole * pole - 1.0)) * (grey[-1] + np.float32(pole) * grey[-2])
    _anticausal_filter(grey, np.float32(pole))


@njit(**KERNEL)
def _causal_filter(grey: Image, pole: np.float32) -> None:
    """Recursive filter from the first row to the last, in place."""
    for i in range(1, len(grey)):
        for j in range(grey.shape[1]):
            grey[i, j] += pole * grey[i - 1, j]


@njit(**KERNEL)
def _anticausal_filter(grey: Image, pole: np.float32) -> None:
    """Recursive filter from the last row to the first, in place."""
    for i in range(len(grey) - 2, -1, -1):
        for j in range(grey.shape[1]):
            grey[i, j] = pole * (grey[i + 1, j] - grey[i, j])


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def bicubic(c: Image, at: np.uint64, width: np.uint64, t: np.float32, s: np.float32) -> np.float32:
    """Value of the cubic spline of flat coefficients c, of which the 4 × 4 from index ``at`` on contribute.

    width : coefficients per row; t, s : offsets along x and y from the second of the 4 × 4, 0 … 1
    """
    sixth, half, two_thirds, one = np.float32(1 / 6), np.float32(0.5), np.float32(2 / 3), np.float32(1)
    r = one - t
    x0, x1 = sixth * r * r * r, two_thirds + t * t * (half * t - one)
    x2, x3 = two_thirds + r * r * (half * r - one), sixth * t * t * t
    r = one - s
    y0, y1 = sixth * r * r * r, two_thirds + s * s * (half * s - one)
    y2, y3 = two_thirds + r * r * (half * r - one), sixth * s * s * s
    i, j, k = np.uint64(1), np.uint64(2), np.uint64(3)
    at1, at2, at3 = at + width, at + j * width, at + k * width
    value: np.float32 = (
        y0 * (x0 * c[at] + x1 * c[at + i] + x2 * c[at + j] + x3 * c[at + k])
        + y1 * (x0 * c[at1] + x1 * c[at1 + i] + x2 * c[at1 + j] + x3 * c[at1 + k])
        + y2 * (x0 * c[at2] + x1 * c[at2 + i] + x2 * c[at2 + j] + x3 * c[at2 + k])
        + y3 * (x0 * c[at3] + x1 * c[at3 + i] + x2 * c[at3 + j] + x3 * c[at3 + k])
    )
    return value


@njit(nogil=True, fastmath=FAST_MATH, error_model="numpy", forceinline=True)
def quintic_weights(t: np.float32) -> Weights:
    """Values at an offset t, 0 … 1, of the six B-splines of degree 5 that are not zero there."""
    r, scale = np.float32(1) - t, np.float32(1 / 120)
    five, ten, twenty = np.float32(5), np.float32(10), np.float32(20)
    t2 = t * t
    a, b = t2 * t2, r * r
    w0, w5 = scale * b * b * r, scale * a * t
    even, odd = np.float32(26) + twenty * (t2 - a), t * (np.float32(50) - twenty * t2)
    w1 = scale * (even - odd + five * a * t)
    w2 = scale * (np.float32(66) - np.float32(60) * t2 + np.float32(30) * a - ten * a * t)
    w3 = scale * (even + odd + ten * a * t)
    w4 = scale * (np.float32(1) + five * t * (np.float32(1) + t * (np.float32(2) + t * (np.float32(2) + t - t2))))
    return w0, w1, w2, w3, w4, w5


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _weighted_row(
    c: Image,
    at: np.uint64,
    w0: np.float32,
    w1: np.float32,
    w2: np.float32,
    w3: np.float32,
    w4: np.float32,
    w5: np.float32,
) -> np.float32:
    """Weighted sum of the six coefficients from index ``at`` on."""
    one = np.uint64(1)
    at1 = at + one
    at2 = at1 + one
    at3 = at2 + one
    at4 = at3 + one
    value: np.float32 = w0 * c[at] + w1 * c[at1] + w2 * c[at2] + w3 * c[at3] + w4 * c[at4] + w5 * c[at4 + one]
    return value


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def biquintic(c: Image, at: np.uint64, width: np.uint64, t: np.float32, s: np.float32) -> np.float32:
    """Value of the quintic spline of flat coefficients c, of which the 6 × 6 from index ``at`` on contribute.

    width : coefficients per row; t, s : offsets along x and y from the third of the 6 × 6, 0 … 1
    """
    x0, x1, x2, x3, x4, x5 = quintic_weights(t)
    y0, y1, y2, y3, y4, y5 = quintic_weights(s)
    at1 = at + width
    at2 = at1 + width
    at3 = at2 + width
    at4 = at3 + width
    value: np.float32 = (
        y0 * _weighted_row(c, at, x0, x1, x2, x3, x4, x5)
        + y1 * _weighted_row(c, at1, x0, x1, x2, x3, x4, x5)
        + y2 * _weighted_row(c, at2, x0, x1, x2, x3, x4, x5)
        + y3 * _weighted_row(c, at3, x0, x1, x2, x3, x4, x5)
        + y4 * _weighted_row(c, at4, x0, x1, x2, x3, x4, x5)
        + y5 * _weighted_row(c, at4 + width, x0, x1, x2, x3, x4, x5)
    )
    return value


@njit(**KERNEL)
def _interpolate(coefficients: Image, degree: int, points: Array, values: Image) -> None:
    """Write the grey levels at points (n, 2) into values (n,); those outside the image are left unchanged."""
    rows, cols = coefficients.shape[0] - 2 * PAD, coefficients.shape[1] - 2 * PAD
    flat = coefficients.ravel()
    width, before = np.uint64(coefficients.shape[1]), PAD - degree // 2
    for n in range(len(points)):
        x, y = points[n, 0], points[n, 1]
        if not (0.0 <= x <= cols - 1 and 0.0 <= y <= rows - 1):
            continue
        j, i = int(x), int(y)
        at = np.uint64((i + before) * (cols + 2 * PAD) + j + before)
        t, s = np.float32(x - j), np.float32(y - i)
        values[n] = bicubic(flat, at, width, t, s) if degree == 3 else biquintic(flat, at, width, t, s)
