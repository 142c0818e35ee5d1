"""The offset of two clocks, from what both saw: when the specimen moved, and when it rested."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

__all__ = ["Offset", "change", "find_offset"]

_BLOCK = 4
_MOST_TRIALS = 40_000
_FINE = 40
_LEAST_CORRELATION = 0.6
_MOST_UNEXPLAINED = 0.7
_LEAST_INTERVALS = 8


class Offset(NamedTuple):
    """seconds : what the log's clock shows more than that of the steps; u : its standard uncertainty [s];
    correlation : of the motion in the pictures and in the log; other : the next best offset, NaN without one
    """

    seconds: float
    u: float
    correlation: float
    other: float
    is_clear: bool


def change(before: NDArray[np.floating], after: NDArray[np.floating]) -> float:
    """How much a photograph (row, col) differs from the one before it: root mean square over blocks of 4 × 4 px,
    without a common change of brightness, in grey levels.
    """
    difference = _blocks(after) - _blocks(before)
    return float(np.std(difference))


def find_offset(
    at: NDArray[np.float64], changes: NDArray[np.float64], seconds: NDArray[np.float64], values: NDArray[np.float64]
) -> Offset:
    """The offset by which a log moves when the pictures do.

    at : (step,) — times of the steps; changes : (step − 1,) — of the picture from step to step
    seconds, values : (row,) — a channel that moves with the specimen, such as crosshead or force
    Between two steps the log changes by |L(t₁ + δ) − L(t₀ + δ)|; beyond its ends it rests. Both changes are made
    bounded, x / (x + median), as that of pictures is, and correlated over the intervals for every δ. The best δ is
    clear if the correlation is at least 0.6, and leaves at most 0.7 of the variance unexplained that any other peak
    leaves. Its uncertainty is that of the least-squares fit, with the intervals of the log beside it.
    Raises ValueError with fewer than 8 intervals, or where the pictures or the log never move.
    """
    seen = _bounded(changes)
    if len(seen) < _LEAST_INTERVALS or np.ptp(seen) == 0.0 or np.ptp(values) == 0.0:
        raise ValueError("too few steps, or no motion in them")
    step = float(np.median(np.diff(at)))
    first, last = float(seconds[0] - at[-1]), float(seconds[-1] - at[0])
    trials = np.arange(first, last, max(step / 2.0, (last - first) / _MOST_TRIALS))
    scores = np.array([_score(seen, _moved(at + trial, seconds, values)) for trial in trials])
    best = int(np.argmax(scores))
    fine = trials[best] + step * np.linspace(-1.0, 1.0, 2 * _FINE + 1)
    refined = np.array([_score(seen, _moved(at + trial, seconds, values)) for trial in fine])
    place = int(np.argmax(refined))
    offset, score = float(fine[place]), float(refined[place])
    other = _other_peak(scores, best)
    rival = 0.0 if other is None else max(0.0, float(scores[other]))
    clear = score >= _LEAST_CORRELATION and 1.0 - score**2 <= _MOST_UNEXPLAINED * (1.0 - rival**2)
    slope = [_bounded(_moved(at + offset + sign * step / 4.0, seconds, values)) for sign in (1.0, -1.0)]
    u = np.hypot(
        _fit_uncertainty(seen, _bounded(_moved(at + offset, seconds, values)), (slope[0] - slope[1]) / (step / 2.0)),
        float(np.median(np.diff(seconds))) / np.sqrt(12.0),
    )
    return Offset(offset, float(u), score, float("nan") if other is None else float(trials[other]), clear)


def _blocks(image: NDArray[np.floating]) -> NDArray[np.float64]:
    rows, cols = (size // _BLOCK * _BLOCK for size in image.shape)
    parts = image[:rows, :cols].astype(np.float64).reshape(rows // _BLOCK, _BLOCK, cols // _BLOCK, _BLOCK)
    return np.asarray(parts.mean(axis=(1, 3)))


def _moved(at: NDArray[np.float64], seconds: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Change of a channel from each time to the next."""
    return np.abs(np.diff(np.interp(at, seconds, values)))


def _bounded(changes: NDArray[np.float64]) -> NDArray[np.float64]:
    middle = float(np.median(changes[changes > 0.0])) if (changes > 0.0).any() else 1.0
    return changes / (changes + middle)


def _score(seen: NDArray[np.float64], moved: NDArray[np.float64]) -> float:
    """Correlation of the changes; 0 where the log rests."""
    logged = _bounded(moved)
    spread = float(seen.std() * logged.std())
    return float(((seen - seen.mean()) * (logged - logged.mean())).mean()) / spread if spread > 0.0 else 0.0


def _other_peak(scores: NDArray[np.float64], best: int) -> int | None:
    """Index of the best score beyond the two valleys beside the best one."""
    left, right = best, best
    while left > 0 and scores[left - 1] <= scores[left]:
        left -= 1
    while right < len(scores) - 1 and scores[right + 1] <= scores[right]:
        right += 1
    outside = np.ones(len(scores), dtype=bool)
    outside[left : right + 1] = False
    return int(np.argmax(np.where(outside, scores, -np.inf))) if outside.any() else None


def _fit_uncertainty(seen: NDArray[np.float64], logged: NDArray[np.float64], slope: NDArray[np.float64]) -> float:
    """Standard uncertainty of the offset in seen = a + b · logged(offset)."""
    gain, shift = np.polyfit(logged, seen, 1)
    residual = seen - shift - gain * logged
    steepness = float(gain**2 * ((slope - slope.mean()) ** 2).sum())
    return float(np.sqrt(residual @ residual / max(1, len(seen) - 3) / steepness)) if steepness > 0.0 else float("inf")
