"""What fitted models say of tests that they were not fitted to."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.material.fit import Curve, Fit, fit, largest_invariant, relative_errors
from dicflow.core.material.models import Model
from dicflow.core.material.modes import MODES, principal_stretches
from dicflow.core.material.response import nominal_stress, stress_by_constants
from dicflow.core.material.stability import is_stable

__all__ = [
    "Guess",
    "Spread",
    "errors_of",
    "leave_one_out",
    "predicted",
    "shear_gradient",
    "spread_of",
    "stable_within",
    "unsure_pairs",
]

_BEYOND = 0.1
"""Share of the measured range by which stability is looked for beyond it."""
_SAMPLES = 60
_CLOSELY = 0.95
"""Correlation from which two constants count as not separated."""


class Guess(NamedTuple):
    """Constants of a model that may be right, (p,), and their covariance (p, p)."""

    model: Model
    constants: Array
    covariance: Array


class Spread(NamedTuple):
    """How far guesses differ in a mode at one stretch.

    percent : half their range, relative to their mean; least, most : ends of the range [MPa]
    """

    mode: str
    stretch: float
    percent: float
    least: float
    most: float


def predicted(model: Model, found: Fit, stretches: Array) -> tuple[Array, Array]:
    """Nominal stress and half its interval of 95 % at principal stretches (n, 3), (n,) each."""
    stress = nominal_stress(model, found.constants, stretches)
    return stress, found.half_width_of(stress_by_constants(model, found.constants, stretches))


def errors_of(model: Model, c: Array, curve: Curve) -> float:
    """Root mean square of predicted less measured stress of a curve, in units of the stress."""
    with np.errstate(over="ignore", invalid="ignore"):
        return relative_errors([nominal_stress(model, c, curve.stretches) - curve.stress], [curve])[0]


def leave_one_out(model: Model, curves: Sequence[Curve]) -> list[float]:
    """Error by which the fit to all other curves predicts each one, as :func:`errors_of`; NaN with too few points."""
    found = []
    for number, curve in enumerate(curves):
        others = [*curves[:number], *curves[number + 1 :]]
        if sum(len(other.stress) for other in others) <= len(model.constants):
            found.append(float("nan"))
        else:
            found.append(errors_of(model, fit(model, others).constants, curve))
    return found


def stable_within(model: Model, c: Array, curves: Sequence[Curve], beyond: float = _BEYOND) -> dict[str, float]:
    """Stretch at which the model turns unstable, by mode, within the largest measured stretch and a share beyond.

    Empty where it is stable in all of MODES.
    """
    most = max(float(curve.stretches[:, 0].max()) for curve in curves)
    stretch = np.linspace(1.0, 1.0 + (most - 1.0) * (1.0 + beyond), _SAMPLES)
    found = {}
    for mode in MODES:
        bad = np.flatnonzero(~is_stable(model, c, principal_stretches(mode, stretch)))
        if bad.size:
            found[mode] = float(stretch[bad[0]])
    return found


def shear_gradient(model: Model, c: Array) -> Array:
    """Derivatives of the initial shear modulus by the constants (p,), by small changes of each."""
    steps = 1e-6 * np.maximum(np.abs(c), 1e-9)
    moved = [model.shear_modulus(c + step * unit) for step, unit in zip(steps, np.eye(len(c)), strict=True)]
    return np.asarray((np.array(moved) - model.shear_modulus(c)) / steps)


def unsure_pairs(model: Model, correlation: Array) -> list[tuple[str, str, float]]:
    """Names and correlation of constants that tests do not tell apart, the closest pair first.

    correlation : of the constants, (p, p); NaN for those at a limit
    """
    names = [one.name for one in model.constants]
    pairs = [(names[i], names[j], float(correlation[i, j])) for i in range(len(names)) for j in range(i)]
    return sorted((pair for pair in pairs if abs(pair[2]) >= _CLOSELY), key=lambda pair: -abs(pair[2]))


def spread_of(guesses: Sequence[Guess], curves: Sequence[Curve]) -> list[Spread]:
    """Half the range of what several guesses predict, by mode, at the largest stretch that the tests allow there.

    That stretch has the largest I1 of all curves, so that no mode is extrapolated further than another. The range
    contains the intervals of 95 % of the guesses.
    """
    largest, longest = largest_invariant(curves), max(float(curve.stretches[:, 0].max()) for curve in curves)
    found = []
    for mode in MODES:
        stretches = principal_stretches(mode, np.linspace(1.0, longest, 400))
        end = stretches[(stretches**2).sum(axis=-1) - 3.0 <= largest][-1]
        ends = np.array([_interval(guess, end) for guess in guesses])
        least, most = float(ends[:, 0].min()), float(ends[:, 1].max())
        percent = 50.0 * (most - least) / max(abs(float(ends.mean())), 1e-300)
        found.append(Spread(mode, float(end[0]), percent, least, most))
    return found


def _interval(guess: Guess, stretches: Array) -> tuple[float, float]:
    """Ends of the interval of 95 % of the nominal stress at principal stretches (3,)."""
    with np.errstate(over="ignore", invalid="ignore"):
        stress = float(nominal_stress(guess.model, guess.constants, stretches))
        gradient = stress_by_constants(guess.model, guess.constants, stretches)
        half = 2.0 * math.sqrt(max(0.0, float(gradient @ guess.covariance @ gradient)))
    return stress - half, stress + half
