"""Two motions one after the other: the first image to a reference photographed in between, and from there to a third.

Warps are those of core.warp. The second one belongs to a subset around a whole pixel near the place that the first
one led to, so the material point is at a small offset from its centre.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from dicflow.core.warp import TERMS, apply_warp, gradient

__all__ = ["chained", "chained_covariance", "congruent"]

Array = npt.NDArray[np.float64]


def chained(first: Array, second: Array, centres: npt.ArrayLike) -> Array:
    """Warps (..., 2, m) of the subsets of ``first`` in the image that ``second`` leads to.

    first : (..., 2, m) — from the first image to the reference
    second : (..., 2, 3 or 6) — from the reference on
    centres : (..., 2) — of the subsets of ``second`` [px of the reference]

    With x(ξ) = x₀ + A ξ + q(ξ) and z(o) expanded about o₀ = x₀ − centre, z(x(ξ)) = z(o₀) + G (A ξ + q(ξ)) + Q(A ξ) to
    second order, where G is the gradient of z at o₀ and Q its quadratic part.
    """
    offset = first[..., 0] - np.asarray(centres, dtype=np.float64)
    slope = gradient(second, offset)
    total = np.empty(np.broadcast_shapes(first.shape[:-1], second.shape[:-1]) + first.shape[-1:])
    total[..., 0] = apply_warp(second, offset)
    total[..., 1:] = slope @ first[..., 1:]
    if first.shape[-1] == second.shape[-1] == TERMS["quadratic"]:
        (a, b), (e, f) = (np.moveaxis(first[..., axis, 1:3], -1, 0)[..., None] for axis in (0, 1))
        xx, xy, yy = second[..., 3], second[..., 4], second[..., 5]
        total[..., 3] += xx * a * a + xy * a * e + yy * e * e
        total[..., 4] += 2.0 * xx * a * b + xy * (a * f + b * e) + 2.0 * yy * e * f
        total[..., 5] += xx * b * b + xy * b * f + yy * f * f
    return total


def congruent(matrix: Array, covariance: Array) -> Array:
    """M C Mᵀ of symmetric 2 × 2 matrices C kept as (xx, xy, yy), (..., 3); matrix (..., 2, 2)."""
    (a, b), (e, f) = (np.moveaxis(matrix[..., axis, :], -1, 0) for axis in (0, 1))
    xx, xy, yy = np.moveaxis(covariance, -1, 0)
    return np.stack(
        [
            a * a * xx + 2.0 * a * b * xy + b * b * yy,
            a * e * xx + (a * f + b * e) * xy + b * f * yy,
            e * e * xx + 2.0 * e * f * xy + f * f * yy,
        ],
        axis=-1,
    )


def chained_covariance(before: Array, second: Array, centres: npt.ArrayLike, places: Array, own: Array) -> Array:
    """Covariance (..., 3) [px²] of places found through a reference: what the way there adds, and the last piece's.

    before : (..., 3) — of the places in the reference [px²]
    second, centres : as in :func:`chained`; places : (..., 2) — of the points in the reference [px]
    own : (..., 3) — of the places that ``second`` gives [px²]
    """
    slope = gradient(second, places - np.asarray(centres, dtype=np.float64))
    return congruent(slope, before) + own
