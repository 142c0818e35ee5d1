"""What fitted models say of tests that they were not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.material.fit import Curve, Fit, fit, relative_errors
from dicflow.core.material.models import Model
from dicflow.core.material.modes import MODES, principal_stretches
from dicflow.core.material.response import nominal_stress, stress_by_constants
from dicflow.core.material.stability import is_stable

__all__ = ["Spread", "errors_of", "leave_one_out", "predicted", "spread_of", "stable_within", "unsure_pairs"]

_BEYOND = 0.1
"""Share of the measured range by which stability is looked for beyond it."""
_SAMPLES = 60
_CLOSELY = 0.95
"""Correlation from which two constants count as not separated."""


class Spread(NamedTuple):
    """How far models that fit alike differ in a mode at one stretch, in percent of their mean."""

    mode: str
    stretch: float
    percent: float


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


def unsure_pairs(model: Model, found: Fit) -> list[tuple[str, str, float]]:
    """Names and correlation of constants that the tests do not tell apart, the closest pair first."""
    names, rho = [one.name for one in model.constants], found.correlation
    pairs = [(names[i], names[j], float(rho[i, j])) for i in range(len(names)) for j in range(i)]
    return sorted((pair for pair in pairs if abs(pair[2]) >= _CLOSELY), key=lambda pair: -abs(pair[2]))


def spread_of(fits: Sequence[tuple[Model, Array]], curves: Sequence[Curve]) -> list[Spread]:
    """Half the range of predictions of several fits, by mode, at the largest stretch that the tests allow there.

    That stretch is the one with the largest I1 of all curves, so that no mode is extrapolated further than another.
    """
    largest = max(float((curve.stretches**2).sum(axis=-1).max()) for curve in curves)
    found = []
    for mode in MODES:
        stretch = np.linspace(1.0, max(float(curve.stretches[:, 0].max()) for curve in curves), 400)
        inside = (principal_stretches(mode, stretch) ** 2).sum(axis=-1) <= largest
        end = float(stretch[inside][-1])
        with np.errstate(over="ignore", invalid="ignore"):
            stresses = [nominal_stress(model, c, principal_stretches(mode, np.array(end))) for model, c in fits]
        percent = 50.0 * float(np.ptp(stresses)) / max(abs(float(np.mean(stresses))), 1e-300)
        found.append(Spread(mode, end, percent))
    return found
