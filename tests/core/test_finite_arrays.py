import numpy as np
import pytest

from dicflow.core.arrays import all_finite


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axes", [1, 2])
def test_one_number_that_is_not_finite_is_found_wherever_it_is(wrong, axes):
    """Also where the sum of infinite numbers of both signs is no number."""
    values = np.random.default_rng(0).normal(size=(5, 7, 2, 3))
    values[0, 0, 0, 0] = wrong
    values[2, 3, 1, 2] = wrong
    values[4, 6] = np.inf
    values[4, 6, 0] = -np.inf
    expected = np.isfinite(values).all(axis=tuple(range(-axes, 0)))
    np.testing.assert_array_equal(all_finite(values, axes), expected)
    assert not expected.all()
