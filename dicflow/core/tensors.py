"""Small matrices at every point: inverses, congruent transforms, and symmetric ones stored as upper triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Mask

__all__ = ["congruent", "cross", "inverse", "on_grid", "product", "symmetric", "upper_triangle"]


def inverse(matrices: Array) -> Array:
    """Inverses of matrices (..., 2, 2); NaN where a matrix is singular."""
    (a, b), (c, d) = np.moveaxis(matrices, (-2, -1), (0, 1))
    adjugate = np.moveaxis(np.array([[d, -b], [-c, a]]), (0, 1), (-2, -1))
    determinant = a * d - b * c
    return np.asarray(adjugate / np.where(determinant == 0.0, np.nan, determinant)[..., None, None])


def product(first: Array, second: Array) -> Array:
    """A B for matrices A (..., 2, 2) and B (..., 2, k) at every point, as ``@`` has it in five times the time."""
    shape = np.broadcast_shapes(first.shape[:-2], second.shape[:-2])
    result = np.empty((*shape, 2, second.shape[-1]))
    for i in range(2):
        for k in range(second.shape[-1]):
            result[..., i, k] = first[..., i, 0] * second[..., 0, k] + first[..., i, 1] * second[..., 1, k]
    return result


def cross(first: Array, second: Array) -> Array:
    """Vector products of vectors (..., 3), as numpy has them, without what that takes for other axes and lengths."""
    (a, b, c), (x, y, z) = ([vectors[..., axis] for axis in range(3)] for vectors in (first, second))
    return np.stack([b * z - c * y, c * x - a * z, a * y - b * x], axis=-1)


def congruent(matrix: Array, covariance: Array) -> Array:
    """M C Mᵀ for matrices M (..., 2, 2) and symmetric C; C and the result are (xx, xy, yy), (..., 3)."""
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


def symmetric(triangles: ArrayLike) -> Array:
    """Symmetric matrices (..., d, d) from their upper triangles, row by row, (..., d (d + 1) / 2).

    >>> symmetric([1.0, 2.0, 3.0])
    array([[1., 2.],
           [2., 3.]])
    """
    flat = np.asarray(triangles, dtype=np.float64)
    side = int((np.sqrt(8 * flat.shape[-1] + 1) - 1) / 2)
    row, col = np.triu_indices(side)
    full = np.empty((*flat.shape[:-1], side, side))
    full[..., row, col] = full[..., col, row] = flat
    return full


def upper_triangle(matrices: Array) -> Array:
    """Upper triangles of symmetric matrices: the inverse of :func:`symmetric`."""
    row, col = np.triu_indices(matrices.shape[-1])
    return matrices[..., row, col]


def on_grid(values: Array, known: Mask) -> Array:
    """Values (n, ...) of the n known points of a grid on the whole of it, NaN elsewhere. known : (row, col) bool"""
    full = np.full((*known.shape, *values.shape[1:]), np.nan)
    full[known] = values
    return full
