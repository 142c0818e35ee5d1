"""Medians inside compiled loops. numba's own take a second to compile for every kernel that uses them."""

from __future__ import annotations

from numba import njit

from dicflow.core.arrays import Array
from dicflow.core.kernels import INNER

__all__ = ["median"]


@njit(**INNER)
def median(values: Array, count: int) -> float:
    """Median of the first values (at least one), none of them NaN, whose order changes."""
    middle = count // 2
    upper: float = _selected(values, count, middle)
    if count % 2 == 1:
        return upper
    lower = values[0]
    for k in range(1, middle):
        lower = max(lower, values[k])
    middle_value: float = 0.5 * (lower + upper)
    return middle_value


@njit(**INNER)
def _selected(values: Array, count: int, place: int) -> float:
    """The value at a place of the first values in their order; smaller ones stand before it (Hoare's selection)."""
    low, high = 0, count - 1
    while low < high:
        pivot, i, j = values[(low + high) // 2], low, high
        while i <= j:
            while values[i] < pivot:
                i += 1
            while values[j] > pivot:
                j -= 1
            if i <= j:
                values[i], values[j] = values[j], values[i]
                i, j = i + 1, j - 1
        if place <= j:
            high = j
        elif place >= i:
            low = i
        else:
            break
    found: float = values[place]
    return found
