"""The scale of one camera, from a length and from boards that lie in the plane."""

import numpy as np
import pytest

from dicflow.core.calibration.plane_scale import common_scale, scale_of_board, scale_of_length
from dicflow.core.calibration.targets import board_points
from dicflow.core.cameras.camera import Camera, camera_matrix, project, rotation_matrix

CAMERA = Camera(camera_matrix(4000.0, (600.0, 500.0)), np.zeros(5), (1200, 1000))
STAND_OFF = 500.0
POINTS = board_points((9, 6), 10.0)
SCALE = STAND_OFF / 4000.0


def marks(turn=(0.0, 0.0, 0.2), shift=(-30.0, -20.0)):
    """The board as a camera sees it that looks at its plane from 500 mm."""
    centre = np.array([40.0 + shift[0], 25.0 + shift[1], STAND_OFF])
    return project(CAMERA, (POINTS - POINTS.mean(axis=0)) @ rotation_matrix(turn).T + centre)


def test_a_length_and_its_uncertainty():
    found = scale_of_length([[100.0, 50.0], [400.0, 450.0]], 60.0, 0.3, 0.5)
    assert found.mm_per_px == pytest.approx(60.0 / 500.0)
    assert found.u / found.mm_per_px == pytest.approx(np.hypot(0.3 / 60.0, np.sqrt(2.0) * 0.5 / 500.0))
    assert np.isnan(found.variation)


def test_a_board_square_to_the_camera_is_exact():
    found = scale_of_board(marks(), POINTS[:, :2])
    assert found.mm_per_px == pytest.approx(SCALE, rel=1e-9)
    assert found.u < 1e-9
    assert found.variation < 1e-9


def test_hidden_marks_do_not_count():
    seen = marks()
    seen[::3] = np.nan
    assert scale_of_board(seen, POINTS[:, :2]).mm_per_px == pytest.approx(SCALE, rel=1e-9)


def test_a_tilt_of_three_degrees_shows_as_variation_and_in_the_uncertainty():
    """Depth varies by ± 40 mm · sin 3° over the board; the scale follows it, along x twice and along y once."""
    found = scale_of_board(marks((0.0, np.radians(3.0), 0.0)), POINTS[:, :2])
    depth = 2.0 * 40.0 * np.sin(np.radians(3.0)) / STAND_OFF
    assert found.variation == pytest.approx(1.5 * depth, rel=0.02)
    assert abs(found.mm_per_px - SCALE) < 2.0 * found.u


def test_errors_of_noisy_marks_agree_with_the_uncertainty():
    rng = np.random.default_rng(1)
    found = [scale_of_board(marks() + rng.normal(0.0, 0.05, (54, 2)), POINTS[:, :2]) for _ in range(300)]
    errors = np.array([one.mm_per_px for one in found]) - SCALE
    assert np.sqrt(np.mean(errors**2)) == pytest.approx(np.sqrt(np.mean([one.u**2 for one in found])), rel=0.5)
    assert np.mean(np.abs(errors) < 2.0 * np.array([one.u for one in found])) > 0.9


def test_the_squares_and_boards_that_differ_count():
    assert scale_of_board(marks(), POINTS[:, :2], 0.001).u == pytest.approx(0.001 * SCALE, rel=1e-6)
    one, other = scale_of_board(marks(), POINTS[:, :2]), scale_of_board(marks() * 1.002, POINTS[:, :2])
    both = common_scale([one, other])
    assert both.mm_per_px == pytest.approx((one.mm_per_px + other.mm_per_px) / 2.0)
    assert both.u == pytest.approx(abs(one.mm_per_px - other.mm_per_px) / 2.0, rel=1e-6)
