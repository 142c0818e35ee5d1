import numpy as np

from dicflow.kinds.disparity import DisparityMap
from tests.kinds.layouts import layouts, stored

VALUES = np.array([[10.25, np.nan, 11.5], [9.75, 10.0, np.nan]], np.float32)
STATUS = np.array([[0, 4, 0], [0, 0, 2]], np.uint8)


def write():
    return stored(DisparityMap.write(VALUES, STATUS, (30, 40), (-16, 48), {"valid_share": 0.8}))


def test_disparities_come_back_bit_for_bit():
    disparities = DisparityMap.read(write())
    np.testing.assert_array_equal(disparities["disparity"], VALUES)
    assert disparities["disparity"].dtype == np.float32
    np.testing.assert_array_equal(disparities["status"], STATUS)
    assert (disparities.origin, disparities.limits) == ((30, 40), (-16, 48))
    assert disparities.summary == {"valid_share": 0.8}


def test_arrays_of_disparities_have_axes_and_units():
    assert layouts(write()) == {"disparity": ("row col", "px"), "status": ("row col", "1")}
