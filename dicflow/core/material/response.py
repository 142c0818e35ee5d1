"""Stresses of a model, and their derivatives by stretch and constants."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.material.models import Model
from dicflow.core.material.modes import MODES, principal_stretches

__all__ = ["nominal_stress", "stress_by_constants", "stress_by_stretch", "stress_in_mode", "true_stress"]


def true_stress(model: Model, c: Array, stretches: Array) -> Array:
    """σ1 = t1 − t3 along the load at principal stretches (..., 3), (...)."""
    slopes = model.slopes(c, stretches)
    return np.asarray(slopes[..., 0] - slopes[..., 2])


def nominal_stress(model: Model, c: Array, stretches: Array) -> Array:
    """P = (t1 − t3) / λ1 along the load at principal stretches (..., 3), (...)."""
    return np.asarray(true_stress(model, c, stretches) / stretches[..., 0])


def stress_in_mode(model: Model, c: Array, mode: str, stretch: Array) -> Array:
    """Nominal stress at stretches (...) in a mode whose lateral stretch follows from that along the load."""
    return nominal_stress(model, c, principal_stretches(mode, stretch))


def stress_by_constants(model: Model, c: Array, stretches: Array) -> Array:
    """∂P/∂c at principal stretches (..., 3), (..., p)."""
    by_constant = model.sensitivities(c, stretches)
    return np.asarray((by_constant[..., 0, :] - by_constant[..., 2, :]) / stretches[..., :1])


def stress_by_stretch(model: Model, c: Array, mode: str, stretches: Array) -> Array:
    """dP/dλ1 along the mode, or with λ2 held for a biaxial one, at principal stretches (..., 3), (...).

    With λ2 = λ1ⁿ and λ3 = λ1^(−1−n), λ1 dtᵢ/dλ1 = Dᵢ1 + n Dᵢ2 − (1 + n) Dᵢ3, where Dᵢⱼ = λⱼ ∂tᵢ/∂λⱼ.
    """
    exponent = MODES.get(mode, 0.0)
    change = model.curvatures(c, stretches) @ np.array([1.0, exponent, -1.0 - exponent])
    stress = true_stress(model, c, stretches)
    return np.asarray((change[..., 0] - change[..., 2] - stress) / stretches[..., 0] ** 2)
