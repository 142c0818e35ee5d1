"""Refinement of matched positions to a few hundredths of a pixel, by correlation of the windows around them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numba import njit
from scipy.ndimage import spline_filter

from dicflow.core.arrays import Array, Grey, Image
from dicflow.core.kernels import INNER, KERNEL

__all__ = ["Refinable", "RefinedMatches", "refinable", "refine_matches"]


MAX_ITERATIONS = 20
_ONE, _TWO = np.uint64(1), np.uint64(2)
CONVERGED_PX = 1e-3
SMOOTHING_PX = 1.0  # reduces the bias of interpolation by noise and fine texture (Pan, Optics Express 21, 2013)


class Refinable(NamedTuple):
    """Two photographs (rows, cols), smoothed: the reference, and the spline coefficients of the deformed one."""

    reference: Image
    coefficients: Image


class RefinedMatches(NamedTuple):
    """Matches after refinement.

    reference : (n, 2) float64 — the pixels nearest to the given reference positions [px]
    deformed : (n, 2) float64 — their positions in the deformed image [px]; NaN where the iterations did not converge
    correlation : (n,) float64 — zero-mean normalised cross-correlation of the two windows; NaN likewise
    """

    reference: Array
    deformed: Array
    correlation: Array


def refinable(reference: Grey, deformed: Grey) -> Refinable:
    """Two photographs (rows, cols), made ready for :func:`refine_matches`."""
    return Refinable(_smoothed(reference), _coefficients(deformed))


def refine_matches(
    images: Refinable,
    reference: Array,
    deformed: Array,
    gradient: Array,
    *,
    window_px: int = 21,
    limit_px: float = 3.0,
) -> RefinedMatches:
    """Positions in the deformed image at which the window around each reference pixel correlates best.

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
        images.reference, images.coefficients, start, moved, gradient, window_px // 2, limit_px
    )
    return RefinedMatches(start, found, correlation)


def _smoothed(image: Grey) -> Image:
    """The image as float32 under a narrow Gaussian."""
    return np.asarray(cv2.GaussianBlur(image.astype(np.float32), (0, 0), SMOOTHING_PX), dtype=np.float32)


def _coefficients(image: Grey) -> Image:
    """Coefficients of the cubic B-spline through the smoothed image."""
    return np.asarray(spline_filter(_smoothed(image), order=3, output=np.float32, mode="mirror"))


@njit(error_model="numpy", **INNER)
def _sample(coefficients: Image, x: float, y: float, gradient: Array, window: Array) -> bool:
    """Fill ``window`` with the cubic B-spline at (x, y) + gradient · offset.

    Returns False if a sample is nearer than 2 px to the border.
    """
    rows, cols = coefficients.shape
    half = len(window) // 2
    for i in range(-half, half + 1):
        for j in range(-half, half + 1):
            p = x + gradient[0, 0] * j + gradient[0, 1] * i
            q = y + gradient[1, 0] * j + gradient[1, 1] * i
            if not (1.0 <= p < cols - 2.0 and 1.0 <= q < rows - 2.0):
                return False
            window[i + half, j + half] = _spline(coefficients, p, q)
    return True


@njit(error_model="numpy", **INNER)
def _row(coefficients: Image, i: np.uint64, j: np.uint64, a: float, b: float, c: float, d: float) -> float:
    """Weighted sum of the four coefficients of row i around column j."""
    value: float = a * coefficients[i, j - _ONE] + b * coefficients[i, j]
    value += c * coefficients[i, j + _ONE]
    value += d * coefficients[i, j + _TWO]
    return value


@njit(error_model="numpy", **INNER)
def _spline(coefficients: Image, x: float, y: float) -> float:
    """Cubic B-spline at (x, y), at least 2 px from the border."""
    j, i = np.uint64(x), np.uint64(y)  # an index without a sign needs no check for one
    u, v = x - np.floor(x), y - np.floor(y)
    a, b, c, d = (1 - u) ** 3, (3 * u - 6) * u * u + 4, ((3 - 3 * u) * u + 3) * u + 1, u**3
    value: float = (1 - v) ** 3 * _row(coefficients, i - _ONE, j, a, b, c, d)
    value += ((3 * v - 6) * v * v + 4) * _row(coefficients, i, j, a, b, c, d)
    value += (((3 - 3 * v) * v + 3) * v + 1) * _row(coefficients, i + _ONE, j, a, b, c, d)
    value += v**3 * _row(coefficients, i + _TWO, j, a, b, c, d)
    return value / 36.0


@njit(error_model="numpy", **INNER)
def _slopes_of_difference(g: Array, scale: float, f: Array, fx: Array, fy: Array) -> tuple[float, float]:
    """Σ fx (scale g − f) and Σ fy (scale g − f) over a window."""
    bx, by = 0.0, 0.0
    for i in range(f.shape[0]):
        for j in range(f.shape[1]):
            difference = g[i, j] * scale - f[i, j]
            bx += fx[i, j] * difference
            by += fy[i, j] * difference
    return bx, by


@njit(**KERNEL)
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
            window -= window.mean()
            other = np.sqrt((window * window).sum())
            if other == 0.0:
                break
            bx, by = _slopes_of_difference(window, norm / other, f, fx, fy)
            dx, dy = (yy * bx - xy * by) / determinant, (xx * by - xy * bx) / determinant
            x -= gradient[n, 0, 0] * dx + gradient[n, 0, 1] * dy
            y -= gradient[n, 1, 0] * dx + gradient[n, 1, 1] * dy
            if np.hypot(dx, dy) < CONVERGED_PX:
                found[n, 0], found[n, 1] = x, y
                correlation[n] = (f * window).sum() / (norm * other)
                break
    return found, correlation
