"""Sums over the pixels of one subset: the loops that correlation spends its time in.

The pixels of a subset are flat arrays, so that a subset cut by an edge is only a shorter one. Derivatives of the grey
levels by the warp are J = (fx m, fy m) over the monomials m = 1, ξ, η, ξ², ξη, η² with offsets in half sides.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from dicflow.core.photographs.interpolate import FAST, PAD, bicubic, biquintic

__all__ = [
    "LANES",
    "Pixels",
    "Places",
    "centre_grey",
    "gathered_sums",
    "normal_matrix",
    "place",
    "sample_runs",
    "slope_sums",
    "sums",
]

LANES = 8
"""Pixels that are sampled at once; a run of pixels is rounded up to so many."""


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


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def centre_grey(p: Any, n: int, facts: Any) -> None:
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
def normal_matrix(p: Any, n: int, moments: Any, hessian: Any) -> None:
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
def slope_sums(p: Any, b: Any, n: int, moments: Any, out: Any) -> None:
    """Σ w J b for an array b."""
    terms = len(out) // 2
    _low_moments(p, p.fx, b, n, moments)
    for i in range(terms):
        out[i] = moments[i]
    _low_moments(p, p.fy, b, n, moments)
    for i in range(terms):
        out[terms + i] = moments[i]


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def place(c: Any, shape: Any, degree: int, p: Any, n: int, half: int, places: Any) -> Any:
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
def sample_runs(flat: Any, width: Any, degree: int, places: Any, n: int, side: int) -> None:
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
def sums(g: Any, level: Any, p: Any, n: int, out: Any) -> None:
    """Sums over grey levels g, less a level: Σ w g, Σ w g², Σ w f g, then Σ w J g."""
    terms, s, q = (len(out) - 3) // 2, _NONE, _NO_MORE
    for k in range(n):
        s = _added(s, p, k, g[k] - level)
    if terms == 6:
        for k in range(n):
            q = _added_quadratic(q, p, k, g[k] - level)
    _put(s, q, terms, out)


@njit(cache=True, nogil=True, fastmath=FAST, error_model="numpy")
def gathered_sums(flat: Any, width: Any, degree: int, places: Any, level: Any, p: Any, n: int, out: Any) -> None:
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
