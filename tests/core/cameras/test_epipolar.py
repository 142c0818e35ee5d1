import numpy as np
import pytest
from boards import swapped, verged_rig
from hypothesis import given
from hypothesis import strategies as st

from dicflow.core.cameras.camera import Camera, Rig, camera_matrix, project, to_right
from dicflow.core.cameras.epipolar import (
    epipolar_distance,
    epipolar_slopes,
    essential_matrix,
    fundamental_matrix,
    signed_epipolar_distance,
)

RIG = verged_rig()
POINTS = np.random.default_rng(1).uniform([-40, -30, 350], [40, 30, 450], (200, 3))


def test_essential_matrix_has_two_equal_singular_values():
    values = np.linalg.svd(essential_matrix(RIG), compute_uv=False)
    np.testing.assert_allclose(values, np.linalg.norm(RIG.translation) * np.array([1, 1, 0]), atol=1e-10)


def test_perfect_matches_lie_on_their_lines():
    left, right = project(RIG.left, POINTS), project(RIG.right, to_right(RIG, POINTS))
    np.testing.assert_allclose(epipolar_distance(RIG, left, right), 0.0, atol=1e-8)


def test_the_right_epipole_is_the_left_centre():
    epipole = RIG.right.matrix @ RIG.translation
    np.testing.assert_allclose(epipole @ fundamental_matrix(RIG) / np.linalg.norm(epipole), 0.0, atol=1e-12)


@given(st.floats(-3, 3))
def test_distance_in_parallel_cameras_is_the_row_difference(rows):
    camera = Camera(camera_matrix(1500.0, (320, 240)), np.zeros(5), (640, 480))
    rig = Rig(camera, camera, np.eye(3), np.array([-80.0, 0, 0]))
    left, right = project(camera, POINTS), project(camera, to_right(rig, POINTS))
    np.testing.assert_allclose(epipolar_distance(rig, left, right + np.array([0.0, rows])), abs(rows), atol=1e-9)


def test_swapped_cameras_give_the_same_distance():
    left, right = project(RIG.left, POINTS) + 0.3, project(RIG.right, to_right(RIG, POINTS))
    distance = epipolar_distance(RIG, left, right)
    assert distance.mean() > 0.1
    np.testing.assert_allclose(epipolar_distance(swapped(RIG), right, left), distance, rtol=1e-9)


def test_shape_follows_the_points():
    assert epipolar_distance(RIG, np.zeros((4, 5, 2)), np.zeros((4, 5, 2))).shape == (4, 5)
    assert np.isnan(epipolar_distance(RIG, [np.nan, 3.0], [1.0, 2.0])) == pytest.approx(True)


def test_slopes_are_those_of_the_distance_of_matched_points():
    camera = RIG.left._replace(distortion=np.array([-0.2, 0.1, 1e-3, -5e-4, 0.02]))
    rig = RIG._replace(left=camera, right=RIG.right._replace(distortion=-0.5 * camera.distortion))
    left, right = project(rig.left, POINTS), project(rig.right, to_right(rig, POINTS))
    step = 1e-3 * np.eye(2)
    by_left, by_right = epipolar_slopes(rig, left, right)
    for axis in range(2):
        of_left = [signed_epipolar_distance(rig, left + sign * step[axis], right) for sign in (1, -1)]
        of_right = [signed_epipolar_distance(rig, left, right + sign * step[axis]) for sign in (1, -1)]
        np.testing.assert_allclose(by_left[:, axis], (of_left[0] - of_left[1]) / 2e-3, atol=1e-5)
        np.testing.assert_allclose(by_right[:, axis], (of_right[0] - of_right[1]) / 2e-3, atol=1e-5)
