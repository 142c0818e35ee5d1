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

__all__ = ["LANES", "Normal", "Pixels", "Places", "covariance", "iterate", "prepare"]

LANES = 8
"""Pixels that are sampled at once; a run of pixels is rounded up to so many."""
_SCATTERED = 0.2
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
    """Where the pixels of one subset lie in the target, with room for LANES more.

    at : uint32 — index of the first coefficient; t, s : float32 — fractions along x and y; g : float32 — grey levels
    """

    at: Any
    t: Any
    s: Any
    g: Any


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
    """Improve the warp ``c`` until it stays; returns status, iterations, ZNSSD and the ratio of the last increments.

    The increments of Gauss-Newton shrink by a ratio r, so that what is left after one of size e is e r/(1 − r). For the
    first increment r is what ``control.contraction`` says.
    """
    flat, width = coefficients.ravel(), np.uint64(coefficients.shape[1])
    terms, level = len(normal.increment) // 2, np.float32(normal.facts[0])
    last, ratio, znssd = 0.0, np.nan, np.nan
    for iteration in range(1, control.iterations + 1):
        if not _place(c, coefficients.shape, degree, p, n, half, places):
            return _OUTSIDE, iteration, znssd, np.nan
        if abs(c[0, 1] - 1.0) + abs(c[1, 1]) < _SCATTERED:
            _sample_runs(flat, width, degree, places, n, 2 * half + 1)
            _sums(places.g, level, p, n, normal.sums)
        else:
            _gathered_sums(flat, width, degree, places, level, p, n, normal.sums)
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


@njit(cache=True, nogil=True, error_model="numpy")
def _sample_runs(flat: Any, width: Any, degree: int, places: Any, n: int, side: int) -> None:
    """Grey levels at the places, run by run: pixels whose coefficients lie side by side need no gathering.

    The last pixels of a run are rounded up to LANES; what that writes too much, the next run writes over.
    """
    k, end = 0, len(flat) - degree * (int(width) + 1)
    while k < n:
        run = _run(places.at, k, min(side, n - k))
        count = min(-(-run // LANES) * LANES, end - int(places.at[k]))
        _sample(flat, np.uint64(places.at[k]), width, degree, np.uint64(k), np.uint64(count), places)
        k += run


@njit(cache=True, nogil=True, error_model="numpy")
def _run(at: Any, k: int, most: int) -> int:
    """How many pixels from the k-th on, ``most`` at most, have their coefficients side by side."""
    first, differ = at[k], np.uint32(0)
    for j in range(most):
        differ |= at[k + j] - first - np.uint32(j)
    if differ == 0:
        return most
    run = 1
    while at[k + run] == first + np.uint32(run):
        run += 1
    return run


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _sample(flat: Any, at: Any, width: Any, degree: int, k: Any, count: Any, places: Any) -> None:
    """Grey levels of pixels k, k + 1, … whose first coefficients are at, at + 1, …"""
    for j in range(count):
        t, s = places.t[k + j], places.s[k + j]
        if degree == 3:
            places.g[k + j] = bicubic(flat, at + j, width, t, s)
        else:
            places.g[k + j] = biquintic(flat, at + j, width, t, s)


_NONE = (np.float32(0.0),) * 9
"""Σ v, Σ v g, Σ v f, Σ v fx m, Σ v fy m with m = 1, ξ, η before the first pixel."""
_NO_MORE = (np.float32(0.0),) * 6
"""Σ v fx m, Σ v fy m with m = ξ², ξη, η²."""


@njit(nogil=True, fastmath=FAST, error_model="numpy", forceinline=True)
def _added(s: Any, p: Any, k: Any, g: Any) -> Any:
    """The sums of an affine warp with pixel k, whose grey level is g."""
    v, xi, eta = p.w[k] * g, p.xi[k], p.eta[k]
    x, y = v * p.fx[k], v * p.fy[k]
    return (
        s[0] + v,
        s[1] + v * g,
        s[2] + v * p.f[k],
        s[3] + x,
        s[4] + x * xi,
        s[5] + x * eta,
        s[6] + y,
        s[7] + y * xi,
        s[8] + y * eta,
    )


@njit(nogil=True, fastmath=FAST, error_model="numpy", forceinline=True)
def _added_quadratic(s: Any, p: Any, k: Any, g: Any) -> Any:
    """What a quadratic warp has beyond an affine one."""
    v, xi, eta = p.w[k] * g, p.xi[k], p.eta[k]
    x, y, xx, xy, yy = v * p.fx[k], v * p.fy[k], xi * xi, xi * eta, eta * eta
    return s[0] + x * xx, s[1] + x * xy, s[2] + x * yy, s[3] + y * xx, s[4] + y * xy, s[5] + y * yy


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _sums(g: Any, level: Any, p: Any, n: int, out: Any) -> None:
    """Sums over grey levels g, less a level: Σ w g, Σ w g², Σ w f g, then Σ w J g."""
    terms, s, q = (len(out) - 3) // 2, _NONE, _NO_MORE
    for k in range(n):
        s = _added(s, p, k, g[k] - level)
    if terms == 6:
        for k in range(n):
            q = _added_quadratic(q, p, k, g[k] - level)
    _put(s, q, terms, out)


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def _gathered_sums(flat: Any, width: Any, degree: int, places: Any, level: Any, p: Any, n: int, out: Any) -> None:
    """The same sums with grey levels from scattered coefficients.

    Nothing is stored in the loops, since only then their loads can be gathered in one instruction for many pixels.
    """
    terms, s, q = (len(out) - 3) // 2, _NONE, _NO_MORE
    if degree == 3:
        for k in range(n):
            g = bicubic(flat, np.uint64(places.at[k]), width, places.t[k], places.s[k]) - level
            s, q = _added(s, p, k, g), _added_quadratic(q, p, k, g)
    else:
        for k in range(n):
            g = biquintic(flat, np.uint64(places.at[k]), width, places.t[k], places.s[k]) - level
            s, q = _added(s, p, k, g), _added_quadratic(q, p, k, g)
    _put(s, q, terms, out)


@njit(cache=True, nogil=True, error_model="numpy")
def _put(s: Any, q: Any, terms: int, out: Any) -> None:
    """Write sums in the order of the warp's coefficients."""
    for i in range(3):
        out[i], out[3 + i], out[3 + terms + i] = s[i], s[3 + i], s[6 + i]
        if terms == 6:
            out[6 + i], out[12 + i] = q[i], q[3 + i]


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
