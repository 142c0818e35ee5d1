"""Drucker's stability of a model: work of every small change of stress on the strain that it makes is positive."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.material.models import Model
from dicflow.core.material.modes import MODES, principal_stretches

__all__ = ["StableRange", "is_stable", "stable_range"]

_SAMPLES = 200
_LEAST_STRETCH, _MOST_STRETCH = 0.2, 10.0


class StableRange(NamedTuple):
    """Stretches around 1 in which a model is stable, within those that were searched."""

    least: float
    most: float
    is_lower_limit: bool
    is_upper_limit: bool


def is_stable(model: Model, c: Array, stretches: Array) -> Mask:
    """Whether the model is stable at principal stretches (..., 3), (...).

    With logarithmic strains ε1, ε2 and ε3 = −ε1 − ε2, the matrix ∂²W/∂εₐ∂ε_b = Dₐb − Dₐ3 − D3b + D33 must be positive
    definite, where Dᵢⱼ = λⱼ ∂tᵢ/∂λⱼ.
    """
    with np.errstate(all="ignore"):
        d = model.curvatures(c, stretches)
        hessian = d[..., :2, :2] - d[..., :2, 2:] - d[..., 2:, :2] + d[..., 2:, 2:]
        determinant = hessian[..., 0, 0] * hessian[..., 1, 1] - hessian[..., 0, 1] * hessian[..., 1, 0]
        return np.asarray((hessian[..., 0, 0] > 0.0) & (determinant > 0.0))


def stable_range(model: Model, c: Array, mode: str, most: float = _MOST_STRETCH) -> StableRange:
    """Range of stretches in a mode in which the model is stable, from 1 outwards to within 2 %.

    mode : one of MODES
    most : largest stretch that is searched; the least is 0.2
    """
    assert mode in MODES
    up, down = np.geomspace(1.0, most, _SAMPLES), np.geomspace(1.0, _LEAST_STRETCH, _SAMPLES)
    upper, upper_ends = _last_stable(model, c, mode, up)
    lower, lower_ends = _last_stable(model, c, mode, down)
    return StableRange(lower, upper, lower_ends, upper_ends)


def _last_stable(model: Model, c: Array, mode: str, stretch: Array) -> tuple[float, bool]:
    """The last of some stretches up to which all are stable, and whether an unstable one follows."""
    bad = np.flatnonzero(~is_stable(model, c, principal_stretches(mode, stretch)))
    return (float(stretch[-1]), False) if bad.size == 0 else (float(stretch[max(0, bad[0] - 1)]), True)
