"""How certain a comparison of strains with a caliper's is."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array

__all__ = ["caliper_uncertainty", "reading_step"]

_STEPS_MM = (1.0, 0.5, 0.1, 0.05, 0.02, 0.01, 0.005, 0.001)


def reading_step(lengths_mm: Array) -> float:
    """The step in which a caliper was read [mm]: the largest usual one that all lengths are multiples of.

    >>> reading_step(np.array([60.0, 69.05, 82.1]))
    0.05
    """
    for step in _STEPS_MM:
        counts = lengths_mm / step
        if np.abs(counts - counts.round()).max(initial=0.0) < 1e-6 * max(1.0, np.abs(counts).max(initial=0.0)):
            return step
    return _STEPS_MM[-1]


def caliper_uncertainty(lengths_mm: Array) -> Array:
    """Standard uncertainty of a caliper's strains ε = L/L₀ − 1 by the step in which its lengths were read.

    lengths_mm : (step,) — the first without load
    Returns (step,): a length is rounded to the step s with u = s/√12 (GUM, 4.3.7), so u(ε)² = u²(1 + (L/L₀)²)/L₀²; 0 at
    the first step, whose strain is 0 by definition.
    """
    first = lengths_mm[0]
    rounded = reading_step(lengths_mm) / np.sqrt(12.0)
    found = rounded / first * np.hypot(1.0, lengths_mm / first)
    found[0] = 0.0
    return np.asarray(found)
