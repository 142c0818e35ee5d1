"""Deformation gradient of a measured surface from its reference state, and its uncertainty.

The surface in both states is fitted around every point by a polynomial over the window of the material grid (least
squares, each point weighted with 1 / σ² of its displacement). The slopes are the Jacobians J and J' of
:mod:`dicflow.core.strain.surface_strain`, and with the tangent bases there F = (B'ᵀJ')(BᵀJ)⁻¹ = T' T⁻¹.

Errors are propagated to first order. Slopes of a fit are sums Σₙ wₙ Xₙ over the window, so their covariance is that of
a point times Q = Σₙₘ wₙ ρₙₘ wₘ, where ρ is the correlation of points whose subsets overlap. It depends on the shape
function, so the shares in the covariance are propagated one by one. An error of J changes F by

    δF = (B'ᵀδJ' + δω' K T') T⁻¹ − F (BᵀδJ + δω K T) T⁻¹,   K = [[0, 1], [−1, 0]],

where δω is the rotation of the basis about the normal n: e₁ is the projection of the world's X on a plane that tilts.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Mask
from dicflow.core.kernels import INNER
from dicflow.core.strain.surface_strain import deformation_gradient, jacobian, tangent_basis
from dicflow.core.surfaces.filters import slope_weights
from dicflow.core.tensors import inverse, on_grid
from dicflow.core.uncertainty.covariance import displacement_covariance
from dicflow.core.uncertainty.overlap import Overlap

__all__ = [
    "ErrorShare",
    "SurfaceGradient",
    "gradient_response",
    "pixel_size_mm",
    "slope_covariances",
    "surface_gradient",
    "vsg_px",
]


_QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])


class ErrorShare(NamedTuple):
    """Share in the errors of points by subsets of one kind.

    covariance : (row, col, 6, 6) — of each point at the step and at the reference state, in this order
    rho : correlation of the errors of two points
    """

    covariance: Array
    rho: Overlap


class SurfaceGradient(NamedTuple):
    """Deformation gradients on the grid; NaN where the point or too much of its window is missing.

    gradient : (row, col, 2, 2) — F [-]
    covariance : (row, col, 4, 4) — of F₁₁, F₁₂, F₂₁, F₂₂ [-]
    response : (row, col, 4, 2, 6) — derivatives of these by the slopes, per column and per row, of the point at the
        step and at the reference state [1/mm]
    """

    gradient: Array
    covariance: Array
    response: Array


def vsg_px(window_points: int, step_size: float, subset_size: float) -> float:
    """Side of the virtual strain gauge: the square of the photograph that enters one strain value [px].

    (window_points − 1) · step_size + subset_size, after the Good Practices Guide of the iDICs (2018).

    >>> vsg_px(5, 7.0, 21)
    49.0
    """
    return (window_points - 1) * step_size + subset_size


def surface_gradient(
    reference: Array,
    deformed: Array,
    errors: Sequence[ErrorShare],
    window: tuple[int, int],
    degree: int,
    min_share: float = 0.25,
    wanted: Mask | None = None,
) -> SurfaceGradient:
    """Deformation gradient between two states of a surface.

    reference, deformed : (row, col, 3) — the points of a regular material grid [mm]; of a plane in the image
        the third coordinate is 0 [px]
    errors : independent shares that add up to the errors of the points; a point without covariance does not count
    window : (rows, cols), odd numbers of points
    degree : of the polynomials, 1 or more
    min_share : share of a window's points that must have a value
    wanted : (row, col) bool — points to compute, n of them; the fields are (n, …) then. None for all
    """
    whole = np.sum([share.covariance for share in errors], axis=0)
    sigma = np.sqrt(np.trace(displacement_covariance(whole), axis1=-2, axis2=-1))
    known = np.asarray(np.isfinite(reference + deformed).all(axis=-1) & np.isfinite(sigma))
    at = known if wanted is None else wanted
    before, after = (np.where(known[..., None], points, np.nan) for points in (reference, deformed))
    weights = np.where(known, 1.0 / np.maximum(sigma, 1e-12) ** 2, 0.0)
    weights /= max(float(weights.max(initial=0.0)), 1e-300)
    before, after = (jacobian(points, window, degree, weights, min_share)[at] for points in (before, after))
    response, scatter = gradient_response(before, after), np.where(known, sigma, 0.0)
    slopes = slope_covariances(weights, scatter, [share.rho for share in errors], window, degree, at)
    parts = [
        _gradient_covariance(response, slope[at], share.covariance[at])
        for slope, share in zip(slopes, errors, strict=True)
    ]
    found = SurfaceGradient(deformation_gradient(before, after), np.sum(parts, axis=0), response)
    return found if wanted is not None else SurfaceGradient(*(on_grid(values, known) for values in found))


def pixel_size_mm(reference: Array, step_size: float) -> Array:
    """Side of a pixel of the photograph on the surface (row, col), the root of its area [mm/px].

    reference : (row, col, 3) — the points in the reference state [mm]
    step_size : distance of the grid's points [px]
    """
    across = jacobian(reference, (3, 3), 1)
    area = np.linalg.norm(np.cross(across[..., 0], across[..., 1]), axis=-1)
    return np.asarray(np.sqrt(area) / step_size)


def slope_covariances(
    weights: Array,
    sigma: Array,
    rhos: Sequence[Overlap],
    window: tuple[int, int],
    degree: int,
    wanted: Mask | None = None,
) -> list[Array]:
    """Q (row, col, 2, 2): covariance of a fit's slopes per column and per row, for unit variance at the point itself.

    weights, sigma : (row, col) — of each point, 0 where it is missing
    rhos : correlations of the errors of two points, each of which gives one Q
    wanted : (row, col) bool — points that get one; None for all
    """
    factors, terms = slope_weights(weights, window, degree)
    if wanted is not None:
        factors[~wanted] = np.nan
    pad = [(side // 2, side // 2) for side in window]
    scaled, variance = np.pad(weights * sigma, pad), np.where(sigma > 0.0, sigma, np.nan)[..., None, None] ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        return [
            _slope_covariance(factors, terms, scaled, _band(rho.down, window[0]), _band(rho.across, window[1]))
            / variance
            for rho in rhos
        ]


def _band(lags: Array, side: int) -> Array:
    """Matrices (term, side, side) of a function of |i − j|, (term, lag)."""
    apart = np.abs(np.subtract.outer(np.arange(side), np.arange(side)))
    padded = np.pad(lags, ((0, 0), (0, max(0, side - lags.shape[1]))))
    return np.ascontiguousarray(padded[:, apart])


@njit(cache=True, nogil=True)
def _slope_covariance(factors: Array, terms: Array, scaled: Array, down: Array, across: Array) -> Array:
    """Σₜ wₐ : (downₜ w_b acrossₜ) for the weights w of both slopes a, b; (row, col, 2, 2).

    factors, terms : (row, col, 2, term) and (term, high, wide) — see
        :func:`~dicflow.core.surfaces.filters.slope_weights`
    scaled : (row, col) weight times σ, padded by half a window on each side
    down, across : (term, high, high) and (term, wide, wide) — correlation of the points of a window
    """
    rows, cols = factors.shape[:2]
    high, wide = terms.shape[1:]
    result = np.full((rows, cols, 2, 2), np.nan)
    weights = np.empty((2, high, wide))
    half = np.empty((high, wide))
    full = np.empty((high, wide))
    for row in range(rows):
        for col in range(cols):
            if not np.isfinite(factors[row, col, 0, 0]):
                continue
            _clear(result[row, col])
            _window_weights(factors[row, col], terms, scaled[row : row + high, col : col + wide], weights)
            for term in range(down.shape[0]):
                for a in range(2):
                    _product(down[term], weights[a], half)
                    _product(half, across[term], full)
                    for b in range(a + 1):
                        total = 0.0
                        for i in range(high):
                            for j in range(wide):
                                total += full[i, j] * weights[b, i, j]
                        result[row, col, a, b] += total
            result[row, col, 0, 1] = result[row, col, 1, 0]
    return result


@njit(**INNER)
def _window_weights(factors: Array, terms: Array, scaled: Array, weights: Array) -> None:
    """Set the weights (2, high, wide) of both slopes in one window."""
    for slope in range(2):
        _clear(weights[slope])
        for term in range(terms.shape[0]):
            factor = factors[slope, term]
            for i in range(scaled.shape[0]):
                for j in range(scaled.shape[1]):
                    weights[slope, i, j] += factor * terms[term, i, j] * scaled[i, j]


@njit(**INNER)
def _clear(matrix: Array) -> None:
    """Set all elements to zero."""
    for i in range(matrix.shape[0]):
        for j in range(matrix.shape[1]):
            matrix[i, j] = 0.0


@njit(**INNER)
def _product(first: Array, second: Array, result: Array) -> None:
    """Set the matrix product, summed along the rows of the second so that it vectorises."""
    _clear(result)
    for i in range(first.shape[0]):
        for k in range(first.shape[1]):
            factor = first[i, k]
            if factor != 0.0:
                for j in range(second.shape[1]):
                    result[i, j] += factor * second[k, j]


def gradient_response(before: Array, after: Array) -> Array:
    """Derivatives of F by the Jacobians of both states, (..., 4, 2, 6); see :class:`SurfaceGradient`.

    before, after : (..., 3, 2) — J and J'
    """
    basis, basis_after = tangent_basis(before), tangent_basis(after)
    gradient = deformation_gradient(before, after)
    with np.errstate(invalid="ignore"):
        flat = inverse(np.swapaxes(basis, -1, -2) @ before)
        flat_after = inverse(np.swapaxes(basis_after, -1, -2) @ after)
        moved = _sensitivity(basis_after, flat, flat_after, _QUARTER_TURN @ gradient)
        fixed = _sensitivity(basis @ np.swapaxes(gradient, -1, -2), flat, flat, gradient @ _QUARTER_TURN, basis)
    both = np.concatenate([moved, -fixed], axis=-1)
    return both.reshape(*both.shape[:-4], 4, 2, 6)


def _gradient_covariance(response: Array, slopes: Array, points: Array) -> Array:
    """Covariance (..., 4, 4) of the gradient from those of the slopes, (..., 2, 2), and of the points, (..., 6, 6)."""
    total = np.zeros((*response.shape[:-3], 4, 4))
    with np.errstate(invalid="ignore"):
        for first in range(2):
            moved = response[..., first, :] @ points
            for second in range(2):
                share = moved @ np.swapaxes(response[..., second, :], -1, -2)
                total += slopes[..., first, second, None, None] * share
    return total


def _sensitivity(along: Array, flat: Array, own_flat: Array, turned: Array, basis: Array | None = None) -> Array:
    """∂F_ab / ∂J_iα as (..., a, b, α, i): the part in the plane, and that by the rotation of the basis.

    along : (..., 3, 2) — directions i of space that change row a of F
    flat : T⁻¹ of the reference state, own_flat : T⁻¹ of the state with Jacobian J
    turned : (..., 2, 2) — derivative of F by the rotation of the basis
    basis : of the state with Jacobian J, where it is not ``along``
    """
    first, second = np.moveaxis(along if basis is None else basis, -1, 0)
    normal = np.cross(first, second)
    in_plane = np.einsum("...ia,...pb->...abpi", along, flat)
    tilt = normal[..., 0] / np.sqrt(np.maximum(1.0 - normal[..., 0] ** 2, 1e-12))
    turn = tilt[..., None, None] * own_flat[..., :, 1, None] * normal[..., None, :]
    return np.asarray(in_plane + turned[..., None, None] * turn[..., None, None, :, :])
