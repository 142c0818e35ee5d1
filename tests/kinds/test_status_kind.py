import numpy as np
import pytest

from dicflow.core.status import Status
from dicflow.errors import StageError
from dicflow.kinds.status import fitted_status, known_or_nan

KNOWN = np.array([[True, False], [False, True]])


@pytest.mark.parametrize("trailing", [(), (3,), (2, 2)])
def test_all_components_of_unknown_values_are_nan(trailing):
    values = np.arange(1.0, 1.0 + 4 * int(np.prod(trailing))).reshape(2, 2, *trailing)
    kept = known_or_nan(KNOWN, values)
    np.testing.assert_array_equal(kept[KNOWN], values[KNOWN])
    assert np.isnan(kept[~KNOWN]).all()
    assert np.isfinite(values).all()


@pytest.mark.parametrize("dtype", [np.float32, np.float64])
def test_the_precision_of_known_values_stays(dtype):
    assert known_or_nan(KNOWN, np.ones((2, 2), dtype)).dtype == dtype


def test_a_measured_point_without_a_fit_has_too_few_neighbours():
    before = np.array([[Status.VALID, Status.OUTSIDE], [Status.FILLED, Status.VALID]], np.uint8)
    measured = before <= Status.FILLED
    fitted = np.array([[True, False], [False, True]])
    after = fitted_status(measured, fitted, before, (9, 5), 2)
    assert after.tolist() == [[Status.VALID, Status.OUTSIDE], [Status.TOO_FEW_NEIGHBOURS, Status.VALID]]
    assert after.dtype == np.uint8


def test_a_window_that_fits_no_measured_point_is_refused_with_its_size_and_degree():
    with pytest.raises(StageError, match=r"9 × 5 points .* degree 2"):
        fitted_status(KNOWN, ~KNOWN, np.zeros((2, 2), np.uint8), (9, 5), 2)


def test_a_step_without_measured_points_is_not_refused():
    none = np.zeros((2, 2), bool)
    status = np.full((2, 2), Status.OUTSIDE, np.uint8)
    np.testing.assert_array_equal(fitted_status(none, none, status, (9, 5), 2), status)
