"""A reference photograph prepared for correlation, and the pixels of its subsets.

A subset has the pixels of its square that are measured and lie in its own part of the region: those connected with its
centre inside the square. So it never reaches across a gap in the region, such as a crack, from one side to the other.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Bytes, Counts, Image, Mask
from dicflow.core.correlation.subset_sums import Pixels
from dicflow.core.kernels import INNER
from dicflow.core.photographs.interpolate import PAD, Spline, slopes
from dicflow.core.threads import over

__all__ = [
    "CLEAR_MARGIN_PX",
    "Template",
    "copy_square",
    "count_rows",
    "gather_part",
    "is_whole",
    "keep_measured",
    "kernel_mask",
    "lay_out",
    "shows_measured",
    "template",
    "with_usable",
]


CLEAR_MARGIN_PX = 4.0
"""Margin around a subset in which the target is looked at for pixels that are not measured [px]."""
_DERIVATIVE_SIGMA_PX, _DERIVATIVE_REACH_PX = 0.7, 3
"""Standard deviation, and half the support, of the Gaussian in the derivatives of the template."""
_MIRRORED = cv2.BORDER_REFLECT_101
_STRIP_PX = 128
"""Rows whose derivatives are compared at once: fetching memory for those of a whole photograph takes longer."""
_BESIDE, _IN_REGION, _IN_PART = 0, 1, 2
"""Pixels of a square: outside the region, in it, and connected with the centre."""


class Template(NamedTuple):
    """A reference photograph prepared for correlation with any target.

    grey, by_x, by_y : (rows, cols) float32 — grey levels and their derivatives
    usable : (rows, cols) bool — pixels that subsets may contain: measured, and in the region
    unusable : (rows + 1, cols + 1) int32 — number of other pixels above and left of a place
    region : (rows, cols) bool — pixels of the region, measured or not
    """

    grey: Image
    by_x: Image
    by_y: Image
    usable: Mask
    unusable: Counts
    region: Mask


def template(reference: Spline, region: Mask | None = None, threads: int = 1) -> Template:
    """The template of a reference photograph.

    region : (rows, cols) bool — the region of interest; None for all pixels
    threads : how many share the work; the result does not depend on it
    """
    inside = np.ones(reference.image.shape, dtype=np.bool_) if region is None else np.ascontiguousarray(region)
    usable = inside if reference.measured is None else inside & reference.measured
    return Template(reference.image, *_derivatives(reference, threads), usable, _count_of_others(usable), inside)


def with_usable(whole: Template, usable: Mask) -> Template:
    """The template with other pixels (rows, cols) that subsets may contain."""
    return whole._replace(usable=usable, unusable=_count_of_others(usable))


def _count_of_others(usable: Mask) -> Counts:
    return np.asarray(cv2.integral((~usable).view(np.uint8)))


def kernel_mask(measured: Mask | None) -> Mask:
    """The pixels of a photograph that are measured (rows, cols), as kernels take them: an empty mask for None, all."""
    return np.zeros((0, 0), dtype=np.bool_) if measured is None else measured


def _derivatives(reference: Spline, threads: int) -> tuple[Image, Image]:
    """Derivatives (rows, cols) along x and y by a narrow Gaussian, scaled to fit the spline's own best.

    Interpolation errors are in the finest detail of the image. Derivatives without it do not respond to them: the bias
    of the place falls to a third, while the derivatives of the spline itself would be at most 3 % more precise. With
    the scale, H remains the Hessian and its inverse the covariance.
    """
    reach = np.arange(-_DERIVATIVE_REACH_PX, _DERIVATIVE_REACH_PX + 1)
    gaussian = np.exp(-0.5 * (reach / _DERIVATIVE_SIGMA_PX) ** 2)
    value, slope = gaussian / gaussian.sum(), reach * gaussian / (reach**2 * gaussian).sum()
    filters = (slope, value), (value, slope)
    found = over(threads, lambda pair: cv2.sepFilter2D(reference.image, -1, *pair, borderType=_MIRRORED), filters)

    def sums(top: int) -> list[tuple[float, float]]:
        rows = slice(top, top + _STRIP_PX)
        strip = reference._replace(coefficients=reference.coefficients[top : top + _STRIP_PX + 2 * PAD])
        return [
            (_dot(one[rows], one[rows]), _dot(one[rows], true)) for one, true in zip(found, slopes(strip), strict=True)
        ]

    square, product = np.sum(over(threads, sums, range(0, len(reference.image), _STRIP_PX)), axis=(0, 1))
    for one in found:
        one *= np.float32(product / square if square > 0.0 else 1.0)
    by_x, by_y = found
    return by_x, by_y


def _dot(a: Image, b: Image) -> float:
    """Σ a b, each row's in single precision."""
    return float(np.einsum("ij,ij->i", a, b).sum(dtype=np.float64))


