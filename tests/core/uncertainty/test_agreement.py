"""Statistics of two fields that differ, and scattered values at other places."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.uncertainty.agreement import agreement, resampled


def grid(pitch, size=60.0):
    axis = np.arange(0.0, size + 1e-9, pitch)
    return np.stack(np.meshgrid(axis, axis), axis=-1)


def test_known_shift_and_sigma():
    rng = np.random.default_rng(4)
    count, shift, sigma = 40_000, 0.3, 0.2
    found = agreement(rng.normal(shift, sigma, count))
    assert found.points == count
    assert found.mean == pytest.approx(shift, abs=4 * sigma / math.sqrt(count))
    assert found.sigma == pytest.approx(sigma, rel=4 / math.sqrt(2 * count))
    assert found.rms == pytest.approx(math.hypot(found.mean, found.sigma))
    assert found.percentiles == pytest.approx((shift - 1.96 * sigma, shift, shift + 1.96 * sigma), abs=0.02 * sigma * 4)
    assert found.share_beyond_sigma is None


def test_share_outside_of_independent_gaussian_errors():
    count, rng = 40_000, np.random.default_rng(5)
    sigma = rng.uniform(0.5, 2.0, (2, count))
    one, other = rng.normal(0.0, sigma)
    found = agreement(one - other, np.hypot(*sigma))
    expected = math.erfc(1 / math.sqrt(2))
    assert found.share_beyond_sigma == pytest.approx(expected, abs=3 * math.sqrt(expected * (1 - expected) / count))


def test_points_that_one_field_lacks_count_in_the_share_alone():
    found = agreement(np.array([[1.0, np.nan], [-3.0, 1.0]]), np.array([[2.0, 2.0], [2.0, np.nan]]))
    assert (found.points, found.share, found.largest, found.share_beyond_sigma) == (3, 0.75, 3.0, 0.5)


def test_fields_without_common_points():
    found = agreement(np.full(4, np.nan), np.ones(4))
    assert (found.points, found.share, found.share_beyond_sigma) == (0, 0.0, None)
    assert math.isnan(found.mean)


@settings(max_examples=5)
@given(st.floats(-2, 2), st.floats(-2, 2), st.floats(-2, 2))
def test_a_linear_field_is_found_exactly_on_another_grid(slope_x, slope_y, constant):
    fine, coarse = grid(5.0), grid(7.0)

    def field(places):
        return np.stack([places @ [slope_x, slope_y] + constant, 2.0 * places[..., 0]], axis=-1)

    found = resampled(fine.reshape(-1, 2), field(fine).reshape(-1, 2), coarse)
    assert found.shape == (*coarse.shape[:2], 2)
    np.testing.assert_allclose(found, field(coarse), atol=1e-10)


def test_resampled_is_nan_outside_in_holes_and_beside_missing_points():
    places = grid(5.0).reshape(-1, 2)
    values = places[:, :1].copy()
    hole = np.abs(places - 30.0).max(axis=1) < 12.0
    lost = (places == [5.0, 5.0]).all(axis=1)
    at = np.array([[30.0, 30.0], [-1.0, 20.0], [6.0, 6.0], [52.0, 52.0], [np.nan, 1.0]])
    found = resampled(np.where(hole[:, None], np.nan, places), np.where(lost[:, None], np.nan, values), at)[:, 0]
    np.testing.assert_array_equal(np.isfinite(found), [False, False, False, True, False])
    assert found[3] == pytest.approx(52.0)


@pytest.mark.parametrize("places", [np.empty((0, 2)), np.array([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0], [3.0, 3.0]])])
def test_points_on_a_line_give_no_values(places):
    found = resampled(places, np.ones((len(places), 1)), np.array([[1.0, 1.0]]))
    assert np.isnan(found).all()
