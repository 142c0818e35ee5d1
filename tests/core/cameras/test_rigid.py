import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.cameras.frames import into_frame
from dicflow.core.cameras.rigid import co_moving_frame, rigid_motion

POINTS = np.random.default_rng(0).normal(size=(6, 7, 3)) * [20, 30, 2] + [5, -3, 600]
triple = st.tuples(*[st.floats(-1.5, 1.5)] * 3)


@given(turn=triple, shift=triple)
@settings(max_examples=40)
def test_perfect_motion_comes_back(turn, shift):
    rotation, translation = rotation_matrix(turn), 40 * np.array(shift)
    holed = POINTS.copy()
    holed[2, 3, 1] = np.nan
    moved = POINTS @ rotation.T + translation
    motion = rigid_motion(holed, moved)
    assert np.allclose(motion.rotation, rotation, atol=1e-12)
    assert np.allclose(into_frame(moved, co_moving_frame(motion)), POINTS, atol=1e-9)
    assert np.allclose(motion.centre, np.nanmean(holed[np.isfinite(holed).all(-1)], axis=0))
    assert np.allclose(motion.translation, rotation @ motion.centre + translation - motion.centre, atol=1e-9)


def test_a_plane_and_its_six_parameters():
    plane = POINTS * [1, 1, 0]
    motion = rigid_motion(plane, (plane @ rotation_matrix([0, 0, 0.3]).T) + [1.0, 2.0, 0.0])
    assert np.allclose(motion.rotation_deg, [0, 0, np.degrees(0.3)])
    assert np.linalg.det(motion.rotation) == pytest.approx(1.0)


def test_weights_silence_a_wrong_point():
    wrong, weights = POINTS.copy(), np.ones(POINTS.shape[:2])
    wrong[0, 0] += 50.0
    weights[0, 0] = 0.0
    assert np.allclose(rigid_motion(POINTS, wrong, weights).translation, 0.0, atol=1e-12)
    assert not np.allclose(rigid_motion(POINTS, wrong).translation, 0.0, atol=0.1)


def test_points_that_do_not_determine_a_motion_are_refused():
    with pytest.raises(ValueError, match="three points, found 2"):
        rigid_motion(POINTS[0, :2], POINTS[0, :2])
    line = np.linspace(0, 1, 9)[:, None] * [1.0, 2.0, 3.0]
    with pytest.raises(ValueError, match="one line"):
        rigid_motion(line, line)
