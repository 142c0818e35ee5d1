"""Sums over the pixels of one subset: the loops in which correlation spends its time.

The pixels of a subset are flat arrays, so that a subset cut by an edge is only shorter. Derivatives of the grey levels
by the warp are J = (fx m, fy m) over the monomials m = 1, ξ, η, ξ², ξη, η² with offsets in half sides.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Counts, Image
from dicflow.core.correlation.sampling import Places, first_coefficient
from dicflow.core.kernels import INNER, MAKER
from dicflow.core.photographs.interpolate import FAST_MATH, bicubic, biquintic

__all__ = [
    "Pixels",
    "centre_grey",
    "gathered_sums",
    "grey_sums",
    "normal_matrix",
    "set_block",
    "slope_sums",
]

Sums = tuple[np.float32, ...]
"""Sums over pixels, kept in registers."""


class Pixels(NamedTuple):
    """The pixels of one subset: flat float32 arrays, long enough for a whole subset.

    f, fx, fy : grey level minus its mean, and derivatives; xi, eta : offsets in half sides; w : weight
    row_rest : int32 — how many pixels follow each other in a row from this one on, itself included
    """

    f: Image
    fx: Image
    fy: Image
    xi: Image
    eta: Image
    w: Image
    row_rest: Counts


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def centre_grey(p: Pixels, n: int, statistics: Array) -> None:
    """Subtract the weighted mean from f; write the mean, the sum of weights and Δf² to ``statistics``."""
    total, first, square = np.float32(0.0), np.float32(0.0), np.float32(0.0)
    for k in range(n):
        total += p.w[k]
        first += p.w[k] * p.f[k]
    mean = first / total
    for k in range(n):
        p.f[k] -= mean
    for k in range(n):
        square += p.w[k] * p.f[k] * p.f[k]
    statistics[0], statistics[1], statistics[2] = mean, total, square


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _low_moments(p: Pixels, a: Image, b: Image, n: int, out: Array) -> None:
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


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _high_moments(p: Pixels, a: Image, b: Image, n: int, out: Array) -> None:
    """Σ w a b m over ξ³, ξ²η, ξη², η³, ξ⁴, ξ³η, ξ²η², ξη³, η⁴, written after those of lower degree."""
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


_PRODUCT_MOMENT = np.array(
    [
        [0, 1, 2, 3, 4, 5],
        [1, 3, 4, 6, 7, 8],
        [2, 4, 5, 7, 8, 9],
        [3, 6, 7, 10, 11, 12],
        [4, 7, 8, 11, 12, 13],
        [5, 8, 9, 12, 13, 14],
    ]
)
"""Index of the moment that belongs to the product of two monomials."""


@njit(error_model="numpy", **INNER)
def normal_matrix(p: Pixels, n: int, moments: Array, hessian: Array) -> None:
    """H (2m, 2m) = Σ w JᵀJ for J = (fx m, fy m)."""
    terms = len(hessian) // 2
    for a in range(2):
        for b in range(a, 2):
            first, second = (p.fx, p.fy)[a], (p.fx, p.fy)[b]
            _low_moments(p, first, second, n, moments)
            if terms == 6:
                _high_moments(p, first, second, n, moments)
            set_block(hessian, a, b, moments)


@njit(error_model="numpy", **INNER)
def set_block(hessian: Array, a: int, b: int, moments: Array) -> None:
    """Set the block of a Hessian for two of the derivatives, from the sums of their product with monomials."""
    terms = len(hessian) // 2
    for i in range(terms):
        for j in range(terms):
            hessian[a * terms + i, b * terms + j] = moments[_PRODUCT_MOMENT[i, j]]
            hessian[b * terms + j, a * terms + i] = moments[_PRODUCT_MOMENT[i, j]]


@njit(error_model="numpy", **INNER)
def slope_sums(p: Pixels, b: Image, n: int, moments: Array, out: Array) -> None:
    """Σ w J b for an array b."""
    terms = len(out) // 2
    _low_moments(p, p.fx, b, n, moments)
    for i in range(terms):
        out[i] = moments[i]
    _low_moments(p, p.fy, b, n, moments)
    for i in range(terms):
        out[terms + i] = moments[i]


_ZERO_AFFINE = (np.float32(0.0),) * 9
"""Σ v, Σ v g, Σ v f, Σ v fx m, Σ v fy m with m = 1, ξ, η and v = w g, before the first pixel."""
_ZERO_QUADRATIC = (np.float32(0.0),) * 6
"""Σ v fx m, Σ v fy m with m = ξ², ξη, η², before the first pixel."""


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _affine_sums(s: Sums, p: Pixels, k: int, g: np.float32) -> Sums:
    """The sums for an affine warp, s plus those of pixel k with grey level g."""
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


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _quadratic_sums(s: Sums, p: Pixels, k: int, g: np.float32) -> Sums:
    """The further sums for a quadratic warp."""
    v, xi, eta = p.w[k] * g, p.xi[k], p.eta[k]
    x, y, xx, xy, yy = v * p.fx[k], v * p.fy[k], xi * xi, xi * eta, eta * eta
    return s[0] + x * xx, s[1] + x * xy, s[2] + x * yy, s[3] + y * xx, s[4] + y * xy, s[5] + y * yy


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def grey_sums(g: Image, level: np.float32, p: Pixels, n: int, out: Array) -> None:
    """Sums over grey levels g minus a level: Σ w g, Σ w g², Σ w f g, then Σ w J g."""
    terms, s, q = (len(out) - 3) // 2, _ZERO_AFFINE, _ZERO_QUADRATIC
    for k in range(n):
        s = _affine_sums(s, p, k, g[k] - level)
    if terms == 6:
        for k in range(n):
            q = _quadratic_sums(q, p, k, g[k] - level)
    _write_sums(s, q, terms, out)


@njit(fastmath=FAST_MATH, error_model="numpy", **MAKER)
def gathered_sums(
    coefficients: Image, c: Array, degree: int, places: Places, level: np.float32, p: Pixels, n: int, out: Array
) -> None:
    """The same sums with grey levels from scattered coefficients, for pixels that were located by a warp c (2, 6).

    The loops store nothing: only then one instruction gathers the coefficients of many pixels.
    """
    terms, s, q = (len(out) - 3) // 2, _ZERO_AFFINE, _ZERO_QUADRATIC
    flat, width = coefficients.ravel(), coefficients.shape[1]
    first = first_coefficient(c, width, degree)
    for k in range(n):
        x, y = np.floor(places.x[k]), np.floor(places.y[k])
        at = np.uint64(first + int(y) * width + int(x))
        t, u = places.x[k] - x, places.y[k] - y
        if degree == 3:
            g = bicubic(flat, at, np.uint64(width), t, u) - level
        else:
            g = biquintic(flat, at, np.uint64(width), t, u) - level
        s, q = _affine_sums(s, p, k, g), _quadratic_sums(q, p, k, g)
    _write_sums(s, q, terms, out)


@njit(error_model="numpy", **INNER)
def _write_sums(s: Sums, q: Sums, terms: int, out: Array) -> None:
    """Write the sums in the order of the warp's coefficients."""
    for i in range(3):
        out[i], out[3 + i], out[3 + terms + i] = s[i], s[3 + i], s[6 + i]
        if terms == 6:
            out[6 + i], out[12 + i] = q[i], q[3 + i]
