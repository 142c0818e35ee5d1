"""Medians inside kernels, against those of numpy."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numba import njit

from dicflow.core.medians import median


@njit
def of_first(values: np.ndarray, count: int) -> float:
    """The median as a kernel has it."""
    return median(values, count)


@given(st.lists(st.floats(-1e6, 1e6) | st.sampled_from([0.0, 1.0, np.inf]), min_size=1, max_size=60), st.integers(0, 5))
def test_as_numpy(values: list[float], beyond: int) -> None:
    array = np.array([*values, *[-1e9] * beyond])
    assert of_first(array, len(values)) == np.median(values)
    assert sorted(array[: len(values)]) == sorted(values)
    assert (array[len(values) :] == -1e9).all()
