"""Values of a log at given times, and rates."""

import numpy as np
import pytest

from dicflow.core.channels.join import Missing, interpolate, rates

SECONDS = np.arange(0.0, 10.0)


def test_a_straight_line_is_exact_between_the_rows_and_on_them():
    at = np.array([0.0, 0.25, 3.0, 8.75, 9.0])
    found = interpolate(SECONDS, 2.0 * SECONDS - 1.0, at)
    np.testing.assert_allclose(found.values, 2.0 * at - 1.0, rtol=1e-15)
    np.testing.assert_allclose(found.slopes, 2.0)
    assert not found.missing.any()


def test_a_smooth_curve_is_off_by_an_eighth_of_its_curvature():
    """Linear interpolation of t² in the middle of an interval h is h² / 4 too large."""
    found = interpolate(SECONDS, SECONDS**2, np.array([4.5]))
    assert found.values[0] - 4.5**2 == pytest.approx(0.25)


def test_beyond_the_ends_and_without_a_time_nothing_is_made_up():
    found = interpolate(SECONDS, SECONDS, np.array([-0.1, np.nan, 9.1, 5.0]))
    assert found.missing.tolist() == [Missing.BEFORE, Missing.UNTIMED, Missing.AFTER, Missing.KNOWN]
    assert np.isnan(found.values).tolist() == [True, True, True, False]


def test_a_gap_is_not_bridged():
    seconds = np.concatenate([SECONDS, SECONDS + 100.0])
    found = interpolate(seconds, seconds, np.array([9.0, 50.0, 100.0]))
    assert found.missing.tolist() == [Missing.KNOWN, Missing.GAP, Missing.KNOWN]
    assert found.values[[0, 2]].tolist() == [9.0, 100.0]


def test_rows_of_one_moment_count_as_their_mean_and_those_without_value_not_at_all():
    seconds, values = np.array([0.0, 1.0, 1.0, 2.0, 3.0]), np.array([0.0, 1.0, 3.0, np.nan, 4.0])
    assert interpolate(seconds, values, np.array([1.0, 2.0])).values.tolist() == [2.0, 3.0]
    assert np.isnan(interpolate(seconds, np.full(5, np.nan), np.array([1.0])).values).all()


def test_rates_of_a_parabola_are_exact_inside():
    seconds = np.array([0.0, 1.0, 3.0, 4.0, 4.0, 6.0])
    found = rates(seconds, seconds**2)
    np.testing.assert_allclose(found[1:4], 2.0 * seconds[1:4])
    assert np.isnan(found[4])
    assert np.isnan(rates(seconds[:1], seconds[:1])).all()
