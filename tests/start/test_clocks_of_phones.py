"""Partners among photographs whose cameras' clocks differ."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.start.clocks import Ambiguous, partners_by_time


def times(seed, count=12):
    """Moments from 8 to 40 s apart, as a person takes photographs."""
    return np.cumsum(np.random.default_rng(seed).uniform(8.0, 40.0, count))


@settings(max_examples=100)
@given(
    seed=st.integers(0, 10**6),
    ahead=st.floats(-1e5, 1e5),
    lost=st.tuples(st.sets(st.integers(0, 11), max_size=3), st.sets(st.integers(0, 11), max_size=3)),
)
def test_partners_are_found_at_any_difference_of_the_clocks(seed, ahead, lost):
    """Each phone lacks a few photographs; the right one is late by up to half a second, and EXIF has whole seconds."""
    lag = np.random.default_rng(seed + 1).uniform(0.0, 0.5, 12)
    kept = [[k for k in range(12) if k not in one] for one in lost]
    left, right = np.floor(times(seed)), np.floor(times(seed) + lag + ahead)
    found = partners_by_time(left[kept[0]], right[kept[1]])
    assert found is not None
    assert [(kept[0][i], kept[1][j]) for i, j in found.pairs] == [
        (k, k) for k in range(12) if k in kept[0] and k in kept[1]
    ]
    assert found.ahead_s == pytest.approx(ahead, abs=1.5)


def test_photographs_at_equal_intervals_need_equal_clocks():
    """A shift by one interval makes as many partners, unless the clocks agree as they are."""
    left = 10.0 * np.arange(8)
    found = partners_by_time(left, left[1:] + 0.4)
    assert found is not None
    assert found.pairs == tuple((k + 1, k) for k in range(7))
    with pytest.raises(Ambiguous):
        partners_by_time(left, left[1:] + 500.0)


def test_unlike_series_have_no_partners():
    assert partners_by_time(times(1), times(2, 40)[::3] + 1000.0) is None
    assert partners_by_time([1.0], [2.0]) is None
    assert partners_by_time([1.0, 1.0, 5.0], [1.0, 3.0, 9.0]) is None


def test_the_order_of_the_names_is_not_that_of_the_times():
    found = partners_by_time([50.0, 0.0, 20.0], [7000.0, 7020.0, 7050.0])
    assert found is not None
    assert found.pairs == ((1, 0), (2, 1), (0, 2))
