"""Cholesky's factorisation of small matrices, for compiled loops."""

from __future__ import annotations

from typing import Any

import numpy as np
from numba import njit

__all__ = ["factorise", "solve", "solve_columns"]


@njit(cache=True, nogil=True, error_model="numpy")
def factorise(matrix: Any, least: float) -> bool:
    """Factorise a symmetric matrix (n, n) in place; only its lower triangle is read and written.

    least : share of its diagonal element that each pivot must keep
    Returns False where a pivot does not: the matrix is singular, or close to it.
    """
    size = len(matrix)
    for j in range(size):
        pivot = matrix[j, j]
        for k in range(j):
            pivot -= matrix[j, k] * matrix[j, k]
        if not pivot > least * matrix[j, j]:
            return False
        matrix[j, j] = np.sqrt(pivot)
        for i in range(j + 1, size):
            rest = matrix[i, j]
            for k in range(j):
                rest -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = rest / matrix[j, j]
    return True


@njit(cache=True, nogil=True, error_model="numpy")
def solve(factor: Any, vector: Any) -> None:
    """Solve L Lᵀ x = b in place: b (n,) becomes x. factor : L (n, n), as :func:`factorise` leaves it."""
    size = len(factor)
    for i in range(size):
        for k in range(i):
            vector[i] -= factor[i, k] * vector[k]
        vector[i] /= factor[i, i]
    for i in range(size - 1, -1, -1):
        for k in range(i + 1, size):
            vector[i] -= factor[k, i] * vector[k]
        vector[i] /= factor[i, i]


@njit(cache=True, nogil=True, error_model="numpy")
def solve_columns(factor: Any, sides: Any) -> None:
    """The same for every column of ``sides`` (n, m)."""
    for column in range(sides.shape[1]):
        solve(factor, sides[:, column])
