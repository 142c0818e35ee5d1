"""Cholesky's factorisation of small matrices, for compiled loops."""

from __future__ import annotations

import numpy as np
from numba import njit

from dicflow.core.arrays import Array
from dicflow.core.kernels import INNER

__all__ = ["factorise", "solve", "solve_columns"]


@njit(error_model="numpy", **INNER)
def factorise(matrix: Array, min_pivot_share: float) -> bool:
    """Factorise a symmetric matrix (n, n) in place; only its lower triangle is read and written.

    min_pivot_share : smallest pivot, relative to the diagonal element it came from
    Returns False where a pivot is smaller: the matrix is singular, or close to it.
    """
    size = len(matrix)
    for j in range(size):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not pivot > min_pivot_share * matrix[j, j]:
            return False
        matrix[j, j] = np.sqrt(pivot)
        for i in range(j + 1, size):
            rest = matrix[i, j]
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = rest / matrix[j, j]
    return True


@njit(error_model="numpy", **INNER)
def solve(factor: Array, vector: Array) -> None:
    """Solve L Lᵀ x = b in place: b (n,) becomes x. factor : L (n, n) from :func:`factorise`."""
    size = len(factor)
    for i in range(size):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            vector[i] -= factor[k, i] * vector[k]
        vector[i] /= factor[i, i]


@njit(error_model="numpy", **INNER)
def solve_columns(factor: Array, columns: Array) -> None:
    """Solve L Lᵀ X = B in place: B (n, m) becomes X. factor : as for :func:`solve`."""
    for column in range(columns.shape[1]):
        solve(factor, columns[:, column])
