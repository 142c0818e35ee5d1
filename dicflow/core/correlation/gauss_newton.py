"""Gauss-Newton for one subset: the steps of correlation (core.correlate), over the sums of core.subset_sums."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from dicflow.core.cholesky import factorise, solve
from dicflow.core.correlation.subset_sums import (
    centre_grey,
    gathered_sums,
    normal_matrix,
    place,
    sample_runs,
    slope_sums,
    sums,
)
from dicflow.core.status import Status

__all__ = ["Normal", "covariance", "iterate", "prepare"]

_SINGULAR = 1e-6
_SCATTERED = 0.2
"""Slip per pixel, along a row of the target or across rows, from which runs are too short to be worth it."""
_VALID, _OUTSIDE, _NOT_CONVERGED = int(Status.VALID), int(Status.OUTSIDE), int(Status.NOT_CONVERGED)


class Normal(NamedTuple):
    """The normal equations of one subset of n pixels.

    factor : (2m, 2m) — the Hessian, then Cholesky's factor of it in the lower triangle
    hessian : (2m, 2m); ones, by_f : (2m,) — Σ w J and Σ w J f; facts : (3,) — mean of f, Σ w, Δf²
    moments : (15,), sums : (3 + 2m,), increment : (2m,) — working space
    """

    factor: Any
    hessian: Any
    ones: Any
    by_f: Any
    facts: Any
    moments: Any
    sums: Any
    increment: Any


@njit(cache=True, nogil=True, error_model="numpy")
def prepare(p: Any, n: int, one: Any, normal: Any) -> Any:
    """Set up the normal equations; False where the subset shows too little to solve them."""
    centre_grey(p, n, normal.facts)
    if not normal.facts[2] > 0.0:
        return False
    normal_matrix(p, n, normal.moments, normal.hessian)
    slope_sums(p, one, n, normal.moments, normal.ones)
    slope_sums(p, p.f, n, normal.moments, normal.by_f)
    _project(normal)
    return factorise(normal.factor, _SINGULAR)


@njit(cache=True, nogil=True, error_model="numpy")
def iterate(
    coefficients: Any, degree: int, p: Any, n: int, half: int, normal: Any, control: Any, places: Any, c: Any
) -> Any:
    """Improve the warp ``c`` until it stays; returns status, iterations, ZNSSD and the ratio of the last increments.

    The increments of Gauss-Newton shrink by a ratio r, so that what is left after one of size e is e r/(1 − r). For the
    first increment r is what ``control.contraction`` says.
    """
    flat, width = coefficients.ravel(), np.uint64(coefficients.shape[1])
    terms, level = len(normal.increment) // 2, np.float32(normal.facts[0])
    last, ratio, znssd = 0.0, np.nan, np.nan
    for iteration in range(1, control.iterations + 1):
        if not place(c, coefficients.shape, degree, p, n, half, places):
            return _OUTSIDE, iteration, znssd, np.nan
        if abs(c[0, 1] - 1.0) + abs(c[1, 1]) < _SCATTERED:
            sample_runs(flat, width, degree, places, n, 2 * half + 1)
            sums(places.g, level, p, n, normal.sums)
        else:
            gathered_sums(flat, width, degree, places, level, p, n, normal.sums)
        znssd = _increment(normal)
        size = _rms_motion(normal.increment)
        if not size < half:
            return _NOT_CONVERGED, iteration, znssd, np.nan
        _update(c, normal.increment, terms, half)
        ratio = size / last if iteration > 1 else np.nan
        shrinks = ratio if iteration > 1 else control.contraction
        if size < control.tolerance_px or size * shrinks < control.tolerance_px * (1.0 - shrinks):
            return _VALID, iteration, znssd, ratio
        last = size
    return _NOT_CONVERGED, control.iterations, znssd, np.nan


@njit(cache=True, nogil=True, error_model="numpy")
def covariance(p: Any, n: int, one: Any, normal: Any, is_weighted: bool, c: Any, out: Any) -> None:
    """2 A (H⁻¹ V H⁻¹) Aᵀ at the centre; V = Σ w² J̃ᵀJ̃ for J̃ of :func:`_weigh_twice`, which is H without weights."""
    if is_weighted:
        _weigh_twice(p, n, one, normal)
    size = len(normal.factor)
    rows = np.zeros((2, size))
    for axis in range(2):
        rows[axis, axis * size // 2] = 1.0
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


@njit(cache=True, nogil=True, error_model="numpy")
def _weigh_twice(p: Any, n: int, one: Any, normal: Any) -> None:
    """Σ w² J̃ᵀJ̃ in the Hessian's place; J̃ = J − J̄/Σw − f (Σ w J f)/Δf² is what brightness and contrast leave of J."""
    size, total, square = len(normal.hessian), normal.facts[1], normal.facts[2]
    ones, by_f = np.empty(size), np.empty(size)
    weights, first, second = 0.0, 0.0, 0.0
    for k in range(n):
        p.w[k] *= p.w[k]
        weights += p.w[k]
        first += p.w[k] * p.f[k]
        second += p.w[k] * p.f[k] * p.f[k]
    normal_matrix(p, n, normal.moments, normal.hessian)
    slope_sums(p, one, n, normal.moments, ones)
    slope_sums(p, p.f, n, normal.moments, by_f)
    for k in range(n):
        p.w[k] = np.sqrt(p.w[k])
    for i in range(size):
        a, b = normal.ones[i] / total, normal.by_f[i] / square
        for j in range(size):
            d, e = normal.ones[j] / total, normal.by_f[j] / square
            crossed = a * ones[j] + ones[i] * d + b * by_f[j] + by_f[i] * e
            normal.hessian[i, j] += weights * a * d + first * (a * e + b * d) + second * b * e - crossed


