import numpy as np
import pytest
from boards import SIZE, board_photograph
from hypothesis import given
from hypothesis import strategies as st

from dicflow.core.calibration.symmetry import centres_of_symmetry, spline_weights
from dicflow.core.calibration.targets import board_points

FRACTIONS = st.floats(0.0, 0.999)
DEGREES = st.sampled_from([1, 3, 5, 7])


@given(FRACTIONS, DEGREES)
def test_spline_weights_have_the_moments_of_the_spline(fraction, degree):
    """Sum 1, centre at the place and, from degree 3 on, variance (degree + 1) / 12, wherever the place is."""
    weights = spline_weights(fraction, degree)
    offset = np.arange(degree + 1) - degree // 2 - fraction
    assert weights.sum() == pytest.approx(1.0)
    assert weights @ offset == pytest.approx(0.0, abs=1e-12)
    if degree > 1:
        assert weights @ offset**2 == pytest.approx((degree + 1) / 12.0)


def test_weights_of_the_cubic_spline():
    np.testing.assert_allclose(spline_weights(0.0, 3), [1 / 6, 4 / 6, 1 / 6, 0], atol=1e-15)
    np.testing.assert_allclose(spline_weights(0.5, 3), [1 / 48, 23 / 48, 23 / 48, 1 / 48], atol=1e-15)


def test_centre_of_symmetry_is_exact():
    y, x = np.mgrid[:60, :80]
    centre = np.array([40.37, 30.81])
    image = 1000.0 + 900.0 * np.sin(0.21 * (x - centre[0])) * np.sin(0.17 * (y - centre[1]))
    found = centres_of_symmetry(image.round().astype(np.uint16), centre[None] + [[1.2, -0.9]], 8)
    np.testing.assert_allclose(found[0], centre, atol=2e-3)


def test_a_place_near_the_border_keeps_its_window():
    """The window leaves the photograph by half; beyond it there is nothing but the border's grey."""
    y, x = np.mgrid[:40, :40]
    image = np.where((x > 3) == (y > 20), 200, 50).astype(np.uint8)
    np.testing.assert_allclose(centres_of_symmetry(image, np.array([[3.9, 20.2]]), 8), [[3.5, 20.5]], atol=0.02)


@pytest.mark.parametrize("shift", [0.0, 0.25, 0.4])
@pytest.mark.parametrize("angle_deg", [3.0, 40.0])
def test_sharp_edges_do_not_bias_corners_towards_pixels(shift, angle_deg):
    """Edges that are as sharp as pixels can show them, at any place and angle between the pixels."""
    c, s = 30.0 * np.cos(np.radians(angle_deg)), 30.0 * np.sin(np.radians(angle_deg))
    view = np.array([[c, -s, 100.0 + shift], [s, c, 40.0 + 0.7 * shift], [0, 0, 1]])
    photo = board_photograph(view, (240, 280), finer=8)
    grid = board_points(SIZE, 1.0)
    grid[:, 2] = 1.0
    truth = (grid @ view.T)[:, :2]
    inside = ((truth > 30.0) & (truth < [250.0, 210.0])).all(axis=1)
    found = centres_of_symmetry(photo, truth[inside] + [0.3, -0.2], 18)
    assert np.sqrt(np.mean((found - truth[inside]) ** 2)) < 0.006


def test_pixels_outside_the_window_do_not_count():
    """A black square in two opposite quarters, put there on one side only."""
    y, x = np.mgrid[:61, :61]
    image = np.where((x > 30) == (y > 30), 200, 50).astype(np.uint8)
    start = np.array([[30.8, 30.1]])
    plain = centres_of_symmetry(image, start, 12)
    spoilt = image.copy()
    spoilt[36:50, 36:50] = 50
    window = np.ones((1, 25, 25), bool)
    window[0, 15:, 15:] = window[0, :10, :10] = False
    np.testing.assert_allclose(centres_of_symmetry(spoilt, start, 12, window), plain, atol=5e-3)
    assert np.abs(centres_of_symmetry(spoilt, start, 12) - plain).max() > 0.05


def test_a_place_without_contrast_stays():
    image = np.full((40, 40), 100, np.uint8)
    np.testing.assert_array_equal(centres_of_symmetry(image, np.array([[20.0, 19.0]]), 6), [[20.0, 19.0]])
