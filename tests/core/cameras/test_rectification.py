import numpy as np
import pytest
from boards import swapped, verged_rig
from hypothesis import given
from hypothesis import strategies as st
from scenes import texture

from dicflow.core.cameras.camera import project, rotation_matrix, to_right
from dicflow.core.cameras.rectification import (
    photograph_outline,
    raw_to_rectified,
    rectification,
    rectified_to_raw,
    rectify,
    triangulate_disparity,
)

POINTS = np.random.default_rng(4).uniform([-50, -40, 330], [50, 40, 480], (300, 3))


def seen_rectified(rig, points):
    """Rectified left and right pixels of points in the left camera's frame."""
    view = rectification(rig)
    left = raw_to_rectified(project(rig.left, points), rig.left, view.rotation_left, view.matrix_left)
    right = raw_to_rectified(
        project(rig.right, to_right(rig, points)), rig.right, view.rotation_right, view.matrix_right
    )
    return view, left, right


@pytest.fixture(params=[0.0, 19.0, 51.0, -19.0], ids="{:g}°".format)
def rig(request):
    return (
        verged_rig(request.param) if request.param else verged_rig(0.001)._replace(translation=np.array([-90.0, 1, 2]))
    )


def test_axes_are_one_frame_seen_from_both_cameras(rig):
    view = rectification(rig)
    for rotation in (view.rotation_left, view.rotation_right):
        np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)
        assert rotation[0, 0] > 0.7
    np.testing.assert_allclose(view.rotation_right @ rig.rotation, view.rotation_left, atol=1e-12)
    np.testing.assert_allclose(view.rotation_right @ rig.translation, [-view.baseline_mm, 0, 0], atol=1e-9)


def test_a_point_has_the_same_row_in_both_images(rig):
    _, left, right = seen_rectified(rig, POINTS)
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=1e-9)


def test_perfect_disparities_give_the_points(rig):
    view, left, right = seen_rectified(rig, POINTS)
    np.testing.assert_allclose(triangulate_disparity(left, left[:, 0] - right[:, 0], view), POINTS, atol=1e-8)


def test_swapped_cameras_give_the_mirrored_disparity_and_the_same_points(rig):
    view, left, right = seen_rectified(rig, POINTS)
    other, other_left, other_right = seen_rectified(swapped(rig), to_right(rig, POINTS))
    assert other.baseline_mm == pytest.approx(-view.baseline_mm)
    assert other.size == view.size
    np.testing.assert_allclose(other_left, right, atol=1e-8)
    np.testing.assert_allclose(other_right, left, atol=1e-8)
    points = triangulate_disparity(other_left, other_left[:, 0] - other_right[:, 0], other)
    np.testing.assert_allclose(points, to_right(rig, POINTS), atol=1e-8)


def test_all_of_both_photographs_is_seen_at_their_scale(rig):
    view = rectification(rig)
    for camera, rotation, matrix in (
        (rig.left, view.rotation_left, view.matrix_left),
        (rig.right, view.rotation_right, view.matrix_right),
    ):
        outline = photograph_outline(camera, rotation, matrix)
        assert outline.min() > -1e-9
        assert (outline.max(axis=0) <= np.array(view.size) - 1 + 1e-9).all()
        middle = np.array(camera.size) / 2.0
        step = np.diff(raw_to_rectified([middle, middle + np.array([0, 1])], camera, rotation, matrix), axis=0)
        scale = np.linalg.norm(step)
        assert 0.97 < scale < 1.25


@given(st.floats(0, 639), st.floats(0, 479))
def test_raw_and_rectified_pixels_are_inverse(x, y):
    rig = verged_rig()
    view = rectification(rig)
    there = raw_to_rectified([x, y], rig.right, view.rotation_right, view.matrix_right)
    back = rectified_to_raw(there, rig.right, view.rotation_right, view.matrix_right)
    np.testing.assert_allclose(back, [x, y], atol=1e-7)


def test_rectified_images_hold_the_photograph_s_grey_levels():
    """The pattern itself at the pixels that the geometry predicts; 0 beyond the photograph."""
    rig = verged_rig()
    view = rectification(rig)
    y, x = np.mgrid[:480, :640]
    photograph = np.round(texture(x, y, shortest=8.0)).clip(0, 255).astype(np.uint8)
    found = rectify(photograph, rig.left, view.rotation_left, view.matrix_left, view.size)
    rows, cols = np.mgrid[: view.size[1], : view.size[0]]
    raw = rectified_to_raw(np.stack([cols, rows], axis=-1), rig.left, view.rotation_left, view.matrix_left)
    inside = (raw > 6).all(axis=-1) & (raw < [633, 473]).all(axis=-1)
    error = found[inside] - texture(raw[..., 0], raw[..., 1], shortest=8.0).clip(0, 255)[inside]
    assert found.dtype == np.uint8
    assert np.sqrt(np.mean(error**2)) < 0.8
    outside = (raw < -5).any(axis=-1) | (raw > [645, 485]).any(axis=-1)
    assert (found[outside] == 0).all()


def test_a_skewed_camera_is_rectified_as_its_points_are():
    rig = verged_rig()
    camera = rig.left._replace(matrix=rig.left.matrix + np.array([[0.0, 30, 0], [0, 0, 0], [0, 0, 0]]))
    view = rectification(rig)
    rows, cols = np.mgrid[0 : camera.size[1], 0 : camera.size[0]]
    grey = np.round(128 + 60 * np.cos(cols / 40.0) * np.cos(rows / 50.0)).astype(np.uint8)
    image = rectify(grey, camera, view.rotation_left, view.matrix_left, view.size)
    x, y = np.meshgrid(np.arange(200, 500, 7), np.arange(150, 400, 7))
    raw = rectified_to_raw(np.stack([x, y], axis=-1), camera, view.rotation_left, view.matrix_left)
    expected = 128 + 60 * np.cos(raw[..., 0] / 40.0) * np.cos(raw[..., 1] / 50.0)
    assert np.abs(image[y, x] - expected).max() < 1.5


def test_deep_photographs_stay_deep():
    rig = verged_rig()
    view = rectification(rig)
    deep = np.full((480, 640), 40000, np.uint16)
    found = rectify(deep, rig.left, view.rotation_left, view.matrix_left, view.size)
    assert found.dtype == np.uint16
    assert found[view.size[1] // 2, view.size[0] // 2] == 40000


def test_rays_that_do_not_meet_and_unknown_pixels_give_nan():
    view = rectification(verged_rig())
    parallel = view.matrix_left[0, 2] - view.matrix_right[0, 2]
    behind = parallel - np.sign(view.baseline_mm)
    xy = np.zeros((3, 2))
    assert np.isnan(triangulate_disparity(xy, [parallel, behind, np.nan], view)).all()


def test_cameras_without_a_common_plane_are_refused():
    rig = verged_rig()
    apart = rig._replace(rotation=rotation_matrix([0.0, np.radians(170.0), 0.0]))
    with pytest.raises(ValueError, match="75° from the optical axis"):
        rectification(apart)
