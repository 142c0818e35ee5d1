"""A test's cycle of loading and unloading: work, loop area, set, moduli."""

from __future__ import annotations

import itertools
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy.interpolate import PchipInterpolator

from dicflow.core.arrays import Array

__all__ = ["Cycle", "cycle_of", "peak_of", "propagated", "secant_modulus", "tangent_modulus", "work_along"]

_UNLOADED = 0.01
"""Share of the largest stress below which a specimen counts as unloaded."""
_PARTS = 16
"""Parts of each interval in which its work is summed."""


class Cycle(NamedTuple):
    """Work per first volume and set of one cycle, in the units of the stresses; NaN where there is no unloading.

    loading : work from the first step to the largest stress
    unloading : work that is given back from there to the last step
    loop : work that is lost: the area between both branches. If the last step is under load, the area above its stretch
    set : stretch that remains at the last step; if it is under load, beyond that of loading at the same stress
    is_closed : whether the last step is unloaded
    """

    loading: float
    unloading: float
    loop: float
    set: float
    is_closed: bool


def peak_of(stress: Array) -> int:
    """Index of the step where loading ends: the last with the largest stress (n,), of a test in compression the least.

    NaN is left out.
    """
    size = _sign(stress) * stress
    return int(np.flatnonzero(size == np.nanmax(size))[-1])


def _sign(stress: Array) -> float:
    """−1 of a test in compression, whose stresses are none above 0, else 1."""
    return 1.0 if np.nanmax(stress) > 0.0 else -1.0


def cycle_of(stretch: Array, stress: Array) -> Cycle:
    """The cycle of stretches and stresses (n,) without NaN. Raises ValueError for fewer than two points."""
    if len(stretch) < 2:
        raise ValueError(f"{len(stretch)} points; a curve has two or more")
    if (sign := _sign(stress)) < 0.0:
        found = _rising_cycle(sign * stretch, sign * stress)
        return found._replace(set=sign * found.set)
    return _rising_cycle(stretch, stress)


def _rising_cycle(stretch: Array, stress: Array) -> Cycle:
    """The cycle of a test whose stress and stretch rise on loading."""
    peak = peak_of(stress)
    loading = work_along(stretch[: peak + 1], stress[: peak + 1])
    if peak == len(stress) - 1:
        return Cycle(loading, np.nan, np.nan, np.nan, False)
    unloading = -work_along(stretch[peak:], stress[peak:])
    is_closed = bool(abs(stress[-1]) <= _UNLOADED * stress[peak])
    start = stretch[0] if is_closed else stretch[-1]
    above = loading - work_along(*_up_to(stretch[: peak + 1], stress[: peak + 1], start))
    return Cycle(loading, unloading, above - unloading, _set(stretch, stress, peak, is_closed), is_closed)


def _set(stretch: Array, stress: Array, peak: int, is_closed: bool) -> float:
    """The last stretch less that of loading at the same stress, or at rest."""
    if is_closed:
        return float(stretch[-1] - stretch[0])
    rising = np.maximum.accumulate(stress[: peak + 1])
    keep = np.append(True, np.diff(rising) > 0.0)
    if keep.sum() < 2:
        return float(stretch[-1] - stretch[0])
    before = PchipInterpolator(rising[keep], stretch[: peak + 1][keep])
    return float(stretch[-1] - before(np.clip(stress[-1], rising[0], rising[-1])))


def _up_to(stretch: Array, stress: Array, end: float) -> tuple[Array, Array]:
    """The part of a rising curve up to a stretch, (m,) each."""
    inside = stretch < end
    if inside.all() or not inside.any():
        return stretch[inside], stress[inside]
    last = float(_joined(stretch, stress)(end)) if _rises(stretch) else float(np.interp(end, stretch, stress))
    return np.append(stretch[inside], end), np.append(stress[inside], last)


def _rises(stretch: Array) -> bool:
    return bool((np.diff(stretch) > 0.0).all())


def _joined(stretch: Array, stress: Array) -> Callable[[float], Array]:
    found: Callable[[float], Array] = PchipInterpolator(stretch, stress)
    return found


def work_along(stretch: Array, stress: Array) -> float:
    """∫ P dλ along a path of points (n,), joined by a smooth curve without overshoot; 0 with fewer than two.

    Both coordinates are monotone cubics of the length of the polygon through the points, in units of their ranges.
    """
    if len(stretch) < 2:
        return 0.0
    steps = np.hypot(_scaled_steps(stretch), _scaled_steps(stress))
    keep = np.append(True, steps > 0.0)
    if keep.sum() < 2:
        return 0.0
    place = np.cumsum(np.append(0.0, steps[steps > 0.0]))
    along = PchipInterpolator(place, stretch[keep])
    fine = np.concatenate([np.linspace(a, b, _PARTS, endpoint=False) for a, b in itertools.pairwise(place)])
    fine = np.append(fine, place[-1])
    x, y = along(fine), PchipInterpolator(place, stress[keep])(fine)
    return float(np.sum((y[1:] + y[:-1]) / 2.0 * np.diff(x)))


def _scaled_steps(values: Array) -> Array:
    return np.asarray(np.diff(values) / (np.ptp(values) or 1.0))


def secant_modulus(stretch: Array, stress: Array) -> Array:
    """P / (λ − 1) at every step, (n,); NaN without strain."""
    strain = stretch - 1.0
    return np.asarray(np.where(strain == 0.0, np.nan, stress / np.where(strain == 0.0, np.nan, strain)))


def tangent_modulus(stretch: Array, stress: Array) -> Array:
    """dP/dλ at every step, (n,), from parabolas through three neighbours of its branch; NaN where they do not exist.

    The step with the largest stress belongs to loading.
    """
    found = np.full(len(stretch), np.nan)
    peak = peak_of(stress)
    for branch in (slice(peak, None), slice(0, peak + 1)):
        x, y = stretch[branch], stress[branch]
        if len(x) >= 3 and (np.diff(x) != 0.0).all():
            found[branch] = np.gradient(y, x, edge_order=2)
    return found


def propagated(function: Callable[[Array], Array], values: Array, sigma: Array) -> Array:
    """Standard deviation (m,) of the results of a function of values (n,) with independent errors ``sigma`` (n,)."""
    variance = np.zeros_like(np.atleast_1d(function(values)))
    for index in np.flatnonzero(sigma > 0.0):
        shift = np.zeros_like(values)
        shift[index] = 0.1 * sigma[index]
        variance = variance + ((function(values + shift) - function(values - shift)) / 0.2) ** 2
    return np.sqrt(variance)
