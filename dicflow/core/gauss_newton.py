"""Gauss-Newton for one subset: the inner loops of correlation (core.correlate), which compiles them.

The pixels of a subset are flat arrays, so that a subset cut by an edge is only a shorter one. Derivatives of the grey
levels by the warp are J = (fx m, fy m) over the monomials m = 1, ξ, η, ξ², ξη, η² with offsets in half sides.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from dicflow.core.interpolate import FAST, PAD, bicubic, biquintic
from dicflow.core.status import Status

__all__ = ["Normal", "Pixels", "Places", "covariance", "iterate", "prepare"]

_VALID, _OUTSIDE, _NOT_CONVERGED = int(Status.VALID), int(Status.OUTSIDE), int(Status.NOT_CONVERGED)


class Pixels(NamedTuple):
    """The pixels of one subset, flat float32 arrays with room for all.

    f, fx, fy : grey level less its mean, and derivatives; xi, eta : offsets in half sides; w : weight
    """

    f: Any
    fx: Any
    fy: Any
    xi: Any
    eta: Any
    w: Any


class Places(NamedTuple):
    """Where the pixels of one subset lie in the target: index of the first coefficient, fractions along x and y."""

    at: Any
    t: Any
    s: Any


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
    _centre_grey(p, n, normal.facts)
    if not normal.facts[2] > 0.0:
        return False
    _normal_matrix(p, n, normal.moments, normal.hessian)
    _slope_sums(p, one, n, normal.moments, normal.ones)
    _slope_sums(p, p.f, n, normal.moments, normal.by_f)
    _project(normal)
    return _factor(normal.factor)


@njit(cache=True, nogil=True, error_model="numpy")
def iterate(
    coefficients: Any, degree: int, p: Any, n: int, half: int, normal: Any, control: Any, places: Any, c: Any
) -> Any:
    """Improve the warp ``c`` until it stays; returns status, iterations and ZNSSD.

    The increments of Gauss-Newton shrink by a ratio r, so that what is left after one of size e is e r/(1 − r).
    """
    flat, width = coefficients.ravel(), np.uint64(coefficients.shape[1])
    terms, level = len(normal.increment) // 2, np.float32(normal.facts[0])
    last, znssd = 0.0, np.nan
    for iteration in range(1, control.iterations + 1):
        if not _place(c, coefficients.shape, degree, p, n, half, places):
            return _OUTSIDE, iteration, znssd
        _compare(flat, width, degree, places, level, p, n, terms, normal.sums)
        znssd = _increment(normal)
        size = _largest_motion(normal.increment)
        if not size < 2.0 * half:
            return _NOT_CONVERGED, iteration, znssd
        _update(c, normal.increment, terms, half)
        if size < control.tolerance_px or size * size < control.tolerance_px * (last - size):
            return _VALID, iteration, znssd
        last = size
    return _NOT_CONVERGED, control.iterations, znssd


@njit(cache=True, nogil=True, error_model="numpy")
def covariance(p: Any, n: int, normal: Any, is_weighted: bool, c: Any, out: Any) -> None:
    """2 A (H⁻¹ V H⁻¹) Aᵀ at the centre; V = Σ w² JᵀJ, which is H where all weights are one."""
    if is_weighted:
        for k in range(n):
            p.w[k] *= p.w[k]
        _normal_matrix(p, n, normal.moments, normal.hessian)
        for k in range(n):
            p.w[k] = np.sqrt(p.w[k])
    size = len(normal.factor)
    rows = np.zeros((2, size))
    for axis in range(2):
        rows[axis, axis * size // 2] = 1.0
        _solve(normal.factor, rows[axis])
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


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _centre_grey(p: Any, n: int, facts: Any) -> None:
    """Take the weighted mean off f; into ``facts`` go the mean, the sum of weights and Δf²."""
    total, first, square = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for k in range(n):
        total += p.w[k]
        first += p.w[k] * p.f[k]
    mean = first / total
    for k in range(n):
        p.f[k] -= mean
    for k in range(n):
        square += p.w[k] * p.f[k] * p.f[k]
    facts[0], facts[1], facts[2] = mean, total, square


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _low_moments(p: Any, a: Any, b: Any, n: int, out: Any) -> None:
    """Σ w a b m over the monomials m of degree 0 to 2."""
    s0, s1, s2 = np.float32(0), np.float32(0), np.float32(0)
    s3, s4, s5 = np.float32(0), np.float32(0), np.float32(0)
    for k in range(n):
        xi, eta = p.xi[k], p.eta[k]
        q = p.w[k] * a[k] * b[k]
        qx, qy = q * xi, q * eta
        s0, s1, s2 = s0 + q, s1 + qx, s2 + qy
        s3, s4, s5 = s3 + qx * xi, s4 + qx * eta, s5 + qy * eta
    out[0], out[1], out[2], out[3], out[4], out[5] = s0, s1, s2, s3, s4, s5


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _high_moments(p: Any, a: Any, b: Any, n: int, out: Any) -> None:
    """Σ w a b m over ξ³, ξ²η, ξη², η³, ξ⁴, ξ³η, ξ²η², ξη³, η⁴, behind those of lower degree."""
    s0, s1, s2, s3 = np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    s4, s5, s6, s7, s8 = np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for k in range(n):
        xi, eta = p.xi[k], p.eta[k]
        q = p.w[k] * a[k] * b[k]
        xx, xy, yy = xi * xi, xi * eta, eta * eta
        qxx, qyy = q * xx, q * yy
        s0, s1, s2, s3 = s0 + qxx * xi, s1 + qxx * eta, s2 + qyy * xi, s3 + qyy * eta
        s4, s5, s6, s7, s8 = s4 + qxx * xx, s5 + qxx * xy, s6 + qxx * yy, s7 + qyy * xy, s8 + qyy * yy
    out[6], out[7], out[8], out[9] = s0, s1, s2, s3
    out[10], out[11], out[12], out[13], out[14] = s4, s5, s6, s7, s8


_PRODUCT = np.array(
    [
        [0, 1, 2, 3, 4, 5],
        [1, 3, 4, 6, 7, 8],
        [2, 4, 5, 7, 8, 9],
        [3, 6, 7, 10, 11, 12],
        [4, 7, 8, 11, 12, 13],
        [5, 8, 9, 12, 13, 14],
    ]
)
"""Which moment the product of two monomials is."""


@njit(cache=True, nogil=True, error_model="numpy")
def _normal_matrix(p: Any, n: int, moments: Any, hessian: Any) -> None:
    """H (2m, 2m) = Σ w JᵀJ for J = (fx m, fy m)."""
    terms = len(hessian) // 2
    for a in range(2):
        for b in range(a, 2):
            first, second = (p.fx, p.fy)[a], (p.fx, p.fy)[b]
            _low_moments(p, first, second, n, moments)
            if terms == 6:
                _high_moments(p, first, second, n, moments)
            for i in range(terms):
                for j in range(terms):
                    hessian[a * terms + i, b * terms + j] = moments[_PRODUCT[i, j]]
                    hessian[b * terms + j, a * terms + i] = moments[_PRODUCT[i, j]]


@njit(cache=True, nogil=True, error_model="numpy")
def _slope_sums(p: Any, b: Any, n: int, moments: Any, out: Any) -> None:
    """Σ w J b for an array b."""
    terms = len(out) // 2
    _low_moments(p, p.fx, b, n, moments)
    for i in range(terms):
        out[i] = moments[i]
    _low_moments(p, p.fy, b, n, moments)
    for i in range(terms):
        out[terms + i] = moments[i]


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
def _factor(matrix: Any) -> Any:
    """Cholesky's factor into the lower triangle, in place; False where the matrix is not safely positive."""
    size = len(matrix)
    for j in range(size):
        whole = matrix[j, j]
        for k in range(j):
            matrix[j, j] -= matrix[j, k] * matrix[j, k]
        if not matrix[j, j] > 1e-6 * whole:
            return False
        matrix[j, j] = np.sqrt(matrix[j, j])
        for i in range(j + 1, size):
            for k in range(j):
                matrix[i, j] -= matrix[i, k] * matrix[j, k]
            matrix[i, j] /= matrix[j, j]
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def _solve(factor: Any, vector: Any) -> None:
    """Solve L Lᵀ x = b in place."""
    size = len(factor)
    for i in range(size):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            vector[i] -= factor[k, i] * vector[k]
        vector[i] /= factor[i, i]


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _place(c: Any, shape: Any, degree: int, p: Any, n: int, half: int, places: Any) -> Any:
    """Where the pixels of a subset lie in the target under a warp (2, 6); False where some are outside.

    shape : (rows, cols) of the coefficients
    """
    rows, cols, before = shape[0] - 2 * PAD, shape[1] - 2 * PAD, PAD - degree // 2
    x0, y0 = np.floor(c[0, 0]), np.floor(c[1, 0])
    if not (0.0 <= x0 < cols and 0.0 <= y0 < rows):
        return False
    h = float(half)
    a0, a1, a2 = np.float32(c[0, 0] - x0), np.float32(c[0, 1] * h), np.float32(c[0, 2] * h)
    a3, a4, a5 = np.float32(c[0, 3] * h * h), np.float32(c[0, 4] * h * h), np.float32(c[0, 5] * h * h)
    b0, b1, b2 = np.float32(c[1, 0] - y0), np.float32(c[1, 1] * h), np.float32(c[1, 2] * h)
    b3, b4, b5 = np.float32(c[1, 3] * h * h), np.float32(c[1, 4] * h * h), np.float32(c[1, 5] * h * h)
    width = np.int32(cols + 2 * PAD)
    origin = np.int32((int(y0) + before) * (cols + 2 * PAD) + int(x0) + before)
    left, right, top, bottom = np.int32(0), np.int32(0), np.int32(0), np.int32(0)
    for k in range(n):
        xi, eta = p.xi[k], p.eta[k]
        x = a0 + xi * (a1 + a3 * xi + a4 * eta) + eta * (a2 + a5 * eta)
        y = b0 + xi * (b1 + b3 * xi + b4 * eta) + eta * (b2 + b5 * eta)
        floor_x, floor_y = np.floor(x), np.floor(y)
        places.t[k], places.s[k] = x - floor_x, y - floor_y
        j, i = np.int32(floor_x), np.int32(floor_y)
        left, right, top, bottom = min(left, j), max(right, j), min(top, i), max(bottom, i)
        places.at[k] = np.uint32(origin + i * width + j)
    return x0 + left >= 0 and x0 + right < cols and y0 + top >= 0 and y0 + bottom < rows


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _compare(flat: Any, width: Any, degree: int, places: Any, level: Any, p: Any, n: int, terms: int, out: Any) -> None:
    """Sums over the target's grey levels g at the places, less a level: Σ w g, Σ w g², Σ w f g, then Σ w J g.

    Nothing is stored in the loop, since only then its loads can be gathered in one instruction for many pixels.
    """
    s0, s1, s2 = np.float32(0), np.float32(0), np.float32(0)
    x0, x1, x2, y0, y1, y2 = np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    x3, x4, x5, y3, y4, y5 = np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0), np.float32(0)
    for k in range(n):
        if degree == 3:
            g = bicubic(flat, np.uint64(places.at[k]), width, places.t[k], places.s[k]) - level
        else:
            g = biquintic(flat, np.uint64(places.at[k]), width, places.t[k], places.s[k]) - level
        xi, eta, v = p.xi[k], p.eta[k], p.w[k] * g
        s0, s1, s2 = s0 + v, s1 + v * g, s2 + v * p.f[k]
        vx, vy = v * p.fx[k], v * p.fy[k]
        x0, x1, x2 = x0 + vx, x1 + vx * xi, x2 + vx * eta
        y0, y1, y2 = y0 + vy, y1 + vy * xi, y2 + vy * eta
        if terms == 6:
            xx, xy, yy = xi * xi, xi * eta, eta * eta
            x3, x4, x5 = x3 + vx * xx, x4 + vx * xy, x5 + vx * yy
            y3, y4, y5 = y3 + vy * xx, y4 + vy * xy, y5 + vy * yy
    out[0], out[1], out[2] = s0, s1, s2
    out[3], out[4], out[5], out[3 + terms], out[4 + terms], out[5 + terms] = x0, x1, x2, y0, y1, y2
    if terms == 6:
        out[6], out[7], out[8], out[12], out[13], out[14] = x3, x4, x5, y3, y4, y5


@njit(cache=True, nogil=True, error_model="numpy")
def _increment(normal: Any) -> Any:
    """The Gauss-Newton increment from the sums over the target's grey levels; returns the ZNSSD."""
    sums, total, square = normal.sums, normal.facts[1], normal.facts[2]
    mean = sums[0] / total
    other = sums[1] - mean * sums[0]
    if not other > 0.0:
        normal.increment[:] = np.nan
        return np.nan
    gain = np.sqrt(square / other)
    fit = gain * sums[2] / square
    for i in range(len(normal.increment)):
        normal.increment[i] = gain * (sums[3 + i] - mean * normal.ones[i]) - normal.by_f[i] * fit
    _solve(normal.factor, normal.increment)
    return 2.0 * (1.0 - fit)


@njit(cache=True, nogil=True, error_model="numpy")
def _largest_motion(d: Any) -> Any:
    """Greatest motion that an increment gives to a pixel of the subset, at most [px]."""
    x, y, terms = 0.0, 0.0, len(d) // 2
    for i in range(terms):
        x, y = x + abs(d[i]), y + abs(d[terms + i])
    return np.sqrt(x * x + y * y)


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
