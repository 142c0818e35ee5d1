"""Correlation of subsets: where a square of the reference image lies in a target image, to the noise limit.

Inverse compositional Gauss-Newton (Baker and Matthews, Int. J. Computer Vision 56, 2004; Pan, Li and Tong,
Experimental Mechanics 53, 2013) on the zero-mean normalised sum of squared differences

    ZNSSD = Σ w (f̂ − ĝ)²,   f̂ = (f − f̄)/Δf,   Δf² = Σ w (f − f̄)²,

over the warp of the subset. What brightness and contrast can explain is taken out of the derivatives, so that the
Hessian H is that of the criterion itself, and the covariance of the warp is 2 σ² H⁻¹ for noise of σ grey levels in
both images (Pan et al., Optics Express 16, 2008).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from numba import njit

from dicflow.core.arrays import Array, Image, Mask
from dicflow.core.correlation.gauss_newton import Normal, covariance, iterate, prepare
from dicflow.core.correlation.subset_sums import LANES, Pixels, Places
from dicflow.core.correlation.warp import TERMS
from dicflow.core.photographs.interpolate import Spline, slopes
from dicflow.core.status import Status

__all__ = ["Correlated", "Subset", "Template", "correlate", "template"]


_CHUNK = 512
_GAUSSIAN_PX, _REACH = 0.7, 3
_VALID, _LOW_TEXTURE, _CUT = int(Status.VALID), int(Status.LOW_TEXTURE), int(Status.CUT_SUBSET)


class Subset(NamedTuple):
    """What is compared, and how far.

    size : side of the square, odd [px]
    shape_function : "affine" or "quadratic"
    gaussian : standard deviation of the weight [px]; 0 weighs all pixels alike
    min_share : least share of the square's pixels that must be usable
    iterations : at most so many
    tolerance_px : the warp is found when what is left to correct, the root of its mean square over the subset, is below
        this [px]; the arithmetic reaches some 1e-5
    """

    size: int = 31
    shape_function: str = "affine"
    gaussian: float = 0.0
    min_share: float = 0.5
    iterations: int = 30
    tolerance_px: float = 1e-3


WHOLE = Subset()


class Template(NamedTuple):
    """A reference image, made ready once for all its targets.

    grey, by_x, by_y : (rows, cols) float32 — grey levels and their derivatives
    usable : (rows, cols) bool — pixels that subsets may hold
    unusable : (rows + 1, cols + 1) int32 — how many pixels above and left of a place are not
    """

    grey: Image
    by_x: Image
    by_y: Image
    usable: Mask
    unusable: npt.NDArray[np.int32]


class Correlated(NamedTuple):
    """What correlation found at n points.

    warp : (n, 2, 3 or 6) float64 — of the subset in the target (core.correlation.warp); NaN where none was found
    znssd : (n,) float64 — 0 for a perfect fit, 2 for none, 4 for the negative; NaN where nothing was compared
    iterations : (n,) int16
    status : (n,) uint8 — VALID or the reason
    covariance : (n, 3) float64 — xx, xy and yy of the centre's place in the target for noise of one grey level in both
        images [px² per grey level²]; half of it comes from each image
    contraction : (n,) float64 — the last increment over the one before; NaN where there was but one
    """

    warp: Array
    znssd: Array
    iterations: npt.NDArray[np.int16]
    status: npt.NDArray[np.uint8]
    covariance: Array
    contraction: Array


def template(reference: Spline, usable: Mask | None = None) -> Template:
    """A reference image made ready.

    usable : (rows, cols) bool — the region of interest; all pixels without it
    """
    allowed = np.ones(reference.image.shape, dtype=np.bool_) if usable is None else np.ascontiguousarray(usable)
    unusable = cv2.integral((~allowed).view(np.uint8))
    return Template(reference.image, *_derivatives(reference), allowed, unusable)


def _derivatives(reference: Spline) -> tuple[Image, Image]:
    """Derivatives by a narrow Gaussian, scaled to explain as much as possible of the spline's own.

    What an interpolation gets wrong is the finest grain of the image. Derivatives without it do not answer to such
    errors: the bias of the place falls to a third where the derivatives of the spline itself would be more precise by
    3 % at most. With the scale H remains the Hessian and its inverse the covariance.
    """
    reach = np.arange(-_REACH, _REACH + 1)
    bell = np.exp(-0.5 * (reach / _GAUSSIAN_PX) ** 2)
    value, slope = bell / bell.sum(), reach * bell / (reach**2 * bell).sum()
    by_x = cv2.sepFilter2D(reference.image, -1, slope, value, borderType=cv2.BORDER_REFLECT_101)
    by_y = cv2.sepFilter2D(reference.image, -1, value, slope, borderType=cv2.BORDER_REFLECT_101)
    true_x, true_y = slopes(reference)
    square, product = _dot(by_x, by_x) + _dot(by_y, by_y), _dot(by_x, true_x) + _dot(by_y, true_y)
    scale = np.float32(product / square if square > 0.0 else 1.0)
    return by_x * scale, by_y * scale


def _dot(a: Image, b: Image) -> float:
    """Σ a b, in one order of summation whatever the number of threads."""
    return float(np.sum(a * b, dtype=np.float64))


def correlate(
    reference: Template,
    target: Spline,
    centres: Array,
    start: Array,
    subset: Subset = WHOLE,
    threads: int = 1,
    contraction: float = 1.0,
) -> Correlated:
    """Find subsets of a reference image in a target image.

    centres : (n, 2) — whole pixels of the reference
    start : (n, 2, 3 or 6) — warps to start from, right to a few pixels; a NaN leaves the point untracked
    threads : how many share the points; the result does not depend on it
    contraction : how much smaller the second increment is than the first, as like points have shown; a start that is
        good enough then needs no second one. 1 where it is not known.

    Raises ValueError for an even subset, or starts that do not fit the shape function.
    """
    if subset.size % 2 == 0 or subset.size < 5:
        raise ValueError(f"a subset's side is an odd number of at least 5 px, not {subset.size}")
    if start.shape != (len(centres), 2, TERMS[subset.shape_function]):
        raise ValueError(f"starts of shape {start.shape} do not fit {len(centres)} {subset.shape_function} warps")
    found = _nothing(start)
    pixels, weight = centres.astype(np.int64), _weight(subset)
    control = _Control(
        subset.min_share, subset.iterations, float(subset.tolerance_px), subset.gaussian > 0.0, contraction
    )

    def part(first: int) -> None:
        chunk = slice(first, first + _CHUNK)
        results = Correlated._make(field[chunk] for field in found)
        _correlate(reference, target.coefficients, target.degree, pixels[chunk], start[chunk], weight, control, results)

    firsts = range(0, len(centres), _CHUNK)
    if threads == 1:
        for first in firsts:
            part(first)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(part, firsts))
    return found


def _nothing(start: Array) -> Correlated:
    n = len(start)
    return Correlated(
        np.full(start.shape, np.nan),
        np.full(n, np.nan),
        np.zeros(n, dtype=np.int16),
        np.full(n, Status.UNTRACKED, dtype=np.uint8),
        np.full((n, 3), np.nan),
        np.full(n, np.nan),
    )


def _weight(subset: Subset) -> Image:
    """Weight of each pixel of a whole subset (size, size)."""
    if subset.gaussian <= 0.0:
        return np.ones((subset.size, subset.size), dtype=np.float32)
    offset = np.arange(subset.size) - subset.size // 2
    bell = np.exp(-0.5 * (offset / subset.gaussian) ** 2)
    return np.outer(bell, bell).astype(np.float32)


class _Control(NamedTuple):
    """The numbers of a :class:`Subset` that the loop over points needs."""

    min_share: float
    iterations: int
    tolerance_px: float
    is_weighted: bool
    contraction: float


@njit(cache=True, nogil=True, error_model="numpy")
def _lay_out(weight: Any, p: Any) -> None:
    """Offsets and weights of the pixels of a whole subset."""
    size = len(weight)
    for i in range(size):
        for j in range(size):
            k = i * size + j
            p.xi[k], p.eta[k], p.w[k] = _offset(j, size), _offset(i, size), weight[i, j]


@njit(nogil=True, error_model="numpy", forceinline=True)
def _offset(index: int, size: int) -> Any:
    """Distance from the centre in half sides."""
    return np.float32(index - size // 2) / np.float32(size // 2)


@njit(cache=True, nogil=True, error_model="numpy")
def _gather(reference: Any, row: int, col: int, weight: Any, p: Any) -> int:
    """Collect the usable pixels of a subset; returns how many."""
    size, half, n = len(weight), len(weight) // 2, 0
    rows, cols = reference.usable.shape
    for i in range(max(0, half - row), min(size, rows + half - row)):
        for j in range(max(0, half - col), min(size, cols + half - col)):
            y, x = row + i - half, col + j - half
            if reference.usable[y, x]:
                p.f[n], p.fx[n], p.fy[n] = reference.grey[y, x], reference.by_x[y, x], reference.by_y[y, x]
                p.xi[n], p.eta[n], p.w[n] = _offset(j, size), _offset(i, size), weight[i, j]
                n += 1
    return n


@njit(cache=True, nogil=True, error_model="numpy")
def _copy_square(image: Any, row: int, col: int, size: int, out: Any) -> None:
    """The square of an image around a pixel, as a flat array; one array in and one out, so that rows move at once."""
    top, left = np.uint64(row - size // 2), np.uint64(col - size // 2)
    for i in range(np.uint64(size)):
        first = i * np.uint64(size)
        for j in range(np.uint64(size)):
            out[first + j] = image[top + i, left + j]


@njit(cache=True, nogil=True, error_model="numpy")
def _correlate(
    reference: Any, coefficients: Any, degree: int, centres: Any, start: Any, weight: Any, control: Any, found: Any
) -> None:
    """The loop of :func:`correlate` over points, with one working space for all."""
    size, terms = len(weight), start.shape[2]
    half, room = size // 2, size * size
    grey, geometry = np.empty((3, room), dtype=np.float32), np.empty((6, room), dtype=np.float32)
    one, sampled = np.ones(room, dtype=np.float32), np.zeros((3, room + LANES), dtype=np.float32)
    whole = Pixels(grey[0], grey[1], grey[2], geometry[0], geometry[1], geometry[2])
    cut = Pixels(grey[0], grey[1], grey[2], geometry[3], geometry[4], geometry[5])
    _lay_out(weight, whole)
    places = Places(np.empty(room, dtype=np.uint32), sampled[0], sampled[1], sampled[2])
    square, vector = np.empty((2, 2 * terms, 2 * terms)), np.empty((3, 2 * terms))
    normal = Normal(
        square[0], square[1], vector[0], vector[1], np.empty(3), np.empty(15), np.empty(3 + 2 * terms), vector[2]
    )
    c = np.zeros((2, 6))
    for k in range(len(centres)):
        if not np.isfinite(start[k]).all():
            continue
        p, n = whole, room
        if _is_whole(reference.unusable, centres[k, 1], centres[k, 0], half):
            _copy_square(reference.grey, centres[k, 1], centres[k, 0], size, p.f)
            _copy_square(reference.by_x, centres[k, 1], centres[k, 0], size, p.fx)
            _copy_square(reference.by_y, centres[k, 1], centres[k, 0], size, p.fy)
        else:
            p, n = cut, _gather(reference, centres[k, 1], centres[k, 0], weight, cut)
        if n < control.min_share * room or n < 4 * terms:
            found.status[k] = _CUT
            continue
        if not prepare(p, n, one, normal):
            found.status[k] = _LOW_TEXTURE
            continue
        _set_warp(c, start[k])
        found.status[k], found.iterations[k], found.znssd[k], found.contraction[k] = iterate(
            coefficients, degree, p, n, half, normal, control, places, c
        )
        if found.status[k] == _VALID:
            _set_warp(found.warp[k], c)
            covariance(p, n, one, normal, control.is_weighted, c, found.covariance[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _set_warp(warp: Any, values: Any) -> None:
    """Copy the coefficients that both have; further ones become zero."""
    for i in range(2):
        for j in range(warp.shape[1]):
            warp[i, j] = values[i, j] if j < values.shape[1] else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _is_whole(unusable: Any, row: int, col: int, half: int) -> Any:
    """Whether a square lies in the image and holds no pixel that must not be used."""
    top, left, bottom, right = row - half, col - half, row + half + 1, col + half + 1
    if top < 0 or left < 0 or bottom >= len(unusable) or right >= unusable.shape[1]:
        return False
    return unusable[bottom, right] - unusable[top, right] - unusable[bottom, left] + unusable[top, left] == 0
