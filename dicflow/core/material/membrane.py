"""Stress in a thin sheet of incompressible material, from the deformation gradient in its plane."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.material.models import Model

__all__ = ["sheet_stress", "sheet_stress_by_constants", "sheet_stress_by_gradient"]


_DIFFERENCE = 1e-5
"""Change of an element of F for differences."""


def sheet_stress(model: Model, c: Array, gradient: Array) -> Array:
    """Nominal stress P (..., 2, 2) of a sheet whose surfaces are free of stress; force is P N per first area.

    gradient : F (..., 2, 2), ∂x/∂X in the plane
    With F = Σ λₐ nₐ ⊗ Nₐ and λ3 = 1/(λ1 λ2), P = Σ (tₐ − t3)/λₐ nₐ ⊗ Nₐ.
    """
    left, stretches, right = _principal(gradient)
    slopes = model.slopes(c, stretches)
    principal = (slopes[..., :2] - slopes[..., 2:]) / stretches[..., :2]
    return np.asarray((left * principal[..., None, :]) @ right)


def sheet_stress_by_constants(model: Model, c: Array, gradient: Array) -> Array:
    """∂P/∂c (..., p, 2, 2) of :func:`sheet_stress`."""
    left, stretches, right = _principal(gradient)
    slopes = np.moveaxis(model.sensitivities(c, stretches), -1, -2)
    principal = (slopes[..., :2] - slopes[..., 2:]) / stretches[..., None, :2]
    return np.asarray((left[..., None, :, :] * principal[..., None, :]) @ right[..., None, :, :])


def sheet_stress_by_gradient(model: Model, c: Array, gradient: Array) -> Array:
    """∂P_ij/∂F_kl (..., 2, 2, 2, 2) of :func:`sheet_stress`, by central differences."""
    found = np.empty((*gradient.shape, 2, 2))
    for k in range(2):
        for column in range(2):
            shift = np.zeros((2, 2))
            shift[k, column] = _DIFFERENCE
            change = sheet_stress(model, c, gradient + shift) - sheet_stress(model, c, gradient - shift)
            found[..., k, column] = change / (2.0 * _DIFFERENCE)
    return found


def _principal(gradient: Array) -> tuple[Array, Array, Array]:
    """Directions nₐ as columns (..., 2, 2), principal stretches (..., 3), and directions Nₐ as rows (..., 2, 2).

    FᵀF = Σ λₐ² Nₐ ⊗ Nₐ in closed form, and nₐ = F Nₐ / λₐ.
    """
    a, b, c, d = gradient[..., 0, 0], gradient[..., 0, 1], gradient[..., 1, 0], gradient[..., 1, 1]
    first, second, mixed = a * a + c * c, b * b + d * d, a * b + c * d
    angle = 0.5 * np.arctan2(2.0 * mixed, first - second)
    cosine, sine = np.cos(angle), np.sin(angle)
    right = np.stack([np.stack([cosine, sine], axis=-1), np.stack([-sine, cosine], axis=-1)], axis=-2)
    larger = np.sqrt(0.5 * (first + second) + np.hypot(0.5 * (first - second), mixed))
    determinant = a * d - b * c
    stretches = np.stack([larger, np.abs(determinant) / larger, 1.0 / np.abs(determinant)], axis=-1)
    left = gradient @ np.swapaxes(right, -1, -2) / stretches[..., None, :2]
    return left, stretches, right
