import numpy as np
import pytest
from scipy.ndimage import map_coordinates

from dicflow.core.correlation.warp import apply_warp, gradient
from dicflow.core.synthetic.motion import (
    reference_points,
    render_pattern,
    speckle_pattern,
    star,
    star_period,
    strain_star,
)
from dicflow.core.synthetic.planar import render_planar, translation
from dicflow.core.synthetic.render import Extent
from dicflow.core.synthetic.speckle import scatter_speckles

EVERYWHERE = Extent(-1e9, 1e9, -1e9, 1e9)
POINTS = np.random.default_rng(0).uniform((0, 0), (2000, 501), (500, 2))


def test_star_is_the_formula():
    (x, y), moved = POINTS.T, star()(POINTS)[0]
    np.testing.assert_allclose(moved[:, 0], x)
    np.testing.assert_allclose(moved[:, 1] - y, 0.5 * np.cos(2 * np.pi * (y - 250) / (10 + 140 * x / 2000)), atol=1e-9)
    assert star_period(np.array([0.0, 2000.0])).tolist() == [10.0, 150.0]


def test_the_middle_row_of_a_strain_star_has_the_strain_everywhere():
    middle = np.stack([np.arange(2000.0), np.full(2000, 250.0)], axis=-1)
    places, slope = strain_star()(middle)
    np.testing.assert_array_equal(places, middle)
    np.testing.assert_allclose(slope[:, 1, 1], 1.05)
    (x, y), period = POINTS.T, star_period(POINTS[:, 0])
    expected = 0.05 * period / (2 * np.pi) * np.sin(2 * np.pi * (y - 250) / period)
    np.testing.assert_allclose(strain_star()(POINTS)[0], np.stack([x, y + expected], axis=-1))


@pytest.mark.parametrize("motion", [star(0.3, 120.0, 900), strain_star(0.1, 120.0, 900)])
def test_gradients_of_stars_are_their_differences(motion):
    step = 1e-4
    by_difference = [(motion(POINTS + d)[0] - motion(POINTS - d)[0]) / (2 * step) for d in step * np.eye(2)]
    np.testing.assert_allclose(motion(POINTS)[1], np.stack(by_difference, axis=-1), atol=1e-6)


def test_reference_points_invert_the_motion():
    motion = star(1.2)
    np.testing.assert_allclose(reference_points(motion, motion(POINTS)[0]), POINTS, atol=1e-7)


def test_a_motion_that_folds_the_plane_is_refused():
    with pytest.raises(ValueError, match="cannot be inverted"):
        reference_points(star(40.0), POINTS)


def test_an_affine_motion_gives_the_image_of_the_transform():
    size, margin, transform = (60, 40), 20.0, np.array([[1.04, 0.03, 1.3], [-0.02, 0.97, -2.2], [0, 0, 1]])
    speckles = scatter_speckles((100.0, 80.0), (3.0, 7.0), 1.0, 0.45, seed=4)
    expected = render_planar(speckles, size, transform @ translation((30.0, -margin)), EVERYWHERE)

    def motion(points):
        return points @ transform[:2, :2].T + transform[:2, 2], np.broadcast_to(transform[:2, :2], (*points.shape, 2))

    image = render_pattern(speckle_pattern(size, margin=margin, seed=4), size, motion)
    np.testing.assert_allclose(image, expected, atol=1e-6)


def test_grey_levels_move_with_the_material():
    warp = np.array([[31.4, 1.01, 0.02, 3e-4, -2e-4, 1e-4], [29.2, -0.01, 0.98, 1e-4, 2e-4, -3e-4]])
    size, middle = (60, 60), np.array([30.0, 30.0])

    def motion(points):
        return apply_warp(warp, points - middle), gradient(warp, points - middle)

    pattern = speckle_pattern(size, (6.0, 9.0), 6.0, seed=2)
    reference, deformed = (render_pattern(pattern, size, how, order=6) for how in (None, motion))
    here = np.stack(np.meshgrid(np.arange(12, 48), np.arange(12, 48)), axis=-1).astype(float)
    there = map_coordinates(deformed, np.moveaxis(motion(here)[0], -1, 0)[::-1], order=5)
    assert reference.std() > 20
    difference = there - reference[12:48, 12:48]  # a hundredth of a pixel would be 0.3 grey levels
    assert np.sqrt((difference**2).mean()) < 0.15
