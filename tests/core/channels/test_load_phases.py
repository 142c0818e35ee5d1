"""Loading and unloading by the load alone."""

import numpy as np
import pytest

from dicflow.core.channels.phases import is_loading, phases_of


@pytest.mark.parametrize(
    ("load", "loading"),
    [
        ([0, 100, 200, 300, 200, 100, 0], [1, 1, 1, 1, 0, 0, 0]),
        ([0, 1, 2, 3], [1, 1, 1, 1]),
        ([3, 2, 1], [0, 0, 0]),
        ([0, 0, 5, 9, 5, 0, 0, 5, 10], [1, 1, 1, 1, 0, 0, 0, 1, 1]),
        ([1, 1, 1], [1, 1, 1]),
    ],
)
def test_a_turning_point_belongs_to_the_phase_that_leads_to_it(load, loading):
    assert is_loading(np.array(load, dtype=float)).tolist() == [bool(one) for one in loading]


def test_noise_below_two_percent_of_the_range_turns_nothing():
    time = np.linspace(0.0, 2.0, 400)
    load = 100.0 * (1.0 - np.abs(time - 1.0)) + np.random.default_rng(1).uniform(-0.9, 0.9, time.size)
    expected = np.arange(time.size) <= int(np.argmax(load))
    assert np.array_equal(is_loading(load), expected)


def test_an_unknown_load_belongs_to_the_phase_before():
    assert phases_of(np.array([0.0, 2.0, np.nan, 1.0, np.nan])) == ("loading",) * 3 + ("unloading",) * 2
    assert phases_of(np.full(2, np.nan)) == ("loading",) * 2
    assert phases_of(np.zeros(0)) == ()
