"""Refinement of matched positions to a few hundredths of a pixel, by correlation of the windows around them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from scipy.ndimage import spline_filter

from dicflow.core.arrays import Array, Grey, Image
from dicflow.core.kernels import INNER

__all__ = ["RefinedMatches", "refine_matches"]


MAX_ITERATIONS = 20
CONVERGED_PX = 1e-3
SMOOTHING_PX = 1.0  # reduces the bias of interpolation by noise and fine texture (Pan, Optics Express 21, 2013)


class RefinedMatches(NamedTuple):
    """Matches after refinement.

    reference : (n, 2) float64 — the pixels nearest to the given reference positions [px]
    deformed : (n, 2) float64 — their positions in the deformed image [px]; NaN where the iterations did not converge
    correlation : (n,) float64 — zero-mean normalised cross-correlation of the two windows; NaN likewise
    """

    reference: Array
    deformed: Array
    correlation: Array


def refine_matches(
    reference_image: Grey,
    deformed_image: Grey,
    reference: Array,
    deformed: Array,
    gradient: Array,
    *,
    window_px: int = 21,
    limit_px: float = 3.0,
) -> RefinedMatches:
    """Positions in the deformed image at which the window around each reference pixel correlates best.

    reference_image, deformed_image : (rows, cols) grey
    reference, deformed : (n, 2) — matched positions [px]
    gradient : (n, 2, 2) — ∂(deformed)/∂(reference) at each match, which deforms the window; it stays fixed
    window_px : side of the window, odd
    limit_px : largest correction; a match that moves farther is not accepted [px]

    Minimises the zero-mean normalised sum of squared differences over the translation by inverse compositional
    Gauss-Newton steps (Baker and Matthews, Int. J. Computer Vision 56, 2004).
    """
    start = np.rint(reference)
    moved = deformed + np.einsum("nij,nj->ni", gradient, start - reference)
    found, correlation = _refine(
        _smoothed(reference_image), _coefficients(deformed_image), start, moved, gradient, window_px // 2, limit_px
    )
    return RefinedMatches(start, found, correlation)


def _smoothed(image: Grey) -> Image:
    """The image as float32 under a narrow Gaussian."""
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTHING_PX), dtype=np.float32)


def _coefficients(image: Grey) -> Image:
    """Coefficients of the cubic B-spline through the smoothed image."""
    return np.asarray(spline_filter(_smoothed(image), order=3, output=np.float32, mode="mirror"))


@njit(**INNER)
def _spline(coefficients: Image, x: float, y: float) -> float:
    """Cubic B-spline at (x, y); NaN nearer than 2 px to the border."""
    rows, cols = coefficients.shape
    if not (1.0 <= x < cols - 2.0 and 1.0 <= y < rows - 2.0):
        return np.nan
    j, i = int(x), int(y)
    u, v = x - j, y - i
    wx = ((1 - u) ** 3, (3 * u - 6) * u * u + 4, ((3 - 3 * u) * u + 3) * u + 1, u**3)
    wy = ((1 - v) ** 3, (3 * v - 6) * v * v + 4, ((3 - 3 * v) * v + 3) * v + 1, v**3)
    value = 0.0
    for a in range(4):
        row = coefficients[i - 1 + a]
        value += wy[a] * (wx[0] * row[j - 1] + wx[1] * row[j] + wx[2] * row[j + 1] + wx[3] * row[j + 2])
    return value / 36.0


@njit(**INNER)
def _sample(coefficients: Image, x: float, y: float, gradient: Array, window: Array) -> bool:
    """Fill ``window`` with the deformed image at (x, y) + gradient · offset; False if a sample is outside the image."""
    half = len(window) // 2
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            value = _spline(
                coefficients, x + gradient[0, 0] * j + gradient[0, 1] * i, y + gradient[1, 0] * j + gradient[1, 1] * i
            )
            if np.isnan(value):
                return False
            window[i + half, j + half] = value
    return True


@njit(cache=True, nogil=True)
def _refine(
    image: Image, coefficients: Image, start: Array, moved: Array, gradient: Array, half: int, limit: float
) -> tuple[Array, Array]:
    """Positions (n, 2) and correlations (n,) of :func:`refine_matches`."""
    rows, cols = image.shape
    found = np.full(moved.shape, np.nan)
    correlation = np.full(len(moved), np.nan)
    window = np.empty((2 * half + 1, 2 * half + 1))
    for n in range(len(moved)):
        j, i = int(start[n, 0]), int(start[n, 1])
        if j - half < 1 or j + half + 2 > cols or i - half < 1 or i + half + 2 > rows:
            continue
        around = image[i - half - 1 : i + half + 2, j - half - 1 : j + half + 2].astype(np.float64)
        f = around[1:-1, 1:-1] - around[1:-1, 1:-1].mean()
        fx, fy = (around[1:-1, 2:] - around[1:-1, :-2]) / 2, (around[2:, 1:-1] - around[:-2, 1:-1]) / 2
        xx, xy, yy = (fx * fx).sum(), (fx * fy).sum(), (fy * fy).sum()
        norm, determinant = np.sqrt((f * f).sum()), xx * yy - xy * xy
        x, y = moved[n, 0], moved[n, 1]
        if determinant <= 1e-9 * (xx + yy) ** 2:
            continue
        for _ in range(MAX_ITERATIONS):
            if not (
                np.hypot(x - moved[n, 0], y - moved[n, 1]) <= limit and _sample(coefficients, x, y, gradient[n], window)
            ):
                break
            g = window - window.mean()
            other = np.sqrt((g * g).sum())
            if other == 0.0:
                break
            difference = g * (norm / other) - f
            bx, by = (fx * difference).sum(), (fy * difference).sum()
            dx, dy = (yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant
            x -= gradient[n, 0, 0] * dx + gradient[n, 0, 1] * dy
            y -= gradient[n, 1, 0] * dx + gradient[n, 1, 1] * dy
            if np.hypot(dx, dy) < CONVERGED_PX:
                found[n, 0], found[n, 1] = x, y
                correlation[n] = (f * g).sum() / (norm * other)
                break
    return found, correlation
