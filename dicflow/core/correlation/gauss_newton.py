"""Gauss-Newton for one subset of :mod:`dicflow.core.correlation.subsets`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Image
from dicflow.core.cholesky import factorise, solve
from dicflow.core.correlation.lattice_sums import LatticeSums
from dicflow.core.correlation.residuals import Residuals, set_residuals
from dicflow.core.correlation.sampling import Places, copy_patch, locate_pixels, sample_runs, sample_scattered
from dicflow.core.correlation.subset_sums import (
    Pixels,
    centre_grey,
    gathered_sums,
    grey_sums,
    normal_matrix,
    set_block,
    slope_sums,
)
from dicflow.core.kernels import INNER, MAKER
from dicflow.core.status import Status

__all__ = ["Control", "NormalEquations", "covariance", "iterate", "mean_square_slope", "prepare"]

_MIN_PIVOT_SHARE = 1e-6
"""Of the Hessian; with a smaller pivot the subset has too little texture."""
_MAX_SLIP_OF_RUNS = 0.4
"""Slip per pixel, along a row of the target or across rows, up to which runs are long enough to be faster."""
_ROUNDING = 1e-6
"""Share of a sum of squares that its rounding may reach: a plain target has a contrast below it."""
_VALID, _OUTSIDE, _NOT_CONVERGED = int(Status.VALID), int(Status.OUTSIDE), int(Status.NOT_CONVERGED)


class Control(NamedTuple):
    """Settings of the iteration; see :class:`dicflow.core.correlation.subsets.Subset` and ``correlate`` there.

    half : pixels from the centre of a subset to its side
    min_pixels : least number of pixels that determine a warp
    """

    degree: int
    half: int
    min_share: float
    min_pixels: int
    iterations: int
    tolerance_px: float
    is_weighted: bool
    contraction: float


class NormalEquations(NamedTuple):
    """The normal equations of one subset of n pixels, for a shape function of m terms per coordinate.

    factor : (2m, 2m) — the Hessian, then Cholesky's factor of it in the lower triangle
    hessian : (2m, 2m); slope_sums, slope_grey_sums : (2m,) — Σ w J and Σ w J f
    statistics : (3,) — mean of f, Σ w, Δf²
    moments : (15,), grey_sums : (3 + 2m,), increment : (2m,), rows : (2, 2m) — working space
    """

    factor: Array
    hessian: Array
    slope_sums: Array
    slope_grey_sums: Array
    statistics: Array
    moments: Array
    grey_sums: Array
    increment: Array
    rows: Array


@njit(error_model="numpy", **INNER)
def prepare(p: Pixels, n: int, ones_like_f: Image, known: tuple[LatticeSums, int], normal: NormalEquations) -> bool:
    """Set up the normal equations; False where the subset has too little texture to solve them.

    known : sums of whole subsets, and the index of those of this one; -1 for none
    """
    centre_grey(p, n, normal.statistics)
    if not normal.statistics[2] > 0.0:
        return False
    if known[1] >= 0:
        _read_sums(known[0].values[known[1]], known[0].level, normal)
    else:
        normal_matrix(p, n, normal.moments, normal.hessian)
        slope_sums(p, ones_like_f, n, normal.moments, normal.slope_sums)
        slope_sums(p, p.f, n, normal.moments, normal.slope_grey_sums)
    _project(normal)
    return bool(factorise(normal.factor, _MIN_PIVOT_SHARE))


@njit(error_model="numpy", **INNER)
def _read_sums(known: Image, level: float, normal: NormalEquations) -> None:
    """Set the sums over a whole subset from known ones (sums,), in which f lacks a level in the place of its mean."""
    size = len(normal.increment)
    products, at = 6 if size == 6 else 15, 2 * size
    for i in range(size):
        normal.slope_sums[i] = known[i]
        normal.slope_grey_sums[i] = known[size + i] - (normal.statistics[0] - level) * known[i]
    for a in range(2):
        for b in range(a, 2):
            for k in range(products):
                normal.moments[k] = known[at + k]
            set_block(normal.hessian, a, b, normal.moments)
            at += products


@njit(error_model="numpy", **INNER)
def iterate(
    coefficients: Image,
    p: Pixels,
    n: int,
    normal: NormalEquations,
    control: Control,
    places: Places,
    c: Array,
    rest: tuple[Residuals, int],
) -> tuple[int, int, float, float]:
    """Improve the warp ``c`` until it converges; returns status, iterations, ZNSSD and ratio of the last increments.

    rest : residuals, and which of them to set instead; without room the warp is improved

    Gauss-Newton increments shrink by a ratio r, so the correction that remains after one of size e is e r/(1 − r). For
    the first increment, r is ``control.contraction``.
    """
    terms, half, level = len(normal.increment) // 2, control.half, np.float32(normal.statistics[0])
    last_size, ratio, znssd, is_compared = 0.0, np.nan, np.nan, len(rest[0].f) > 0
    for iteration in range(1, control.iterations + 1):
        if not locate_pixels(c, coefficients.shape, p.xi, p.eta, n, half, places):
            return _OUTSIDE, iteration, znssd, np.nan
        is_slow = abs(c[0, 1] - 1.0) + abs(c[1, 1]) >= _MAX_SLIP_OF_RUNS and not is_compared
        in_runs = not is_slow and copy_patch(coefficients, c, places)
        if in_runs:
            sample_runs(control.degree, c, half, p.row_rest, n, places)
        if is_compared:
            if not in_runs:
                sample_scattered(coefficients, c, control.degree, n, places)
            set_residuals(p, n, places, half, rest[0], rest[1])
            return _VALID, 0, znssd, ratio
        if in_runs:
            grey_sums(places.g, level, p, n, normal.grey_sums)
        else:
            gathered_sums(coefficients, c, control.degree, places, level, p, n, normal.grey_sums)
        znssd = _increment(normal)
        size = _rms_motion(normal.increment)
        if not size < half:
            return _NOT_CONVERGED, iteration, znssd, np.nan
        _update(c, normal.increment, terms, half)
        ratio = size / last_size if iteration > 1 else np.nan
        shrinks = ratio if iteration > 1 else control.contraction
        if size < control.tolerance_px or size * shrinks < control.tolerance_px * (1.0 - shrinks):
            return _VALID, iteration, znssd, ratio
        last_size = size
    return _NOT_CONVERGED, control.iterations, znssd, np.nan


@njit(error_model="numpy", **INNER)
def covariance(
    p: Pixels, n: int, ones_like_f: Image, normal: NormalEquations, is_weighted: bool, c: Array, out: Array
) -> None:
    """2 A (H⁻¹ V H⁻¹) Aᵀ at the centre; V = Σ w² J̃ᵀJ̃ for J̃ of :func:`_weigh_twice`, which is H without weights."""
    if is_weighted:
        _weigh_twice(p, n, ones_like_f, normal)
    size, rows = len(normal.factor), normal.rows
    for axis in range(2):
        for i in range(size):
            rows[axis, i] = 1.0 if i == axis * size // 2 else 0.0
        solve(normal.factor, rows[axis])
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(size):
        for j in range(size):
            xx += rows[0, i] * normal.hessian[i, j] * rows[0, j]
            xy += rows[0, i] * normal.hessian[i, j] * rows[1, j]
            yy += rows[1, i] * normal.hessian[i, j] * rows[1, j]
    a, b, e, f = c[0, 1], c[0, 2], c[1, 1], c[1, 2]
    out[0] = 2.0 * (a * a * xx + 2.0 * a * b * xy + b * b * yy)
    out[1] = 2.0 * (a * e * xx + (a * f + b * e) * xy + b * f * yy)
    out[2] = 2.0 * (e * e * xx + 2.0 * e * f * xy + f * f * yy)


@njit(error_model="numpy", **INNER)
def mean_square_slope(normal: NormalEquations) -> float:
    """Mean square of the slope of the grey levels, without what brightness and contrast explain [grey levels² per px²].

    To be read before :func:`covariance`, which may replace the Hessian.
    """
    terms = len(normal.increment) // 2
    return float((normal.hessian[0, 0] + normal.hessian[terms, terms]) / normal.statistics[1])


@njit(error_model="numpy", **MAKER)
def _weigh_twice(p: Pixels, n: int, ones_like_f: Image, normal: NormalEquations) -> None:
    """Replace the Hessian by Σ w² J̃ᵀJ̃; J̃ = J − J̄/Σw − f (Σ w J f)/Δf² is J without brightness and contrast."""
    size, total, square = len(normal.hessian), normal.statistics[1], normal.statistics[2]
    slope, slope_grey = np.empty(size), np.empty(size)
    weights, first, second = 0.0, 0.0, 0.0
    for k in range(n):
        p.w[k] *= p.w[k]
        weights += p.w[k]
        first += p.w[k] * p.f[k]
        second += p.w[k] * p.f[k] * p.f[k]
    normal_matrix(p, n, normal.moments, normal.hessian)
    slope_sums(p, ones_like_f, n, normal.moments, slope)
    slope_sums(p, p.f, n, normal.moments, slope_grey)
    for k in range(n):
        p.w[k] = np.sqrt(p.w[k])
    for i in range(size):
        a, b = normal.slope_sums[i] / total, normal.slope_grey_sums[i] / square
        for j in range(size):
            d, e = normal.slope_sums[j] / total, normal.slope_grey_sums[j] / square
            crossed = a * slope[j] + slope[i] * d + b * slope_grey[j] + slope_grey[i] * e
            normal.hessian[i, j] += weights * a * d + first * (a * e + b * d) + second * b * e - crossed


@njit(error_model="numpy", **INNER)
def _project(normal: NormalEquations) -> None:
    """Subtract from the Hessian the part by brightness and contrast: H − J̄J̄ᵀ/Σw − (Σ w J f)(Σ w J f)ᵀ/Δf²."""
    total, square = normal.statistics[1], normal.statistics[2]
    for i in range(len(normal.hessian)):
        for j in range(len(normal.hessian)):
            by_brightness = normal.slope_sums[i] * normal.slope_sums[j] / total
            by_contrast = normal.slope_grey_sums[i] * normal.slope_grey_sums[j] / square
            normal.hessian[i, j] -= by_brightness + by_contrast
            normal.factor[i, j] = normal.hessian[i, j]


@njit(error_model="numpy", **INNER)
def _increment(normal: NormalEquations) -> float:
    """Compute the Gauss-Newton increment from the sums over the target's grey levels; returns the ZNSSD."""
    target, total, square = normal.grey_sums, normal.statistics[1], normal.statistics[2]
    mean = target[0] / total
    other = target[1] - mean * target[0]
    if not other > _ROUNDING * target[1]:
        for i in range(len(normal.increment)):
            normal.increment[i] = np.nan
        return np.nan
    gain = np.sqrt(square / other)
    fit = gain * target[2] / square
    for i in range(len(normal.increment)):
        normal.increment[i] = gain * (target[3 + i] - mean * normal.slope_sums[i]) - normal.slope_grey_sums[i] * fit
    solve(normal.factor, normal.increment)
    return float(2.0 * (1.0 - fit))


