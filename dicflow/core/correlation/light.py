"""How far slow changes of the light move the place of a subset.

One more step of Gauss-Newton fits brightness and contrast that are polynomials of the second degree over the subset,
beside its warp.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.cholesky import factorise, solve
from dicflow.core.correlation.residuals import Residuals
from dicflow.core.kernels import INNER, KERNEL
from dicflow.core.photographs.interpolate import FAST_MATH

__all__ = ["light_shift"]


_RIDGE = 1e-9
"""Added to the diagonal of normal equations, which is 1, so that a few pixels too have a solution: functions that the
others express share what they explain."""
_LIGHT = 12
"""Functions of the light: the six monomials, and these times the grey levels."""


def light_shift(fit: Residuals, near: Mask, size: int) -> tuple[Array, Array]:
    """Shift of the places (n,) by slow changes of the light [px], and their share of the residuals (n,).

    near : (n,) bool — subsets that are computed; the others get zeros
    size : side of the subsets [px]
    """
    shift, share = np.zeros(len(near)), np.zeros(len(near))
    _fit_light(fit, np.flatnonzero(near), size // 2, shift, share)
    return shift, share


@njit(error_model="numpy", **KERNEL)
def _fit_light(fit: Residuals, near: Index, half: int, shift: Array, share: Array) -> None:
    """The loop of :func:`light_shift` over subsets."""
    count = _LIGHT + 2 * fit.terms
    columns = np.empty((count + 1, fit.f.shape[1]))
    normal, alone, step, scale = np.empty((count, count)), np.empty(_LIGHT), np.empty(count), np.empty(count)
    for k in near:
        _set_columns(fit, k, half, columns)
        square = _normal_equations(columns, normal, step, scale)
        for i in range(_LIGHT):
            alone[i] = step[i]
        if factorise(normal, 0.0):
            solve(normal[:_LIGHT, :_LIGHT], alone)
            for i in range(_LIGHT):
                share[k] += alone[i] * step[i] / square
            solve(normal, step)
            shift[k] = np.hypot(step[_LIGHT] / scale[_LIGHT], step[_LIGHT + fit.terms] / scale[_LIGHT + fit.terms])


@njit(error_model="numpy", **INNER)
def _set_columns(fit: Residuals, k: int, half: int, columns: Array) -> None:
    """Functions of the light, of the warp, and the residuals, times the roots of weights (function, pixel)."""
    side, terms = 2 * half + 1, fit.terms
    for at in range(columns.shape[1]):
        root, xi, eta = np.sqrt(fit.weight[k, at]), (at % side - half) / half, (at // side - half) / half
        monomials = (1.0, xi, eta, xi * xi, xi * eta, eta * eta)
        for m in range(6):
            columns[m, at], columns[6 + m, at] = root * monomials[m], root * monomials[m] * fit.f[k, at]
        for m in range(terms):
            columns[_LIGHT + m, at] = root * monomials[m] * fit.by_x[k, at]
            columns[_LIGHT + terms + m, at] = root * monomials[m] * fit.by_y[k, at]
        columns[-1, at] = root * fit.residual[k, at]


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _normal_equations(columns: Array, normal: Array, right: Array, scale: Array) -> float:
    """Set the normal equations of the functions, each of size 1 by a scale; returns the square of the residuals."""
    count = len(right)
    for i in range(count):
        for j in range(i + 1):
            normal[i, j] = _dot(columns, i, j)
        right[i], scale[i] = _dot(columns, i, count), np.sqrt(max(normal[i, i], 1e-12))
    for i in range(count):
        right[i] /= scale[i]
        for j in range(i + 1):
            normal[i, j] /= scale[i] * scale[j]
        normal[i, i] += _RIDGE
    return float(max(_dot(columns, count, count), 1e-12))


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _dot(columns: Array, i: int, j: int) -> float:
    total = 0.0
    for p in range(columns.shape[1]):
        total += columns[i, p] * columns[j, p]
    return total
