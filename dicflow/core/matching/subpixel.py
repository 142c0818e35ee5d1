"""Refinement of disparities to a hundredth of a pixel, by one-dimensional matching of windows along the rows.

Semi-global matching interpolates its cost by a parabola, which biases disparities towards whole pixels. Here the right
image is warped by the current disparity and compared with the left one in a window around every pixel (Lucas and
Kanade 1981). The warp uses the disparity of each pixel, so the window follows the slope and curvature of the surface.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from scipy.ndimage import spline_filter1d

from dicflow.core.arrays import Image, Mask
from dicflow.core.kernels import KERNEL

__all__ = ["RefinedDisparity", "refine_disparity"]


_MAX_CORRECTION_PX = 1.0


class RefinedDisparity(NamedTuple):
    """A refined disparity map.

    disparity : (rows, cols) float32 — x_left − x_right [px], NaN where the given one is
    correlation : (rows, cols) float32 — zero-mean normalised cross-correlation of the windows, before the last
        correction; NaN where the window holds no known pixel
    """

    disparity: Image
    correlation: Image


def refine_disparity(
    left: Image, right: Image, disparity: Image, window_px: int = 21, iterations: int = 2
) -> RefinedDisparity:
    """Refine a disparity map that is accurate to about half a pixel.

    In each window the left image is fitted by a R + b ∂R/∂x + c with R the warped right image. The correction of the
    disparity is −b/a, independent of the cameras' contrast and brightness. Pixels with unknown disparity are left out.

    left, right : (rows, cols) float32 — rectified grey levels
    disparity : (rows, cols) float32 — x_left − x_right [px], NaN where unknown
    window_px : side of the window, odd

    Where the correction exceeds 1 px or is unknown, as at a depth edge or without contrast, the given value is kept.
    """
    refined = disparity
    known = np.isfinite(disparity)
    coefficients = spline_filter1d(right, 3, axis=1, output=np.float32, mode="mirror")
    for _ in range(iterations):
        smooth = _window_mean(np.where(known, refined, 0.0), known, window_px)
        grey, slope = _warp_rows(coefficients, smooth)
        correction, correlation = _correction(left, grey, slope, known & np.isfinite(grey), window_px)
        refined = smooth + np.clip(correction, -0.5, 0.5)
        refined = np.where(np.abs(refined - disparity) <= _MAX_CORRECTION_PX, refined, disparity)
    return RefinedDisparity(np.asarray(refined, dtype=np.float32), correlation)


def _window_mean(values: Image, known: Mask, window_px: int) -> Image:
    """Mean of the known values in a window around every pixel; NaN where the window holds none."""
    share = _box(known.astype(np.float32), window_px)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(_box(np.where(known, values, 0.0).astype(np.float32), window_px) / share, dtype=np.float32)


def _correction(left: Image, grey: Image, slope: Image, known: Mask, window_px: int) -> tuple[Image, Image]:
    """−b/a of the fit left ≈ a·grey + b·slope + c in every window, and the correlation of left and grey."""
    share = _box(known.astype(np.float32), window_px)
    images = [np.where(known, image, 0.0).astype(np.float32) for image in (left, grey, slope)]
    with np.errstate(invalid="ignore", divide="ignore"):
        means = [_box(image, window_px) / share for image in images]

        def covariance(i: int, j: int) -> Image:
            return np.asarray(_box(images[i] * images[j], window_px) / share - means[i] * means[j], dtype=np.float32)

        with_grey, with_slope = covariance(0, 1), covariance(0, 2)
        grey_grey, grey_slope, slope_slope = covariance(1, 1), covariance(1, 2), covariance(2, 2)
        a = with_grey * slope_slope - with_slope * grey_slope
        b = with_slope * grey_grey - with_grey * grey_slope
        correlation = with_grey / np.sqrt(covariance(0, 0) * grey_grey)
        return np.asarray(-b / a, dtype=np.float32), np.asarray(correlation, dtype=np.float32)


def _box(image: Image, window_px: int) -> Image:
    """Sum over a window around every pixel, divided by its full area; pixels outside the image count as 0."""
    return np.asarray(cv2.blur(image, (window_px, window_px), borderType=cv2.BORDER_CONSTANT))


@njit(**KERNEL)
def _warp_rows(coefficients: Image, disparity: Image) -> tuple[Image, Image]:
    """Cubic B-spline and its derivative along x at x − disparity in every row; NaN outside the image."""
    rows, cols = disparity.shape
    grey = np.full((rows, cols), np.nan, np.float32)
    slope = np.full((rows, cols), np.nan, np.float32)
    for row in range(rows):
        line = coefficients[row]
        for col in range(cols):
            x = col - disparity[row, col]
            if 1.0 <= x < cols - 2:
                first = int(x)
                t = x - first
                u = 1.0 - t
                a, b, c, d = line[first - 1], line[first], line[first + 1], line[first + 2]
                near, far = (3.0 * t - 6.0) * t * t + 4.0, (3.0 * u - 6.0) * u * u + 4.0
                grey[row, col] = (u * u * u * a + near * b + far * c + t * t * t * d) / 6.0
                near, far = (3.0 * t - 4.0) * t, (4.0 - 3.0 * u) * u
                slope[row, col] = (-u * u * a + near * b + far * c + t * t * d) / 2.0
    return grey, slope
