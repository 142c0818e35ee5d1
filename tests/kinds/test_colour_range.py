"""Colour ranges: which values they leave out, and how those of several steps join."""

from __future__ import annotations

import numpy as np
import pytest

from dicflow.kinds.maps import colour_range, joined_range


def test_a_few_outliers_do_not_take_the_colours():
    values = np.linspace(0.0, 1.0, 1001)
    values[[3, -3]] = -50.0, 70.0
    low, high = colour_range(values)
    assert low == pytest.approx(0.005, abs=2e-3)
    assert high == pytest.approx(0.995, abs=2e-3)


def test_all_values_count_when_none_is_left_out():
    assert colour_range(np.array([[3.0, np.nan], [-1.0, 2.0]]), 0.0) == (-1.0, 3.0)


def test_unknown_values_have_no_range():
    assert colour_range(np.full((2, 2), np.nan)) is None
    assert joined_range([None, None]) == (-1.0, 1.0)


def test_the_range_over_steps_holds_that_of_each():
    assert joined_range([(0.0, 2.0), None, (-1.0, 1.0)]) == (-1.0, 2.0)


def test_one_value_everywhere_still_has_a_range():
    low, high = joined_range([(0.25, 0.25)])
    assert low < 0.25 < high
