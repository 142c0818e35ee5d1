"""The right photographs of a series whose truth is known exactly."""

import numpy as np
import pytest
from stereo_scene import REST, photographs
from test_stereo_correlation import NOISE, measured, tracked

from dicflow.errors import StageError


@pytest.fixture(scope="module")
def first():
    return photographs(REST, NOISE, 0)


@pytest.fixture(scope="module")
def left(first):
    return tracked([first])


def bright(image, gain):
    return np.clip(gain * image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gain", [1.3, 1.6])
def test_overexposed_points_of_the_right_photograph_are_counted(first, left, gain):
    right = bright(first[1], gain)
    stereo, _ = measured([(first[0], right)], left)[0]
    x, y = np.rint(stereo["xy"][stereo["status"] == 0]).astype(int).T
    assert stereo.attrs["summary"]["overexposed_share"] == pytest.approx((right[y, x] == 255).mean(), abs=0.01)


def test_an_overexposed_first_right_photograph_is_refused(first, left):
    with pytest.raises(StageError, match="as bright as they can be in the first right photograph"):
        measured([(first[0], bright(first[1], 2.5))], left)


def test_a_first_right_photograph_without_contrast_is_refused(first, left):
    dull = np.rint(100.0 + 0.05 * first[1]).astype(np.uint8)
    with pytest.raises(StageError, match="too little texture in the first right photograph"):
        measured([(first[0], dull)], left)