@njit(cache=True, nogil=True, error_model="numpy")
def _project(normal: Any) -> None:
    """Take out of the Hessian what brightness and contrast explain: H − J̄J̄ᵀ/Σw − (Σ w J f)(Σ w J f)ᵀ/Δf²."""
    total, square = normal.facts[1], normal.facts[2]
    for i in range(len(normal.hessian)):
        for j in range(len(normal.hessian)):
            light = normal.ones[i] * normal.ones[j] / total + normal.by_f[i] * normal.by_f[j] / square
            normal.hessian[i, j] -= light
            normal.factor[i, j] = normal.hessian[i, j]


@njit(cache=True, nogil=True, error_model="numpy")
def _increment(normal: Any) -> Any:
    """The Gauss-Newton increment from the sums over the target's grey levels; returns the ZNSSD."""
    target, total, square = normal.sums, normal.facts[1], normal.facts[2]
    mean = target[0] / total
    other = target[1] - mean * target[0]
    if not other > 0.0:
        normal.increment[:] = np.nan
        return np.nan
    gain = np.sqrt(square / other)
    fit = gain * target[2] / square
    for i in range(len(normal.increment)):
        normal.increment[i] = gain * (target[3 + i] - mean * normal.ones[i]) - normal.by_f[i] * fit
    solve(normal.factor, normal.increment)
    return 2.0 * (1.0 - fit)


@njit(cache=True, nogil=True, error_model="numpy")
def _rms_motion(d: Any) -> Any:
    """Root of the mean square, over the subset, of the motion that an increment gives to its pixels [px]."""
    square, terms = 0.0, len(d) // 2
    for i in (0, terms):
        square += d[i] * d[i] + (d[i + 1] * d[i + 1] + d[i + 2] * d[i + 2]) / 3.0
        if terms == 6:
            xx, xy, yy = d[i + 3], d[i + 4], d[i + 5]
            square += 2.0 * d[i] * (xx + yy) / 3.0 + (xx * xx + yy * yy) / 5.0 + (xy * xy + 2.0 * xx * yy) / 9.0
    return np.sqrt(square)


@njit(cache=True, nogil=True, error_model="numpy")
def _update(c: Any, d: Any, terms: int, half: int) -> None:
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
