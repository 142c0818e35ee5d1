"""What remains between the subsets of a reference photograph and the target after their search."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Image
from dicflow.core.correlation.sampling import Places
from dicflow.core.correlation.subset_sums import Pixels
from dicflow.core.kernels import INNER
from dicflow.core.photographs.interpolate import FAST_MATH

__all__ = ["Residuals", "new_residuals", "set_residuals"]


class Residuals(NamedTuple):
    """The residuals of n subsets over the pixels of their squares, row by row, and what they are made of.

    f, residual : (n, pixel) float32 — grey levels of the template minus their mean, and minus those of the target
    weight : (n, pixel) float32 — 0 for pixels that do not count; all their values are 0
    by_x, by_y : (n, pixel) float32 — derivatives of the grey levels
    terms : coefficients of the warp per coordinate
    """

    f: Image
    residual: Image
    weight: Image
    by_x: Image
    by_y: Image
    terms: int


def new_residuals(count: int, size: int, terms: int) -> Residuals:
    """Residuals of so many subsets with sides of so many pixels; all values are 0."""
    arrays = np.zeros((5, count, size**2), dtype=np.float32)
    return Residuals(arrays[0], arrays[1], arrays[2], arrays[3], arrays[4], terms)


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def set_residuals(p: Pixels, n: int, places: Places, half: int, found: Residuals, k: int) -> None:
    """Set all values of the k-th subset from its n pixels. half : pixels from its centre to its side"""
    total, f_mean, g_mean, f_square, g_square = 1e-12, 0.0, 0.0, 0.0, 0.0
    for i in range(n):
        total += p.w[i]
        f_mean += p.w[i] * p.f[i]
        g_mean += p.w[i] * places.g[i]
    f_mean, g_mean = f_mean / total, g_mean / total
    for i in range(n):
        f_square += p.w[i] * (p.f[i] - f_mean) ** 2
        g_square += p.w[i] * (places.g[i] - g_mean) ** 2
    gain, side = np.sqrt(f_square / max(g_square, 1e-12 * total)), 2 * half + 1
    for i in range(n):
        at = int(np.rint((p.eta[i] + 1.0) * half)) * side + int(np.rint((p.xi[i] + 1.0) * half))
        found.f[k, at] = p.f[i] - f_mean
        found.residual[k, at] = (p.f[i] - f_mean) - gain * (places.g[i] - g_mean)
        found.weight[k, at], found.by_x[k, at], found.by_y[k, at] = p.w[i], p.fx[i], p.fy[i]
