"""Two motions chained: from the first photograph to a reference step, and from there to the target.

Warps are those of :mod:`dicflow.core.correlation.warp`. The second one belongs to a subset around a whole pixel near
the place that the first one led to, so the material point is at a small offset from its centre.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from numba import njit

from dicflow.core.arrays import Array
from dicflow.core.correlation.warp import TERMS, expanded
from dicflow.core.kernels import KERNEL
from dicflow.core.photographs.noise import interpolated_noise_ratio

__all__ = ["Chained", "chained", "uncancelled_noise"]


_AXES = (-2, -2, -1, -2, -2)
"""Axes of one point in what is given to the kernel."""
_SAMPLES_PER_SIDE = 15
"""Places along the side of a subset at which its overlap with another one is sampled."""


class Chained(NamedTuple):
    """Two motions as one.

    warp : (..., 2, m) — of the subsets of the first motion in the target of the second one
    slope : (..., 2, 2) — gradient of the second motion at the points
    """

    warp: Array
    slope: Array


def chained(first: Array, second: Array, centres: npt.ArrayLike) -> Chained:
    """Two motions of points (...) as one.

    first : (..., 2, m) — from the first photograph to the reference step
    second : (..., 2, 3 or 6) — from the reference step to the target
    centres : (..., 2) — of the subsets of ``second`` [px of the reference step]

    With x(ξ) = x₀ + A ξ + q(ξ) and z(o) expanded about o₀ = x₀ − centre, z(x(ξ)) = z(o₀) + G (A ξ + q(ξ)) + Q(A ξ) to
    second order, where G is the gradient of z at o₀ and Q its quadratic part.
    """
    found = Chained(np.empty(first.shape), np.empty((*first.shape[:-1], 2)))
    given = (np.ascontiguousarray(values, dtype=np.float64) for values in (first, second, centres))
    _chain(*(values.reshape(-1, *values.shape[axes:]) for values, axes in zip((*given, *found), _AXES, strict=True)))
    return found


@njit(**KERNEL)
def _chain(first: Array, second: Array, centres: Array, warp: Array, slope: Array) -> None:
    """The loop of :func:`chained` over points (n, …), into ``warp`` and ``slope``."""
    terms = first.shape[2]
    for k in range(len(first)):
        x, y = first[k, 0, 0] - centres[k, 0], first[k, 1, 0] - centres[k, 1]
        a, b, e, f = first[k, 0, 1], first[k, 0, 2], first[k, 1, 1], first[k, 1, 2]
        for axis in range(2):
            c = second[k, axis]
            place, by_x, by_y = expanded(c, x, y)
            warp[k, axis, 0], slope[k, axis, 0], slope[k, axis, 1] = place, by_x, by_y
            for m in range(1, terms):
                warp[k, axis, m] = by_x * first[k, 0, m] + by_y * first[k, 1, m]
            if terms == 6 and len(c) == 6:
                warp[k, axis, 3] += c[3] * a * a + c[4] * a * e + c[5] * e * e
                warp[k, axis, 4] += 2.0 * c[3] * a * b + c[4] * (a * f + b * e) + 2.0 * c[5] * e * f
                warp[k, axis, 5] += c[3] * b * b + c[4] * b * f + c[5] * f * f


def uncancelled_noise(slope: Array, terms: int, degree: int) -> Array:
    """Variance (...) that the noise of a reference step adds to places found via it, in units of a template's own.

    slope : (..., 2, 2) — gradient A of the motion to the reference step
    terms : of the shape function, 3 or 6; degree : of the spline

    The noise moves the place found in the reference step by −Σ k(ξ) n(A ξ), and the place found with the subset there
    back by +Σ k(ξ) n(ξ). k is the kernel of the shape function: 1 over the square for an affine one, the centre value
    of the least-squares parabola, ∝ 14/15 − ξ² − η², for a quadratic one (offsets in half sides). The variance that
    remains, s(A) + 1 − 2 c, is small where the subset has kept its shape; c = Σ k(ξ) k(A ξ) / Σ k(ξ)², and s is that of
    :func:`dicflow.core.photographs.noise.interpolated_noise_ratio`.
    """
    axis = (np.arange(_SAMPLES_PER_SIDE) + 0.5) * 2.0 / _SAMPLES_PER_SIDE - 1.0
    offsets = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    here, there = _kernel(offsets, terms), _kernel(np.einsum("...ij,kj->...ki", slope, offsets), terms)
    return np.asarray(interpolated_noise_ratio(slope, degree) + 1.0 - 2.0 * (there @ here) / (here @ here))


def _kernel(offsets: Array, terms: int) -> Array:
    """k (...) at offsets (..., 2), in half sides, from a subset's centre; falls to 0 across the subset's edge."""
    inside = np.clip(0.5 + 0.5 * _SAMPLES_PER_SIDE * (1.0 - np.abs(offsets)), 0.0, 1.0).prod(axis=-1)
    return np.asarray(inside * (14.0 / 15.0 - (offsets**2).sum(axis=-1) if terms == TERMS["quadratic"] else 1.0))
