"""Which pixels of a photograph are measured."""

import numpy as np
import pytest

from dicflow.core.photographs.exposure import measured_pixels

SHAPE = (120, 160)
SPOT = np.zeros(SHAPE, dtype=bool)
SPOT[40:60, 50:90] = True


def scene(low=40.0, high=200.0, noise=2.0):
    """Grey levels of a random pattern with noise."""
    rng = np.random.default_rng(1)
    return rng.uniform(low, high, SHAPE) + rng.normal(0.0, noise, SHAPE)


def recorded(levels, ceiling, dtype):
    return np.clip(np.rint(levels), 0, ceiling).astype(dtype)


@pytest.mark.parametrize(
    ("ceiling", "dtype"), [(255, np.uint8), (1023, np.uint16), (4095, np.uint16), (3860, np.uint16), (65535, np.uint16)]
)
def test_pixels_at_the_ceiling_of_a_camera_are_not_measured(ceiling, dtype):
    levels = scene() * ceiling / 255
    grey = recorded(np.where(SPOT, 2.0 * ceiling, levels), ceiling, dtype)
    np.testing.assert_array_equal(measured_pixels(grey), ~SPOT)


def test_ten_bits_on_the_left_of_sixteen():
    grey = recorded(np.where(SPOT, 2000.0, scene() * 4.0), 1023, np.uint16) << 6
    np.testing.assert_array_equal(measured_pixels(grey), ~SPOT)


def test_pixels_at_zero_are_not_measured():
    np.testing.assert_array_equal(measured_pixels(recorded(np.where(SPOT, -50.0, scene()), 255, np.uint8)), ~SPOT)


def test_all_are_measured_in_a_photograph_that_is_not_clipped():
    assert measured_pixels(recorded(scene(), 255, np.uint8)) is None
    even = np.arange(SHAPE[0] * SHAPE[1]).reshape(SHAPE) % 256  # every level equally often, 0 and 255 too
    assert measured_pixels(even.astype(np.uint8)) is None


def test_a_plain_ground_without_noise_is_not_clipped():
    assert measured_pixels(np.where(SPOT, 83, 176).astype(np.uint8)) is None


def test_pixels_that_show_nothing_are_not_measured():
    grey = recorded(np.where(SPOT, 300.0, scene()), 255, np.uint8)
    shown = np.ones(SHAPE, dtype=bool)
    shown[:10] = False
    beside = np.arange(SHAPE[0])[:, None] >= 12  # and two rows beside them
    np.testing.assert_array_equal(measured_pixels(grey, shown), ~SPOT & beside)
    assert measured_pixels(recorded(scene(), 255, np.uint8), np.ones(SHAPE, dtype=bool)) is None
