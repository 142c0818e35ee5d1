import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from dicflow.core.cameras.camera import (
    Camera,
    Rig,
    camera_matrix,
    distort,
    project,
    rotation_angle_deg,
    rotation_matrix,
    rotation_vector,
    to_right,
    undistort,
)

MILD = (-0.11, 0.09, 4e-4, -3e-4, 0.02)


def make_camera(distortion=MILD) -> Camera:
    return Camera(camera_matrix(2400.0, (716.3, 962.8)), np.array(distortion), (1440, 1920))


def test_perfect_pinhole():
    camera = make_camera((0.0,) * 5)
    assert project(camera, [30.0, -20.0, 400.0]) == pytest.approx([716.3 + 180.0, 962.8 - 120.0], abs=1e-12)


def test_projection_agrees_with_opencv():
    points = np.random.default_rng(1).uniform([-80, -100, 350], [80, 100, 500], (200, 3))
    camera = make_camera()
    expected, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), camera.matrix, camera.distortion)
    assert np.abs(project(camera, points) - expected[:, 0]).max() < 1e-9


def test_batch_axes_are_kept():
    camera = make_camera()
    points = np.full((3, 4, 3), 1.0)
    assert project(camera, points).shape == (3, 4, 2)
    assert undistort(camera, np.full((5, 1, 2), 300.0)).shape == (5, 1, 2)


@given(
    st.tuples(st.floats(-0.15, 0.15), st.floats(-0.1, 0.1), st.floats(-2e-3, 2e-3), st.floats(-2e-3, 2e-3)),
    st.floats(-0.35, 0.35),
    st.floats(-0.45, 0.45),
)
def test_undistort_inverts_distort(coefficients, x, y):
    camera = make_camera((*coefficients, 0.01))
    assert np.abs(undistort(camera, distort(camera, [x, y])) - [x, y]).max() < 1e-12


def test_every_pixel_of_a_photograph_has_its_ray():
    camera = make_camera()
    pixels = np.stack(np.meshgrid(np.linspace(0, 1439, 40), np.linspace(0, 1919, 50)), axis=-1)
    assert np.abs(distort(camera, undistort(camera, pixels)) - pixels).max() < 1e-9


def test_no_ray_beyond_the_fold():
    camera = make_camera((-0.5, 0.0, 0.0, 0.0, 0.0))
    # x (1 − x²/2) has its maximum, 0.544, at x = √(2/3)
    reachable, beyond = np.array([0.54, 0.0]), np.array([0.55, 0.0])
    centre = camera.matrix[:2, 2]
    assert np.isfinite(undistort(camera, centre + 2400.0 * reachable)).all()
    assert np.isnan(undistort(camera, centre + 2400.0 * beyond)).all()


def test_points_behind_the_camera_give_nan():
    assert np.isnan(project(make_camera(), [[1.0, 2.0, -5.0], [0.0, 0.0, 0.0]])).all()


@given(st.tuples(*[st.floats(-1.5, 1.5)] * 3))
def test_rotation_vector_inverts_rotation_matrix(vector):
    rotation = rotation_matrix(vector)
    assert np.abs(rotation @ rotation.T - np.eye(3)).max() < 1e-12
    assert np.abs(rotation_vector(rotation) - vector).max() < 1e-7
    assert rotation_angle_deg(rotation) == pytest.approx(np.degrees(np.linalg.norm(vector)), abs=1e-6)


def test_small_angles_are_accurate():
    assert rotation_angle_deg(rotation_matrix([0.0, np.radians(1e-6), 0.0])) == pytest.approx(1e-6, rel=1e-6)
    assert rotation_angle_deg(rotation_matrix([0.2, 0, 0]), rotation_matrix([0.5, 0, 0])) == pytest.approx(
        np.degrees(0.3)
    )


def test_to_right_follows_the_convention():
    camera = make_camera()
    rig = Rig(camera, camera, rotation_matrix([0.0, np.pi / 2, 0.0]), np.array([1.0, 2.0, 3.0]))
    assert to_right(rig, [[10.0, 20.0, 30.0]]) == pytest.approx(np.array([[31.0, 22.0, -7.0]]), abs=1e-12)
