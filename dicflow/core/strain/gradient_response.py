"""Deformation gradients from the slopes of a surface in two states, and how errors of the slopes change them.

The slopes are the Jacobians J and J' of :mod:`dicflow.core.strain.surface_strain`, and with the tangent bases there
F = (B'ᵀJ')(BᵀJ)⁻¹ = T' T⁻¹. An error of J changes F by

    δF = (B'ᵀδJ' + δω' K T') T⁻¹ − F (BᵀδJ + δω K T) T⁻¹,   K = [[0, 1], [−1, 0]],

where δω is the rotation of the basis about the normal n: e₁ is the projection of the world's X on a plane that tilts.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from dicflow.core.arrays import Array
from dicflow.core.kernels import INNER, KERNEL

__all__ = ["gradient_and_response", "gradient_covariance"]


def gradient_and_response(before: Array, after: Array) -> tuple[Array, Array]:
    """F, (..., 2, 2), and its derivatives by both Jacobians, (..., 4, 2, 6).

    before, after : (..., 3, 2) — J and J'

    The derivatives of F₁₁, F₁₂, F₂₁, F₂₂ are those by the slopes per column and per row, of J' and then of J [1/mm].
    NaN where either is missing or does not span a plane.
    """
    shape = before.shape[:-2]
    flat = (np.ascontiguousarray(part, dtype=np.float64).reshape(-1, 3, 2) for part in (before, after))
    gradient, response = np.empty((*shape, 2, 2)), np.empty((*shape, 4, 2, 6))
    _respond(*flat, gradient.reshape(-1, 2, 2), response.reshape(-1, 4, 2, 6))
    return gradient, response


def gradient_covariance(response: Array, slopes: Array, points: Array) -> Array:
    """Covariance (n, 4, 4) of the gradient from those of the slopes, (n, 2, 2), and of the points, (n, 6, 6).

    response : (n, 4, 2, 6) — of :func:`gradient_and_response`
    """
    found = np.zeros((len(response), 4, 4))
    _propagate(*(np.ascontiguousarray(part) for part in (response, slopes, points)), found)
    return found


@njit(error_model="numpy", **KERNEL)
def _respond(before: Array, after: Array, gradient: Array, response: Array) -> None:
    """The loop of :func:`gradient_and_response` over points."""
    basis, basis_after, normal, normal_after = np.empty((3, 2)), np.empty((3, 2)), np.empty(3), np.empty(3)
    flat, flat_after, along = np.empty((2, 2)), np.empty((2, 2)), np.empty((3, 2))
    for n in range(len(before)):
        f = gradient[n]
        _set_basis(before[n], basis, normal)
        _set_basis(after[n], basis_after, normal_after)
        _set_in_plane(basis, before[n], flat)
        _set_in_plane(basis_after, after[n], flat_after)
        _invert(flat)
        for a in range(2):
            for b in range(2):
                f[a, b] = flat_after[a, 0] * flat[0, b] + flat_after[a, 1] * flat[1, b]
        _invert(flat_after)
        for i in range(3):
            for a in range(2):
                along[i, a] = basis[i, 0] * f[a, 0] + basis[i, 1] * f[a, 1]
        turn, turn_after = _turn_by_tilt(normal), _turn_by_tilt(normal_after)
        for a in range(2):
            for b in range(2):
                turned_after = f[1, b] if a == 0 else -f[0, b]
                turned = -f[a, 1] if b == 0 else f[a, 0]
                for k in range(2):
                    moved = turned_after * turn_after * flat_after[k, 1]
                    fixed = turned * turn * flat[k, 1]
                    for i in range(3):
                        response[n, 2 * a + b, k, i] = basis_after[i, a] * flat[k, b] + moved * normal_after[i]
                        response[n, 2 * a + b, k, 3 + i] = -(along[i, a] * flat[k, b] + fixed * normal[i])


@njit(error_model="numpy", **INNER)
def _set_basis(slopes: Array, basis: Array, normal: Array) -> None:
    """Set the tangent basis (3, 2) and the normal (3,) of a plane, as :func:`surface_strain.tangent_basis` has them."""
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        normal[i] = slopes[j, 0] * slopes[k, 1] - slopes[k, 0] * slopes[j, 1]
    size = np.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if normal[2] < 0.0:
        size = -size
    for i in range(3):
        normal[i] /= size
    for i in range(3):
        basis[i, 0] = (1.0 if i == 0 else 0.0) - normal[0] * normal[i]
    size = np.sqrt(basis[0, 0] ** 2 + basis[1, 0] ** 2 + basis[2, 0] ** 2)
    for i in range(3):
        basis[i, 0] /= size
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        basis[i, 1] = normal[j] * basis[k, 0] - normal[k] * basis[j, 0]


@njit(error_model="numpy", **INNER)
def _set_in_plane(basis: Array, slopes: Array, out: Array) -> None:
    """Set T = BᵀJ (2, 2)."""
    for a in range(2):
        for b in range(2):
            out[a, b] = basis[0, a] * slopes[0, b] + basis[1, a] * slopes[1, b] + basis[2, a] * slopes[2, b]


@njit(error_model="numpy", **INNER)
def _invert(matrix: Array) -> None:
    """Invert a matrix (2, 2) in place; NaN if it is singular."""
    a, b, c, d = matrix[0, 0], matrix[0, 1], matrix[1, 0], matrix[1, 1]
    determinant = a * d - b * c
    if determinant == 0.0:
        determinant = np.nan
    matrix[0, 0], matrix[0, 1] = d / determinant, -b / determinant
    matrix[1, 0], matrix[1, 1] = -c / determinant, a / determinant


@njit(error_model="numpy", **INNER)
def _turn_by_tilt(normal: Array) -> float:
    """Rotation of the basis about the normal, over the tilt of the plane that makes it."""
    return float(normal[0] / np.sqrt(max(1.0 - normal[0] ** 2, 1e-12)))


@njit(error_model="numpy", **KERNEL)
def _propagate(response: Array, slopes: Array, points: Array, out: Array) -> None:
    """The loop of :func:`gradient_covariance` over points, added to ``out``."""
    moved = np.empty((4, 6))
    for n in range(len(response)):
        for first in range(2):
            _set_moved(response[n, :, first], points[n], moved)
            for second in range(first + 1):
                _add_share(moved, response[n, :, second], slopes[n, first, second], second < first, out[n])


@njit(error_model="numpy", **INNER)
def _set_moved(response: Array, points: Array, out: Array) -> None:
    """Set the product (4, 6) of a response (4, 6) and a covariance (6, 6)."""
    for i in range(4):
        for k in range(6):
            out[i, k] = 0.0
        for m in range(6):
            for k in range(6):
                out[i, k] += response[i, m] * points[m, k]


@njit(error_model="numpy", **INNER)
def _add_share(moved: Array, response: Array, slopes: float, is_mixed: bool, out: Array) -> None:
    """Add the part (4, 4) of two slopes with a covariance, and its transpose where they differ."""
    for i in range(4):
        for j in range(4):
            share = 0.0
            for k in range(6):
                share += moved[i, k] * response[j, k]
            out[i, j] += slopes * share
            if is_mixed:
                out[j, i] += slopes * share
