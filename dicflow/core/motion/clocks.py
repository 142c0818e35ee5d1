"""The clocks of two cameras, joined by what both saw: motion, or a change of the light."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.optimize import minimize_scalar

__all__ = ["Joined", "Signal", "join_clocks", "principal_motions"]

_PRINCIPAL = 3
"""Independent motions that a signal holds at most."""
_MIN_OVERLAP = 0.4
"""Least share of the shorter video that both saw."""
_MIN_VARIATION = 0.1
"""An offset counts only if what both saw then varies by this share of the most that they could have seen."""
_MOST_SAMPLES = 1500
"""Samples of the first search; longer signals are thinned out for it."""
_NEXT_BEST = 1.2
"""How much more of the motion the next best offset must leave unexplained."""
_SMOOTH = 9
"""Samples whose mean counts where the speed is asked for."""
_CORRELATED = 3.0
"""Errors of neighbouring frames are alike: so many times fewer are independent."""


class Signal(NamedTuple):
    """What a camera saw over time.

    times : (n,) — rising [s]
    values : (n, k) — k quantities
    """

    times: np.ndarray
    values: np.ndarray


class Joined(NamedTuple):
    """How two clocks are joined.

    offset : time on the first clock where the second one shows 0 [s]
    u : standard uncertainty [s]
    next_best : how many times more of the motion another offset leaves unexplained; 1 and less if it repeats itself
    """

    offset: float
    u: float
    next_best: float

    @property
    def is_unique(self) -> bool:
        """Whether no other offset explains the motion nearly as well."""
        return self.next_best > _NEXT_BEST


def principal_motions(cells: np.ndarray) -> np.ndarray:
    """The strongest independent motions over time (n, k ≤ 3) of the displacements (n, cell, 2) of cells [px]."""
    flat = cells.reshape(len(cells), -1)
    u, s, _ = np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)
    return np.asarray((u * s)[:, : min(_PRINCIPAL, s.size)])


def join_clocks(one: Signal, other: Signal) -> Joined | None:
    """The offset at which both cameras saw the same.

    With L(t) the first signal, R the second: s(τ) is what R(t − τ) leaves after its projection upon
    [1, t, L(t), L₁(t)²], as a share of what it leaves after that upon [1, t]. A common scale, another view of the same
    motion and a slow drift have no effect then. The offset is the likeliest one: −n(τ) log s(τ) is largest, where n
    samples were seen by both. A small share alone says little, since few samples are explained easily. Returns None
    where nothing varies in both.
    """
    search = _Search(*(_thinned(signal) for signal in (one, other)))
    offsets = search.candidates()
    shares = np.array([search.unexplained(offset) for offset in offsets])
    if not np.isfinite(shares).any():
        return None
    best = int(np.nanargmax(-np.log(np.maximum(shares, 1e-12)) * search.samples(offsets)))
    fine = _Search(one, other)
    step = offsets[1] - offsets[0] if offsets.size > 1 else 0.0
    found = minimize_scalar(
        lambda offset: float(np.nan_to_num(fine.unexplained(offset), nan=1.0)),
        bounds=(offsets[best] - step, offsets[best] + step),
        method="bounded",
        options={"xatol": 1e-5},
    )
    return Joined(float(found.x), fine.uncertainty(float(found.x)), _next_best(shares, best))


def _thinned(signal: Signal) -> Signal:
    """The signal with means of neighbours, so that it has no more samples than a search can try."""
    every = -(-len(signal.times) // _MOST_SAMPLES)
    count = len(signal.times) // every * every
    times = signal.times[:count].reshape(-1, every).mean(axis=1)
    return Signal(times, signal.values[:count].reshape(len(times), every, -1).mean(axis=1))


def _next_best(shares: np.ndarray, best: int) -> float:
    """The least share unexplained beyond the nearest rises on both sides of the best, over the least of all."""
    known = np.where(np.isfinite(shares), shares, np.inf)
    limit = min(_NEXT_BEST * known[best], 1.0)
    left = next((k for k in range(best, -1, -1) if known[k] > limit), -1)
    right = next((k for k in range(best, known.size) if known[k] > limit), known.size)
    others = np.concatenate([known[: left + 1], known[right:]])
    finite = others[np.isfinite(others)]
    return float(finite.min() / max(known[best], 1e-12)) if finite.size else np.inf


class _Search:
    """Shares that stay unexplained, by offset."""

    def __init__(self, one: Signal, other: Signal) -> None:
        self._one, self._other = one, other
        self._spline = CubicSpline(other.times, other.values) if len(other.times) > 1 else None
        self._speed = _speed(other)
        self._most = float(np.var(other.values, axis=0).sum()) if len(other.times) else 0.0

    def candidates(self) -> np.ndarray:
        """Offsets at which both saw enough, half a frame apart."""
        one, other = self._one.times, self._other.times
        if min(one.size, other.size) < 8:
            return np.zeros(1)
        shared = _MIN_OVERLAP * min(np.ptp(one), np.ptp(other))
        step = 0.5 * min(np.ptp(one) / (one.size - 1), np.ptp(other) / (other.size - 1))
        return np.arange(one[0] - other[-1] + shared, one[-1] - other[0] - shared + step, step)

    def samples(self, offsets: np.ndarray) -> np.ndarray:
        """How many samples of the first camera lie within what the second one saw, for each offset."""
        return np.array([self._inside(offset).sum() for offset in offsets])

    def unexplained(self, offset: float) -> float:
        """The share of what the second camera saw that the first one does not explain; NaN where nothing varies."""
        parts = self._parts(offset)
        if parts is None:
            return np.nan
        seen, slow, known = parts
        varying = float((_rest(seen, slow) ** 2).sum())
        if varying < _MIN_VARIATION**2 * self._most * len(seen):
            return np.nan
        return float((_rest(seen, known) ** 2).sum()) / varying

    def uncertainty(self, offset: float) -> float:
        """Standard uncertainty of the offset, from what stays unexplained and how fast the picture moved [s]."""
        parts = self._parts(offset)
        if parts is None or self._spline is None:
            return np.inf
        seen, _, known = parts
        inside = self._inside(offset)
        times = self._one.times[inside] - offset
        speeds = [np.interp(times, self._other.times, one) for one in self._speed.T]
        speed = _rest(np.stack(speeds, axis=1), known)
        rest, freedom = _rest(seen, known), (len(seen) - known.shape[1]) * seen.shape[1]
        moved = float((speed**2).sum())
        return float(np.sqrt(_CORRELATED * (rest**2).sum() / max(freedom, 1) / moved)) if moved else np.inf

    def _inside(self, offset: float) -> np.ndarray:
        times = self._one.times - offset
        return np.asarray((times >= self._other.times[0]) & (times <= self._other.times[-1]))

    def _parts(self, offset: float) -> tuple[np.ndarray, np.ndarray, np.ndarray] | None:
        """What the second camera saw at the first one's times, slow functions of time, and these with what it saw."""
        inside = self._inside(offset)
        count = int(inside.sum())
        values = self._one.values[inside]
        if self._spline is None or count < 8 + 2 * values.shape[1]:
            return None
        times = np.interp(self._one.times[inside], self._one.times[inside][[0, -1]], [-1.0, 1.0])
        slow = np.stack([np.ones(count), times], axis=1)
        strongest = values[:, :1] - values[:, :1].mean()
        known = np.concatenate([slow, values, strongest**2], axis=1)
        return self._spline(self._one.times[inside] - offset), slow, known


def _speed(signal: Signal) -> np.ndarray:
    """Rates of change (n, k) of means over a few samples: those of single ones are mostly noise [1/s]."""
    if len(signal.times) < 2:
        return np.zeros_like(signal.values)
    kernel = np.full(_SMOOTH, 1.0 / _SMOOTH)
    padded = np.pad(signal.values, ((_SMOOTH // 2, _SMOOTH // 2), (0, 0)), mode="edge")
    means = np.stack([np.convolve(one, kernel, mode="valid") for one in padded.T], axis=1)
    return np.asarray(np.gradient(means, signal.times, axis=0))


def _rest(values: np.ndarray, known: np.ndarray) -> np.ndarray:
    """What of the values (n, k) stays after their projection upon the columns of ``known`` (n, m)."""
    scale = np.abs(known).max(axis=0)
    q, r = np.linalg.qr(known / np.where(scale > 0, scale, 1.0))
    q = q[:, np.abs(np.diag(r)) > 1e-9 * len(known)]
    return np.asarray(values - q @ (q.T @ values))
