import numpy as np
import pytest

from dicflow.core.noise import image_noise, pair_noise, smoothed_noise
from dicflow.core.synthetic.planar import planar_pair

INSIDE = np.zeros((240, 240), dtype=bool)
INSIDE[20:-20, 20:-20] = True


@pytest.mark.parametrize("noise", [1.0, 2.0, 4.0])
def test_noise_of_one_image(noise):
    pair = planar_pair((240, 240), (0.0, 0.0), noise=noise)
    assert image_noise(pair.reference, INSIDE) == pytest.approx(np.hypot(noise, 12**-0.5), rel=0.2)


@pytest.mark.parametrize("noise", [0.5, 2.0, 4.0])
def test_noise_of_two_images(noise):
    pair = planar_pair((240, 240), (0.0, 0.0), noise=noise)
    assert pair_noise(pair.reference, pair.deformed, INSIDE) == pytest.approx(np.hypot(noise, 12**-0.5), rel=0.02)


def test_change_of_light_and_a_slight_motion_are_no_noise():
    pair = planar_pair((240, 240), (0.015, -0.01), noise=2.0)
    brighter = np.rint(pair.deformed * 1.03 + 4.0)
    assert pair_noise(pair.reference, brighter, INSIDE) == pytest.approx(2.0, rel=0.07)


def test_clipped_pixels_have_no_noise():
    pair = planar_pair((240, 240), (0.0, 0.0), noise=2.0)
    dark = np.clip(pair.reference.astype(float) - 45.0, 0, 255).astype(np.uint8)
    assert (dark == 0).mean() > 0.1
    assert image_noise(dark, INSIDE) == pytest.approx(2.0, rel=0.15)


def test_smoothing_leaves_less_than_white_noise():
    pair = planar_pair((240, 240), (0.0, 0.0))
    assert smoothed_noise(2.0, pair.reference, INSIDE, 0.0) == 2.0
    levels = [smoothed_noise(2.0, pair.reference, INSIDE, width) for width in (0.5, 1.0, 2.0)]
    assert 2.0 > levels[0] > levels[1] > levels[2] > 0.0


def test_smoothed_noise_of_a_wave_is_the_filters_response():
    """A wave of one frequency is only made smaller: by the filter's gain, exp(−(2π f s)²/2)."""
    x = np.arange(240.0)
    wave = np.broadcast_to(127.0 + 50.0 * np.cos(2 * np.pi * x / 12.0), (240, 240))
    expected = 2.0 * np.exp(-0.5 * (2 * np.pi / 12.0 * 1.2) ** 2)
    assert smoothed_noise(2.0, wave, INSIDE, 1.2) == pytest.approx(expected, rel=0.01)
