"""Two motions chained: from the first photograph to a reference step, and from there to the target.

Warps are those of :mod:`dicflow.core.correlation.warp`. The second one belongs to a subset around a whole pixel near
the place that the first one led to, so the material point is at a small offset from its centre.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dicflow.core.arrays import Array
from dicflow.core.correlation.warp import TERMS, apply_warp, gradient
from dicflow.core.photographs.noise import interpolated_noise_ratio
from dicflow.core.tensors import product

__all__ = ["chained", "uncancelled_noise"]


_SAMPLES_PER_SIDE = 15
"""Places along the side of a subset at which its overlap with another one is sampled."""


def chained(first: Array, second: Array, centres: npt.ArrayLike) -> Array:
    """Warps (..., 2, m) of the subsets of ``first`` in the target of ``second``.

    first : (..., 2, m) — from the first photograph to the reference step
    second : (..., 2, 3 or 6) — from the reference step to the target
    centres : (..., 2) — of the subsets of ``second`` [px of the reference step]

    With x(ξ) = x₀ + A ξ + q(ξ) and z(o) expanded about o₀ = x₀ − centre, z(x(ξ)) = z(o₀) + G (A ξ + q(ξ)) + Q(A ξ) to
    second order, where G is the gradient of z at o₀ and Q its quadratic part.
    """
    offset = first[..., 0] - np.asarray(centres, dtype=np.float64)
    slope = gradient(second, offset)
    total = np.empty(np.broadcast_shapes(first.shape[:-1], second.shape[:-1]) + first.shape[-1:])
    total[..., 0] = apply_warp(second, offset)
    total[..., 1:] = product(slope, first[..., 1:])
    if first.shape[-1] == second.shape[-1] == TERMS["quadratic"]:
        (a, b), (e, f) = (np.moveaxis(first[..., axis, 1:3], -1, 0)[..., None] for axis in (0, 1))
        xx, xy, yy = second[..., 3], second[..., 4], second[..., 5]
        total[..., 3] += xx * a * a + xy * a * e + yy * e * e
        total[..., 4] += 2.0 * xx * a * b + xy * (a * f + b * e) + 2.0 * yy * e * f
        total[..., 5] += xx * b * b + xy * b * f + yy * f * f
    return total


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
