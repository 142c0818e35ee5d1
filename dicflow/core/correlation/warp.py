"""Shape functions: how a subset of the reference photograph lies in the target.

A warp gives the place of the point at ``offset`` = (ξ, η) from the subset's centre as a polynomial,
x(ξ, η) = Σ c_m m(ξ, η) with the monomials 1, ξ, η (affine) and also ξ², ξη, η² (quadratic). It is stored as
coefficients (..., 2, 3) or (..., 2, 6): row 0 gives x, row 1 gives y; column 0 is the place of the centre [px].
"""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt
from numba import njit

from dicflow.core.arrays import Array
from dicflow.core.kernels import INNER

__all__ = [
    "TERMS",
    "ShapeFunction",
    "apply_warp",
    "expanded",
    "gradient",
    "identity",
    "recentred",
    "set_recentred",
    "warp_from_gradient",
]

ShapeFunction = Literal["affine", "quadratic"]

TERMS = {"affine": 3, "quadratic": 6}
"""Coefficients per coordinate."""


def identity(centres: npt.ArrayLike, shape_function: ShapeFunction = "affine") -> Array:
    """Warps (..., 2, 3 or 6) that leave subsets at centres (..., 2) [px] where they are."""
    centres = np.asarray(centres, dtype=np.float64)
    return warp_from_gradient(centres, np.broadcast_to(np.eye(2), (*centres.shape, 2)), shape_function)


def warp_from_gradient(places: npt.ArrayLike, slope: npt.ArrayLike, shape_function: ShapeFunction = "affine") -> Array:
    """Warps from the places of the centres (..., 2) [px] and the gradients ∂x/∂ξ (..., 2, 2) there."""
    places = np.asarray(places, dtype=np.float64)
    warp = np.zeros((*places.shape, TERMS[shape_function]))
    warp[..., 0], warp[..., 1:3] = places, slope
    return warp


def gradient(warp: Array, offset: npt.ArrayLike | None = None) -> Array:
    """∂x/∂ξ (..., 2, 2) at offsets (..., 2) [px] from the centres, or at these."""
    if offset is None:
        return warp[..., 1:3].copy()
    offset = np.asarray(offset, dtype=np.float64)
    slope = np.broadcast_to(warp[..., 1:3], (*np.broadcast_shapes(warp.shape[:-2], offset.shape[:-1]), 2, 2)).copy()
    if warp.shape[-1] == TERMS["quadratic"]:
        xi, eta = (part[..., None] for part in np.moveaxis(offset, -1, 0))
        slope[..., 0] += 2.0 * warp[..., 3] * xi + warp[..., 4] * eta
        slope[..., 1] += warp[..., 4] * xi + 2.0 * warp[..., 5] * eta
    return np.asarray(slope)


def apply_warp(warp: Array, offset: npt.ArrayLike) -> Array:
    """Places (..., 2) [px] of the points at offsets (..., 2) [px] from the centres."""
    xi, eta = np.moveaxis(np.asarray(offset, dtype=np.float64), -1, 0)
    return np.stack([_polynomial(np.moveaxis(warp[..., axis, :], -1, 0), xi, eta) for axis in range(2)], axis=-1)


def _polynomial(c: Array, xi: Array, eta: Array) -> Array:
    """Values of polynomials with the coefficients c (3 or 6, ...)."""
    if len(c) == TERMS["affine"]:
        return np.asarray(c[0] + c[1] * xi + c[2] * eta)
    return np.asarray(c[0] + (c[1] + c[3] * xi + c[4] * eta) * xi + (c[2] + c[5] * eta) * eta)


def recentred(warp: Array, offset: npt.ArrayLike) -> Array:
    """The same warps about centres at offsets (..., 2) [px] from theirs, as for the subset of a neighbour."""
    offset = np.asarray(offset, dtype=np.float64)
    place = apply_warp(warp, offset)
    result = np.broadcast_to(warp, (*place.shape, warp.shape[-1])).copy()
    result[..., 0], result[..., 1:3] = place, gradient(warp, offset)
    return result


@njit(**INNER)
def expanded(c: Array, x: float, y: float) -> tuple[float, float, float]:
    """The value of a polynomial with the coefficients c (3 or 6) at (x, y) and its derivatives by x and y."""
    place, by_x, by_y = c[0] + c[1] * x + c[2] * y, c[1], c[2]
    if len(c) == 6:
        place += c[3] * x * x + c[4] * x * y + c[5] * y * y
        by_x, by_y = by_x + 2.0 * c[3] * x + c[4] * y, by_y + c[4] * x + 2.0 * c[5] * y
    return place, by_x, by_y


@njit(**INNER)
def set_recentred(warp: Array, x: float, y: float, values: Array, n: int) -> None:
    """Set column n of ``values`` (2 m, …) to the coefficients (2, m) of a warp, taken about (x, y) from its centre."""
    terms = warp.shape[1]
    for axis in range(2):
        c, first = warp[axis], axis * terms
        values[first, n], values[first + 1, n], values[first + 2, n] = expanded(c, x, y)
        for m in range(3, terms):
            values[first + m, n] = c[m]
