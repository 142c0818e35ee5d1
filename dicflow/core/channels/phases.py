"""Loading and unloading, by the course of the load."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

__all__ = ["is_loading", "phases_of"]

_SHARE = 0.02


def phases_of(load: NDArray[np.float64]) -> tuple[str, ...]:
    """Loading or unloading for each step, by :func:`is_loading`."""
    return tuple("loading" if loading else "unloading" for loading in is_loading(load))


def is_loading(load: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether each step (step,) belongs to loading: the load rose to it since it last turned.

    load : (step,), NaN where unknown; such a step belongs to the phase of the step before
    The load turns where it moves back by more than 2 % of its range, so that noise and creep at rest turn nothing. A
    turning point belongs to the phase that leads to it.
    """
    known = np.flatnonzero(np.isfinite(load))
    rising = np.ones(load.shape, dtype=bool)
    if known.size:
        for number, (turn, rises) in enumerate(_turns(load[known], _SHARE * float(np.ptp(load[known])))):
            rising[known[turn + 1] if number else 0 :] = rises
    return rising


def _turns(load: NDArray[np.float64], least: float) -> list[tuple[int, bool]]:
    """Indices at which the load turns, and whether it rises from there."""
    turns: list[tuple[int, bool]] = []
    low = high = 0
    rises: bool | None = None
    for index, value in enumerate(load):
        low = index if value <= load[low] else low
        high = index if value >= load[high] else high
        if rises is not True and value > load[low] + least:
            turns, rises = [*turns, (low, True)], True
            high = index
        elif rises is not False and value < load[high] - least:
            turns, rises = [*turns, (high, False)], False
            low = index
    return turns
