"""Correlation of subsets: where a square of the reference photograph lies in a target, to the noise limit.

Inverse compositional Gauss-Newton (Baker and Matthews, Int. J. Computer Vision 56, 2004; Pan, Li and Tong,
Experimental Mechanics 53, 2013) on the zero-mean normalised sum of squared differences

    ZNSSD = Σ w (f̂ − ĝ)²,   f̂ = (f − f̄)/Δf,   Δf² = Σ w (f − f̄)²,

over the warp of the subset. The parts of the derivatives that a change of brightness or contrast explains are
subtracted, so that the Hessian H is that of the criterion itself, and the covariance of the warp is 2 σ² H⁻¹ for noise
of σ grey levels in both photographs (Pan et al., Optics Express 16, 2008).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

import cv2
import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Codes, Counts, Image, Index, Iterations, Mask
from dicflow.core.correlation.gauss_newton import Control, NormalEquations, covariance, iterate, prepare
from dicflow.core.correlation.subset_sums import LANES, Pixels, Places
from dicflow.core.correlation.warp import TERMS
from dicflow.core.photographs.interpolate import Spline, slopes
from dicflow.core.status import Status

__all__ = ["Correlated", "Subset", "Template", "correlate", "template"]


_CHUNK = 512
"""Subsets that a thread takes at once."""
_DERIVATIVE_SIGMA_PX, _DERIVATIVE_REACH_PX = 0.7, 3
"""Standard deviation, and half the support, of the Gaussian in the derivatives of the template."""
_VALID, _LOW_TEXTURE, _CUT_SUBSET = int(Status.VALID), int(Status.LOW_TEXTURE), int(Status.CUT_SUBSET)


class Subset(NamedTuple):
    """Size, weight and shape function of subsets, and when their search has converged.

    size : side of the square, odd [px]
    shape_function : "affine" or "quadratic"
    gaussian : standard deviation of the weight of pixels [px]; 0 for equal weights
    min_share : share of the square's pixels that must be usable
    iterations : maximum number
    tolerance_px : converged when the remaining correction, its RMS over the subset, is below this [px]; the arithmetic
        reaches some 1e-5
    """

    size: int = 31
    shape_function: str = "affine"
    gaussian: float = 0.0
    min_share: float = 0.5
    iterations: int = 30
    tolerance_px: float = 1e-3


DEFAULT_SUBSET = Subset()


class Template(NamedTuple):
    """A reference photograph prepared for correlation with any target.

    grey, by_x, by_y : (rows, cols) float32 — grey levels and their derivatives
    usable : (rows, cols) bool — pixels that subsets may contain
    unusable : (rows + 1, cols + 1) int32 — number of other pixels above and left of a place
    """

    grey: Image
    by_x: Image
    by_y: Image
    usable: Mask
    unusable: Counts


class Correlated(NamedTuple):
    """Results of correlation at n points.

    warp : (n, 2, 3 or 6) float64 — of the subset in the target (:mod:`dicflow.core.correlation.warp`); NaN where not
        found
    znssd : (n,) float64 — 0 for a perfect fit, 2 for unrelated patterns, 4 for the negative; NaN where not compared
    iterations : (n,) int16
    status : (n,) uint8 — VALID, or the reason why not found
    covariance : (n, 3) float64 — xx, xy and yy of the centre's place in the target for noise of one grey level in both
        photographs [px² per grey level²]; half of it comes from each
    contraction : (n,) float64 — the last increment over the one before; NaN after a single iteration
    """

    warp: Array
    znssd: Array
    iterations: Iterations
    status: Codes
    covariance: Array
    contraction: Array


def template(reference: Spline, usable: Mask | None = None) -> Template:
    """The template of a reference photograph.

    usable : (rows, cols) bool — the region of interest; None for all pixels
    """
    allowed = np.ones(reference.image.shape, dtype=np.bool_) if usable is None else np.ascontiguousarray(usable)
    unusable = cv2.integral((~allowed).view(np.uint8))
    return Template(reference.image, *_derivatives(reference), allowed, unusable)


def _derivatives(reference: Spline) -> tuple[Image, Image]:
    """Derivatives (rows, cols) along x and y by a narrow Gaussian, scaled to fit the spline's own best.

    Interpolation errors are in the finest detail of the image. Derivatives without it do not respond to them: the bias
    of the place falls to a third, while the derivatives of the spline itself would be at most 3 % more precise. With
    the scale, H remains the Hessian and its inverse the covariance.
    """
    reach = np.arange(-_DERIVATIVE_REACH_PX, _DERIVATIVE_REACH_PX + 1)
    gaussian = np.exp(-0.5 * (reach / _DERIVATIVE_SIGMA_PX) ** 2)
    value, slope = gaussian / gaussian.sum(), reach * gaussian / (reach**2 * gaussian).sum()
    by_x = cv2.sepFilter2D(reference.image, -1, slope, value, borderType=cv2.BORDER_REFLECT_101)
    by_y = cv2.sepFilter2D(reference.image, -1, value, slope, borderType=cv2.BORDER_REFLECT_101)
    true_x, true_y = slopes(reference)
    square, product = _dot(by_x, by_x) + _dot(by_y, by_y), _dot(by_x, true_x) + _dot(by_y, true_y)
    scale = np.float32(product / square if square > 0.0 else 1.0)
    return by_x * scale, by_y * scale


def _dot(a: Image, b: Image) -> float:
    """Σ a b, in one order of summation for any number of threads."""
    return float(np.sum(a * b, dtype=np.float64))


def correlate(
    reference: Template,
    target: Spline,
    centres: Array,
    start: Array,
    subset: Subset = DEFAULT_SUBSET,
    threads: int = 1,
    contraction: float = 1.0,
) -> Correlated:
    """Find subsets of a reference photograph in a target.

    centres : (n, 2) — whole pixels of the reference photograph
    start : (n, 2, 3 or 6) — warps to start from, right to a few pixels; a NaN leaves the point UNTRACKED
    threads : how many share the points; the result does not depend on it
    contraction : expected ratio of the second increment to the first, from similar points; after a good start the
        search then ends without a second one. 1 where it is unknown.

    Raises ValueError for an even subset size, one below 5 px, or starts that do not fit the shape function.
    """
    if subset.size % 2 == 0 or subset.size < 5:
        raise ValueError(f"a subset's side must be an odd number of at least 5 px, got {subset.size}")
    needed = (len(centres), 2, TERMS[subset.shape_function])
    if start.shape != needed:
        raise ValueError(
            f"starts have the shape {start.shape}; {len(centres)} {subset.shape_function} warps need {needed}"
        )
    found = _untracked(start)
    whole_pixels, weight = centres.astype(np.int64), _weight(subset)
    control = Control(
        target.degree,
        subset.min_share,
        subset.iterations,
        float(subset.tolerance_px),
        subset.gaussian > 0.0,
        contraction,
    )

    def correlate_chunk(first: int) -> None:
        chunk = slice(first, first + _CHUNK)
        results = Correlated._make(field[chunk] for field in found)
        _correlate(reference, target.coefficients, whole_pixels[chunk], start[chunk], weight, control, results)

    firsts = range(0, len(centres), _CHUNK)
    if threads == 1:
        for first in firsts:
            correlate_chunk(first)
    else:
        with ThreadPoolExecutor(threads) as pool:
            list(pool.map(correlate_chunk, firsts))
    return found


def _untracked(start: Array) -> Correlated:
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
    gaussian = np.exp(-0.5 * (offset / subset.gaussian) ** 2)
    return np.outer(gaussian, gaussian).astype(np.float32)


@njit(cache=True, nogil=True, error_model="numpy")
def _lay_out(weight: Image, p: Pixels) -> None:
    """Set offsets and weights of the pixels of a whole subset."""
    size = len(weight)
    for i in range(size):
        for j in range(size):
            k = i * size + j
            p.xi[k], p.eta[k], p.w[k] = _offset(j, size), _offset(i, size), weight[i, j]


@njit(nogil=True, error_model="numpy", forceinline=True)
def _offset(index: int, size: int) -> np.float32:
    """Distance from the centre in half sides."""
    return np.float32(index - size // 2) / np.float32(size // 2)


@njit(cache=True, nogil=True, error_model="numpy")
def _gather_usable(reference: Template, row: int, col: int, weight: Image, p: Pixels) -> int:
    """Collect the usable pixels of a subset; returns their number."""
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
def _copy_square(image: Image, row: int, col: int, size: int, out: Image) -> None:
    """Copy the square around a pixel into a flat array; a single array each way lets the compiler copy whole rows."""
    top, left = np.uint64(row - size // 2), np.uint64(col - size // 2)
    for i in range(np.uint64(size)):
        first = i * np.uint64(size)
        for j in range(np.uint64(size)):
            out[first + j] = image[top + i, left + j]


@njit(cache=True, nogil=True, error_model="numpy")
def _correlate(
    reference: Template,
    coefficients: Image,
    centres: Index,
    start: Array,
    weight: Image,
    control: Control,
    found: Correlated,
) -> None:
    """The loop of :func:`correlate` over points, which share one working space."""
    size, terms = len(weight), start.shape[2]
    half, room = size // 2, size * size
    grey, geometry = np.empty((3, room), dtype=np.float32), np.empty((6, room), dtype=np.float32)
    ones_like_f, sampled = np.ones(room, dtype=np.float32), np.zeros((3, room + LANES), dtype=np.float32)
    whole = Pixels(grey[0], grey[1], grey[2], geometry[0], geometry[1], geometry[2])
    cut = Pixels(grey[0], grey[1], grey[2], geometry[3], geometry[4], geometry[5])
    _lay_out(weight, whole)
    places = Places(np.empty(room, dtype=np.uint32), sampled[0], sampled[1], sampled[2])
    square, vector = np.empty((2, 2 * terms, 2 * terms)), np.empty((3, 2 * terms))
    normal = NormalEquations(
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
            p, n = cut, _gather_usable(reference, centres[k, 1], centres[k, 0], weight, cut)
        if n < control.min_share * room or n < 4 * terms:
            found.status[k] = _CUT_SUBSET
            continue
        if not prepare(p, n, ones_like_f, normal):
            found.status[k] = _LOW_TEXTURE
            continue
        _copy_coefficients(c, start[k])
        found.status[k], found.iterations[k], found.znssd[k], found.contraction[k] = iterate(
            coefficients, p, n, half, normal, control, places, c
        )
        if found.status[k] == _VALID:
            _copy_coefficients(found.warp[k], c)
            covariance(p, n, ones_like_f, normal, control.is_weighted, c, found.covariance[k])


@njit(cache=True, nogil=True, error_model="numpy")
def _copy_coefficients(warp: Array, values: Array) -> None:
    """Copy the coefficients of ``values`` into ``warp``; those that it lacks become zero."""
    for i in range(2):
        for j in range(warp.shape[1]):
            warp[i, j] = values[i, j] if j < values.shape[1] else 0.0


@njit(cache=True, nogil=True, error_model="numpy")
def _is_whole(unusable: Counts, row: int, col: int, half: int) -> bool:
    """Whether a square lies in the image and all its pixels are usable."""
    top, left, bottom, right = row - half, col - half, row + half + 1, col + half + 1
    if top < 0 or left < 0 or bottom >= len(unusable) or right >= unusable.shape[1]:
        return False
    count = unusable[bottom, right] - unusable[top, right] - unusable[bottom, left] + unusable[top, left]
    return bool(count == 0)
