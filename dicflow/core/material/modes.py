"""Modes of a test: principal stretches by the stretch along the load."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array

__all__ = ["MODES", "principal_stretches"]

MODES = {
    "uniaxial": -0.5,
    "planar": 0.0,
    "equibiaxial": 1.0,
}
"""Mode → exponent n of the stretch across the load, λ2 = λ1ⁿ. In the mode biaxial λ2 is measured."""


def principal_stretches(mode: str, stretch: Array, lateral: Array | None = None) -> Array:
    """Principal stretches of an incompressible material, (..., 3).

    mode : one of MODES, or biaxial
    stretch : (...) along the load
    lateral : (...) across the load, for the mode biaxial
    Raises ValueError for an unknown mode, and for biaxial without lateral.
    """
    if mode in MODES:
        across = stretch ** MODES[mode]
    elif mode == "biaxial" and lateral is not None:
        across = lateral
    else:
        raise ValueError(f"mode '{mode}' is unknown, or has no stretch across the load")
    return np.stack([stretch, across, 1.0 / (stretch * across)], axis=-1)