@njit(error_model="numpy", **INNER)
def lay_out(weight: Image, p: Pixels) -> None:
    """Set offsets and weights of the pixels of a whole subset."""
    size = len(weight)
    for i in range(size):
        for j in range(size):
            k = i * size + j
            p.xi[k], p.eta[k], p.w[k] = _offset(j, size), _offset(i, size), weight[i, j]
    count_rows(p, size * size, size // 2)


@njit(error_model="numpy", **INNER)
def count_rows(p: Pixels, n: int, half: int) -> None:
    """Set how many of n pixels follow each other in a row from each on."""
    p.row_rest[n - 1], step = 1, 1.5 / half
    for k in range(n - 2, -1, -1):
        follows = p.eta[k + 1] == p.eta[k] and p.xi[k + 1] - p.xi[k] < step
        p.row_rest[k] = p.row_rest[k + 1] + 1 if follows else 1


@njit(error_model="numpy", **INNER)
def _offset(index: int, size: int) -> np.float32:
    """Distance from the centre in half sides."""
    return np.float32(index - size // 2) / np.float32(size // 2)


@njit(error_model="numpy", **INNER)
def copy_square(image: Image, row: int, col: int, size: int, out: Image) -> None:
    """Copy the square around a pixel into a flat array; a single array each way lets the compiler copy whole rows."""
    top, left = np.uint64(row - size // 2), np.uint64(col - size // 2)
    for i in range(np.uint64(size)):
        first = i * np.uint64(size)
        for j in range(np.uint64(size)):
            out[first + j] = image[top + i, left + j]


@njit(error_model="numpy", **INNER)
def gather_part(reference: Template, row: int, col: int, weight: Image, p: Pixels, square: Bytes) -> tuple[int, int]:
    """Collect the usable pixels of a subset in its own part; returns their number, and that of all pixels of the part.

    square : (size, size) — working space
    """
    size, half, n = len(weight), len(weight) // 2, 0
    in_part = _mark_part(reference.region, row, col, square)
    for i in range(size):
        for j in range(size):
            y, x = row + i - half, col + j - half
            if square[i, j] == _IN_PART and reference.usable[y, x]:
                p.f[n], p.fx[n], p.fy[n] = reference.grey[y, x], reference.by_x[y, x], reference.by_y[y, x]
                p.xi[n], p.eta[n], p.w[n] = _offset(j, size), _offset(i, size), weight[i, j]
                n += 1
    return n, in_part


@njit(error_model="numpy", **INNER)
def _mark_part(region: Mask, row: int, col: int, square: Bytes) -> int:
    """Mark the pixels of a square (size, size) that are connected with its centre; returns their number.

    If the centre is not in the region, the nearest pixel that is takes its place.
    """
    size, half = len(square), len(square) // 2
    rows, cols = region.shape
    inside, nearest, seed_row, seed_col = 0, 2 * size * size, 0, 0
    for i in range(size):
        for j in range(size):
            y, x = row + i - half, col + j - half
            square[i, j] = _BESIDE
            if 0 <= y < rows and 0 <= x < cols and region[y, x]:
                square[i, j] = _IN_REGION
                inside += 1
                away = (i - half) ** 2 + (j - half) ** 2
                if away < nearest:
                    nearest, seed_row, seed_col = away, i, j
    if inside == 0:
        return 0
    square[seed_row, seed_col] = _IN_PART
    in_part, before = 1, 0
    while in_part > before:
        before = in_part
        in_part += _spread(square, 1) + _spread(square, -1)
    return in_part


@njit(error_model="numpy", **INNER)
def _spread(square: Bytes, step: int) -> int:
    """Spread the part to neighbours in one sweep, forwards or backwards; returns the number of pixels gained."""
    size, gained = len(square), 0
    first = 0 if step > 0 else size - 1
    for k in range(size):
        i = first + step * k
        for m in range(size):
            j = first + step * m
            if square[i, j] == _IN_REGION and (
                (k > 0 and square[i - step, j] == _IN_PART) or (m > 0 and square[i, j - step] == _IN_PART)
            ):
                square[i, j] = _IN_PART
                gained += 1
    return gained


@njit(error_model="numpy", **INNER)
def shows_measured(measured: Mask, c: Array, half: int) -> bool:
    """Whether all pixels of a target within a subset with the warp c (2, 6), and a margin around it, are measured."""
    rows, cols = measured.shape
    reach_x = (
        half * (abs(c[0, 1]) + abs(c[0, 2]))
        + half * half * (abs(c[0, 3]) + abs(c[0, 4]) + abs(c[0, 5]))
        + CLEAR_MARGIN_PX
    )
    reach_y = (
        half * (abs(c[1, 1]) + abs(c[1, 2]))
        + half * half * (abs(c[1, 3]) + abs(c[1, 4]) + abs(c[1, 5]))
        + CLEAR_MARGIN_PX
    )
    top, bottom = max(0.0, c[1, 0] - reach_y), min(rows - 1.0, c[1, 0] + reach_y)
    left, right = max(0.0, c[0, 0] - reach_x), min(cols - 1.0, c[0, 0] + reach_x)
    for y in range(int(top), int(bottom) + 1):
        for x in range(int(left), int(right) + 1):
            if not measured[y, x]:
                return False
    return True


@njit(error_model="numpy", **INNER)
def keep_measured(p: Pixels, n: int, c: Array, half: int, measured: Mask) -> int:
    """Drop the pixels of a subset that a warp c (2, 6) puts next to one that is not measured; returns how many remain.

    Those that it puts outside the target are kept.
    """
    rows, cols = measured.shape
    h, kept = float(half), 0
    for k in range(n):
        xi, eta = h * p.xi[k], h * p.eta[k]
        x = c[0, 0] + xi * (c[0, 1] + c[0, 3] * xi + c[0, 4] * eta) + eta * (c[0, 2] + c[0, 5] * eta)
        y = c[1, 0] + xi * (c[1, 1] + c[1, 3] * xi + c[1, 4] * eta) + eta * (c[1, 2] + c[1, 5] * eta)
        if 0.0 <= x < cols - 1.0 and 0.0 <= y < rows - 1.0:
            j, i = int(x), int(y)
            if not (measured[i, j] and measured[i, j + 1] and measured[i + 1, j] and measured[i + 1, j + 1]):
                continue
        p.f[kept], p.fx[kept], p.fy[kept] = p.f[k], p.fx[k], p.fy[k]
        p.xi[kept], p.eta[kept], p.w[kept] = p.xi[k], p.eta[k], p.w[k]
        kept += 1
    return kept


@njit(error_model="numpy", **INNER)
def is_whole(unusable: Counts, row: int, col: int, half: int) -> bool:
    """Whether a square lies in the image and all its pixels are usable."""
    top, left, bottom, right = row - half, col - half, row + half + 1, col + half + 1
    if top < 0 or left < 0 or bottom >= len(unusable) or right >= unusable.shape[1]:
        return False
    count = unusable[bottom, right] - unusable[top, right] - unusable[bottom, left] + unusable[top, left]
    return bool(count == 0)
