"""Values of a log at the times of the steps, and how fast they change."""

from __future__ import annotations

from enum import IntEnum
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Joined", "Missing", "interpolate", "rates"]

_GAP = 20.0
"""Times the median interval of rows above which a log has a gap."""


class Missing(IntEnum):
    """Why a step has no value."""

    KNOWN = 0
    UNTIMED = 1
    BEFORE = 2
    AFTER = 3
    GAP = 4


class Joined(NamedTuple):
    """Values of a channel at the steps.

    values : (step,), NaN where unknown
    slopes : (step,) — change per second there, between the two neighbouring rows
    missing : (step,) — why a value is unknown
    """

    values: NDArray[np.float64]
    slopes: NDArray[np.float64]
    missing: NDArray[np.uint8]


def interpolate(seconds: NDArray[np.float64], values: NDArray[np.float64], at: NDArray[np.float64]) -> Joined:
    """Values on the line between the rows before and after each time; unknown beyond the log's ends and in gaps.

    seconds, values : (row,) — of the log, in order; rows with a NaN do not count
    at : (step,) — times by the log's clock, NaN where unknown
    Of rows with equal times the mean counts. A gap is 20 times as long as the median interval of rows.
    """
    seconds, values = _mean_of_equal(seconds, values)
    missing = np.where(np.isfinite(at), Missing.KNOWN, Missing.UNTIMED).astype(np.uint8)
    found, slopes = np.full(at.shape, np.nan), np.full(at.shape, np.nan)
    if not seconds.size:
        return Joined(found, slopes, np.maximum(missing, np.uint8(Missing.GAP)))
    missing[at < seconds[0]] = Missing.BEFORE
    missing[at > seconds[-1]] = Missing.AFTER
    inside = missing == Missing.KNOWN
    if seconds.size == 1:
        found[inside] = values[0]
        return Joined(found, slopes, missing)
    after = np.clip(np.searchsorted(seconds, at[inside], side="right"), 1, seconds.size - 1)
    intervals = np.diff(seconds)
    share = (at[inside] - seconds[after - 1]) / intervals[after - 1]
    found[inside] = (1.0 - share) * values[after - 1] + share * values[after]
    slopes[inside] = np.diff(values)[after - 1] / intervals[after - 1]
    apart = (intervals[after - 1] > _GAP * np.median(intervals)) & (share > 0.0) & (share < 1.0)
    missing[np.flatnonzero(inside)[apart]] = Missing.GAP
    found[missing == Missing.GAP] = slopes[missing == Missing.GAP] = np.nan
    return Joined(found, slopes, missing)


def rates(seconds: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change per second (step,) at each of a series of values: the slope of the parabola through it and its neighbours.

    seconds, values : (step,), NaN where unknown. At an end it is that of the first two or last two values
    """
    found = np.full(values.shape, np.nan)
    known = np.isfinite(seconds) & np.isfinite(values)
    known[known] = np.diff(seconds[known], prepend=-np.inf) > 0
    if known.sum() >= 2:
        found[known] = np.gradient(values[known], seconds[known])
    return found


def _mean_of_equal(
    seconds: NDArray[np.float64], values: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The rows with a value, those of equal times as their mean."""
    known = np.isfinite(seconds) & np.isfinite(values)
    times, place, counts = np.unique(seconds[known], return_inverse=True, return_counts=True)
    return times, np.bincount(place, values[known], times.size) / counts
