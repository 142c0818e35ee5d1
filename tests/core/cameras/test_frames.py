import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.cameras.frames import LEFT_CAMERA, axes_frame, into_frame, plane_frame, three_point_frame

Y, X = np.mgrid[-20.0:21.0:5.0, -10.0:11.0:5.0]


@given(slope_x=st.floats(-1.0, 1.0), slope_y=st.floats(-1.0, 1.0))
@settings(max_examples=40)
def test_best_plane(slope_x, slope_y):
    points = np.stack([X, Y, 600 + slope_x * X + slope_y * Y], axis=-1)
    points[0, 0] = np.nan
    frame = plane_frame(points)
    placed = into_frame(points, frame)
    assert np.nanmax(np.abs(placed[..., 2])) < 1e-9
    assert np.allclose(frame.rotation @ frame.rotation.T, np.eye(3))
    assert np.linalg.det(frame.rotation) == pytest.approx(1.0)
    assert frame.rotation[0, 0] > 0.0
    assert frame.rotation[0] @ np.cross(frame.rotation[2], [1.0, 0.0, 0.0]) == pytest.approx(0.0, abs=1e-12)
    assert frame.rotation[1, 1] > 0.0
    assert frame.rotation[2, 2] > 0.0
    assert np.allclose(np.nanmean(placed, axis=(0, 1)), 0.0, atol=1e-9)


def test_three_points():
    frame = three_point_frame([1, 2, 500], [1, 12, 500], [-4, 7, 500])
    assert np.allclose(into_frame([[1, 2, 500], [1, 5, 500], [-4, 2, 500]], frame), [[0, 0, 0], [3, 0, 0], [0, 5, 0]])
    with pytest.raises(ValueError, match="must not be parallel"):
        three_point_frame([0, 0, 0], [1, 1, 1], [3, 3, 3])


def test_given_axes():
    frame = axes_frame([2, 0, 0], [5, -1, 0], [0, 0, 500])
    assert np.allclose(frame.rotation, [[1, 0, 0], [0, -1, 0], [0, 0, -1]])
    assert np.allclose(into_frame([3, 4, 510], frame), [3, -4, -10])
    assert np.array_equal(into_frame([3.0, 4.0, 5.0], LEFT_CAMERA), [3.0, 4.0, 5.0])


def test_points_that_do_not_determine_a_plane_are_refused():
    with pytest.raises(ValueError, match="three points, found 1"):
        plane_frame([[0.0, 0.0, 1.0]])
    with pytest.raises(ValueError, match="one line"):
        plane_frame(np.arange(5.0)[:, None] * [1.0, 1.0, 1.0])
    with pytest.raises(ValueError, match="must not be parallel"):
        plane_frame(np.stack([0 * X, Y, 600 + X], axis=-1))