@njit(error_model="numpy", **INNER)
def _rms_motion(d: Array) -> float:
    """RMS, over the subset, of the motion of its pixels by an increment [px]."""
    square, terms = 0.0, len(d) // 2
    for i in (0, terms):
        square += d[i] * d[i] + (d[i + 1] * d[i + 1] + d[i + 2] * d[i + 2]) / 3.0
        if terms == 6:
            xx, xy, yy = d[i + 3], d[i + 4], d[i + 5]
            square += 2.0 * d[i] * (xx + yy) / 3.0 + (xx * xx + yy * yy) / 5.0 + (xy * xy + 2.0 * xx * yy) / 9.0
    return float(np.sqrt(square))


@njit(error_model="numpy", **INNER)
def _update(c: Array, d: Array, terms: int, half: int) -> None:
    """Compose a warp with the inverse of an increment, in place, to second order in the offsets.

    c : (2, 6) — warp; d : (2 terms,) — increment in offsets of half sides
    """
    h, m = float(half), terms
    a, b, e, f = 1.0 + d[1] / h, d[2] / h, d[m + 1] / h, 1.0 + d[m + 2] / h
    determinant = a * f - b * e
    ia, ib, ie, if_ = f / determinant, -b / determinant, -e / determinant, a / determinant
    rx, ry = -(ia * d[0] + ib * d[m]), -(ie * d[0] + if_ * d[m])
    for i in range(2):
        c0, cx, cy, cxx, cxy, cyy = c[i, 0], c[i, 1], c[i, 2], c[i, 3], c[i, 4], c[i, 5]
        gx, gy = cx + 2.0 * cxx * rx + cxy * ry, cy + cxy * rx + 2.0 * cyy * ry
        c[i, 0] = c0 + rx * (cx + cxx * rx + cxy * ry) + ry * (cy + cyy * ry)
        c[i, 1], c[i, 2] = gx * ia + gy * ie, gx * ib + gy * if_
        if m == 6:
            c[i, 3] = cxx * ia * ia + cxy * ia * ie + cyy * ie * ie - (gx * d[3] + gy * d[9]) / (h * h)
            c[i, 4] = 2.0 * cxx * ia * ib + cxy * (ia * if_ + ib * ie) + 2.0 * cyy * ie * if_
            c[i, 4] -= (gx * d[4] + gy * d[10]) / (h * h)
            c[i, 5] = cxx * ib * ib + cxy * ib * if_ + cyy * if_ * if_ - (gx * d[5] + gy * d[11]) / (h * h)
