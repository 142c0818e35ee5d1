"""What remains between the subsets of a reference photograph and the target after their search."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Image, Index, Mask
from dicflow.core.correlation.sampling import (
    Places,
    copy_patch,
    locate_pixels,
    new_places,
    sample_runs,
    sample_scattered,
)
from dicflow.core.correlation.subset_sums import Pixels
from dicflow.core.correlation.subsets import Subset, pixel_weights
from dicflow.core.correlation.template import (
    Template,
    copy_square,
    count_rows,
    gather_part,
    is_whole,
    keep_measured,
    kernel_mask,
    lay_out,
    shows_measured,
)
from dicflow.core.correlation.warp import TERMS
from dicflow.core.kernels import INNER, KERNEL
from dicflow.core.photographs.interpolate import FAST_MATH, Spline

__all__ = ["Residuals", "residuals"]


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


def residuals(reference: Template, target: Spline, centres: Index, warp: Array, subset: Subset) -> Residuals:
    """Residuals of subsets that were found.

    centres : (n, 2) — whole pixels of the template; warp : (n, 2, 3 or 6)
    """
    arrays = np.zeros((5, len(centres), subset.size**2), dtype=np.float32)
    found = Residuals(arrays[0], arrays[1], arrays[2], arrays[3], arrays[4], TERMS[subset.shape_function])
    whole_warp = np.zeros((len(warp), 2, 6))
    whole_warp[..., : warp.shape[-1]] = warp
    photograph = target.coefficients, kernel_mask(target.measured), target.degree
    _compare(reference, photograph, centres, whole_warp, pixel_weights(subset), found)
    return found


@njit(error_model="numpy", **KERNEL)
def _compare(
    reference: Template,
    target: tuple[Image, Mask, int],
    centres: Index,
    warp: Array,
    weight: Image,
    found: Residuals,
) -> None:
    """The loop of :func:`residuals` over subsets, which share one working space.

    target : coefficients and degree of its spline, and its measured pixels (rows, cols); an empty mask if all are
    warp : (n, 2, 6)
    """
    coefficients, measured, degree = target
    size, half, room = len(weight), len(weight) // 2, weight.size
    grey, row_rest = np.empty((9, room), dtype=np.float32), np.empty((2, room), dtype=np.int32)
    whole = Pixels(grey[0], grey[1], grey[2], grey[3], grey[4], grey[5], row_rest[0])
    cut = Pixels(grey[0], grey[1], grey[2], grey[6], grey[7], grey[8], row_rest[1])
    lay_out(weight, whole)
    places, marks = new_places(room), np.empty((size, size), dtype=np.uint8)
    for k in range(len(centres)):
        row, col, c = centres[k, 1], centres[k, 0], warp[k]
        p, n = whole, room
        is_clear = measured.size == 0 or shows_measured(measured, c, half)
        if is_clear and is_whole(reference.unusable, row, col, half):
            copy_square(reference.grey, row, col, size, p.f)
            copy_square(reference.by_x, row, col, size, p.fx)
            copy_square(reference.by_y, row, col, size, p.fy)
        else:
            p = cut
            n, _ = gather_part(reference, row, col, weight, p, marks)
            if measured.size > 0:
                n = keep_measured(p, n, c, half, measured)
            if n > 0:
                count_rows(p, n, half)
        if n > 0 and locate_pixels(c, coefficients.shape, p.xi, p.eta, n, half, places):
            if copy_patch(coefficients, c, places):
                sample_runs(degree, c, half, p.row_rest, n, places)
            else:
                sample_scattered(coefficients, c, degree, n, places)
            _set_residuals(p, n, places, half, found, k)


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _set_residuals(p: Pixels, n: int, places: Places, half: int, found: Residuals, k: int) -> None:
    """Set all values of the k-th subset from its n pixels."""
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
