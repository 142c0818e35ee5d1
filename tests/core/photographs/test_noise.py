import numpy as np
import pytest

from dicflow.core.photographs.interpolate import interpolate, spline
from dicflow.core.photographs.noise import (
    Noise,
    image_noise,
    interpolated_noise_ratio,
    noise_from_pair,
    noise_of_first_photograph,
    pair_noise,
    smoothed_noise,
)
from dicflow.core.synthetic.planar import planar_pair

pytestmark = pytest.mark.slow

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


def noise_from_moved_pair(noise, shift, variance, smoothing_px=0.0, points=50, by_places=np.inf):
    """Noise from two photographs in which all points have one shift and one variance."""
    pair = planar_pair((240, 240), shift, noise=2.0)
    centres = np.random.default_rng(0).integers(40, 200, (points, 2)).astype(float)
    found = centres, centres + shift, np.full(points, variance)
    return noise_from_pair(
        noise, pair.reference, pair.deformed, INSIDE, found, by_places, pixels=10**4, smoothing_px=smoothing_px
    )


def test_residuals_of_subsets_that_follow_the_motion_tell_the_noise():
    """Of 441 pixels each, with noise alone, and where most of them have a misfit on top."""
    rng = np.random.default_rng(1)
    scatter = 4.0 * rng.chisquare(441, 2000) / 441
    misfit = np.where(rng.uniform(size=2000) < 0.7, rng.uniform(0.0, 4.0, 2000), 0.0)
    centres, image = rng.uniform(0.0, 200.0, (2000, 2)), np.zeros((240, 240))
    for variance, rel in ((scatter, 0.01), (scatter + misfit, 0.03)):
        found = noise_from_pair(
            Noise(9.0, "first photograph", False), image, image, INSIDE, (centres, centres + 1.0, variance), np.inf,
            pixels=441, smoothing_px=0.0,
        )  # fmt: skip
        assert found.grey == pytest.approx(2.0, rel=rel)


def test_a_second_photograph_makes_the_noise_final():
    first = noise_of_first_photograph(planar_pair((240, 240), (0.0, 0.0), noise=2.0).reference, INSIDE)
    assert not first.is_final
    static = noise_from_moved_pair(first, (0.0, 0.0), 0.0)
    assert static == (pytest.approx(np.hypot(2.0, 12**-0.5), rel=0.02), "static pair", True)
    small, large = noise_from_moved_pair(first, (3.0, 1.0), 1e-6), noise_from_moved_pair(first, (3.0, 1.0), 900.0)
    assert small == (pytest.approx(12**-0.5), "residual of a second photograph", True)
    assert large == first._replace(is_final=True)
    by_places = noise_from_moved_pair(first, (3.0, 1.0), 900.0, by_places=1.5)
    assert by_places == (1.5, "residual of a second photograph", True)
    assert noise_from_moved_pair(first, (3.0, 1.0), 1e-6, smoothing_px=1.0) == first._replace(is_final=True)


def test_without_a_point_the_noise_is_not_final():
    first = Noise(2.0, "first photograph", False)
    assert noise_from_moved_pair(first, (3.0, 1.0), 0.0, points=0) == first


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


@pytest.mark.parametrize("degree", [3, 5])
@pytest.mark.parametrize("stretch", [0.6, 1.0, 1.4, 2.3])
def test_noise_that_interpolation_leaves_in_a_mean(degree, stretch):
    """Means over a subset of white noise, sampled at distances other than a pixel, against the mean of its pixels."""
    side, half = 25, 12
    noise = spline(np.random.default_rng(3).normal(0.0, 1.0, (1400, 1400)).astype(np.float32), degree)
    reach = 60 + int(stretch * half)
    places = np.stack(np.meshgrid(*[np.arange(reach, 1400 - reach, stretch * (side + 3))] * 2), axis=-1)
    axis = np.arange(-half, half + 1)
    offsets = stretch * np.stack(np.meshgrid(axis, axis), axis=-1)
    means = [np.mean(interpolate(noise, place + offsets)) for place in places.reshape(-1, 2)]
    found = np.var(means) * side**2 / interpolated_noise_ratio(stretch * np.eye(2), degree)
    assert found == pytest.approx(1.0, abs=5.0 / np.sqrt(len(means) / 2))


def test_turns_leave_noise_as_it_is():
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    assert interpolated_noise_ratio(turn, 5) == pytest.approx(1.0, rel=1e-4)
    sheared = turn @ np.diag([0.5, 1.2])
    assert interpolated_noise_ratio(sheared, 5) == pytest.approx(interpolated_noise_ratio(np.diag([0.5, 1.2]), 5))
