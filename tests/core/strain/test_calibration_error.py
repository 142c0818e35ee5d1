import numpy as np
import pytest
from boards import board_corners, verged_rig

from dicflow.core.cameras.camera import project, rotation_matrix, to_right
from dicflow.core.cameras.frames import LEFT_CAMERA, axes_frame, into_frame
from dicflow.core.cameras.rig_parameters import PARAMETERS, error_modes, rig_after_step
from dicflow.core.cameras.rigid import co_moving_frame, rigid_motion
from dicflow.core.cameras.triangulate import triangulate
from dicflow.core.strain.calibration_error import (
    field_changes,
    nearest_on_grid,
    place_changes,
    point_sensitivity,
    rig_error,
    slope_changes,
    thinned_grid,
)
from dicflow.core.strain.gradient_response import gradient_and_response
from dicflow.core.strain.measures import GradientMeasures

SHAPE = (30, 20)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]] * 0.4
FLAT = np.stack([X, Y, np.zeros(SHAPE)], axis=-1)
RIG = verged_rig()
POINTS = np.array([[-20.0, 12.0, 390.0], [15.0, -8.0, 420.0], [0.0, 0.0, 405.0], [9.0, 17.0, 400.0]])
STEPS = np.array([*[1e-2] * 4, *[1e-5] * 5] * 2 + [1e-6] * 3 + [1e-3] * 3)


def seen(points):
    return project(RIG.left, points), project(RIG.right, to_right(RIG, points))


def test_sensitivity_is_the_difference_quotient():
    sides = [side[:2, ::9] for side in board_corners(RIG)]
    sensitivity = point_sensitivity(RIG, triangulate(RIG, *sides).xyz)
    assert sensitivity.shape == (2, 6, 3, len(PARAMETERS))
    for k, step in enumerate(np.diag(STEPS)):
        ahead, back = (triangulate(rig_after_step(RIG, sign * step), *sides).xyz for sign in (1.0, -1.0))
        scale = np.abs(sensitivity[..., k]).max()
        np.testing.assert_allclose(sensitivity[..., k], (ahead - back) / (2.0 * STEPS[k]), atol=1e-5 * scale)


def test_a_longer_baseline_scales_all_points():
    """∂X/∂T · T = X: the unit of length is the baseline's."""
    np.testing.assert_allclose(point_sensitivity(RIG, POINTS)[..., -3:] @ RIG.translation, POINTS, atol=1e-9)


def test_missing_points_have_no_sensitivity():
    missing = np.where([[False], [True], [False], [False]], np.nan, POINTS)
    assert np.isnan(point_sensitivity(RIG, missing)).any(axis=(-2, -1)).tolist() == [False, True, False, False]


def test_an_error_of_the_baseline_alone_is_a_share_in_proportion_to_place_and_displacement():
    """The baseline 0.1 % too long: every place and displacement is 0.1 % too long, in any frame with origin 0."""
    covariance = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    covariance[-3:, -3:] = 1e-6 * np.outer(RIG.translation, RIG.translation)
    frame = axes_frame([1.0, 2.0, 0.5], [0.0, 1.0, -3.0])
    before, after = (into_frame(points, frame) for points in (POINTS, POINTS + np.array([6.0, -3.0, 2.0])))
    both = rig_error(RIG, covariance, (frame, frame)).changes_at(after, before)
    assert both.shape == (4, 6, 1)
    np.testing.assert_allclose(np.abs(both[..., 0]), 1e-3 * np.abs(np.concatenate([after, before], axis=-1)), rtol=1e-6)
    np.testing.assert_allclose(np.abs(both[:, :3] - both[:, 3:])[..., 0], 1e-3 * np.abs(after - before), rtol=1e-5)


def test_a_subtracted_motion_removes_rigid_errors():
    """Against rigid motions that are fitted anew to the points of rigs a little wrong; the points stretch by 40 %."""
    turned = (POINTS - POINTS[2]) @ (rotation_matrix([0.1, -0.2, 0.3]) @ np.diag([1.4, 0.9, 1.1])).T + POINTS[2] + 5.0
    along = co_moving_frame(rigid_motion(POINTS, turned))
    states = (into_frame(turned, along), POINTS)
    root = STEPS[:, None] * np.random.default_rng(5).normal(size=(len(STEPS), 4))
    covariance = root @ root.T
    plain = rig_error(RIG, covariance, (along, LEFT_CAMERA)).changes_at(*states)
    error = rig_error(RIG, covariance, (along, LEFT_CAMERA), states)
    found = error.changes_at(*states)
    for k, mode in enumerate(error.modes.T):
        before, after = (triangulate(rig_after_step(RIG, mode), *seen(points)).xyz for points in (POINTS, turned))
        expected = into_frame(after, co_moving_frame(rigid_motion(before, after))) - states[0]
        np.testing.assert_allclose(found[:, :3, k], expected, atol=1e-3 * np.abs(plain[:, :3, k]).max())


def test_a_motion_of_no_points_changes_nothing():
    states = (np.nan * POINTS, POINTS)
    both = rig_error(RIG, np.diag(STEPS**2), (LEFT_CAMERA, LEFT_CAMERA), states).changes_at(*states)
    assert np.isnan(both[:, :3]).all()
    assert np.isfinite(both[:, 3:]).all()


def test_modes_make_up_the_covariance():
    root = np.random.default_rng(0).normal(size=(6, 3)) * np.array([1e3, 1, 1e-4, 0, 1, 1e2])[:, None]
    modes = error_modes(root @ root.T)
    assert modes.shape == (6, 3)
    assert np.allclose(modes @ modes.T, root @ root.T, rtol=1e-9, atol=1e-12)
    assert error_modes(np.zeros((4, 4))).shape == (4, 0)


def fields(after, before, slopes, states):
    """What modes that move points of ``states`` and their slopes so do to a surface with such Jacobians."""
    gradient, response = gradient_and_response(*states[::-1])
    both = np.concatenate([after, before], axis=-2)
    return field_changes(both, slopes(both), gradient, response, GradientMeasures())


def jacobians(*states):
    return [np.stack([np.gradient(state, axis=axis) for axis in (1, 0)], axis=-1) for state in states]


def test_modes_of_scale_and_shift():
    """A mode that magnifies by 0.1 % at both states gives the displacement 0.1 % and no strain, a shift nothing."""
    stretched = FLAT * [1.0, 1.5, 1.0] + [3.0, 0.0, 0.0]
    shift = np.broadcast_to([0.2, 0.3, 0.4], FLAT.shape)
    after, before = (np.stack([1e-3 * state, shift], axis=-1) for state in (stretched, FLAT))
    found = fields(after, before, slope_changes, jacobians(stretched, FLAT))
    for axis, name in enumerate("UVW"):
        assert np.allclose(found[name][..., 0], 1e-3 * (stretched - FLAT)[..., axis])
        assert not found[name][..., 1].any()
    for axis, name in enumerate("XYZ"):
        assert np.allclose(found[name][..., 0], 1e-3 * stretched[..., axis])
        assert np.allclose(found[name][..., 1], shift[..., axis])
    assert max(np.abs(found[name]).max() for name in ("exx", "eyy", "gxy", "e1", "e2", "von_mises")) < 1e-9
    only = fields(after, 0 * before, slope_changes, jacobians(stretched, FLAT))
    expected = {"exx": 1e-3, "eyy": 1.5e-3, "e1": 1.5e-3, "e2": 1e-3, "area_change": 3e-3}
    for name, value in expected.items():
        assert np.allclose(only[name][5, 5], [value, 0.0])


def test_a_thinned_grid_gives_the_same_strain():
    """A mode that stretches by 1e-4 along Y, on all points and on every third."""
    after, before = 1e-4 * (FLAT * [0.0, 1.0, 0.0])[..., None], np.zeros((*SHAPE, 3, 1))
    states = jacobians(FLAT, FLAT)
    part = (slice(1, None, 3), slice(1, None, 3))
    whole = fields(after, before, slope_changes, states)
    few = fields(after[part], before[part], lambda both: slope_changes(both, 3), [state[part] for state in states])
    assert np.allclose(whole["eyy"], 1e-4)
    for name, change in few.items():
        assert np.allclose(change, whole[name][part], atol=1e-12)


def test_single_places_agree_with_the_grid():
    before = FLAT + np.array([-4.0, -6.0, 400.0])
    after = before @ (rotation_matrix([0.1, 0.2, 0.0]) @ np.diag([1.2, 0.9, 1.0])).T + [1.0, 2.0, 60.0]
    error = rig_error(RIG, np.diag(STEPS**2), (LEFT_CAMERA, LEFT_CAMERA))
    states, inner = jacobians(after, before), (slice(1, -1), slice(1, -1))
    both = error.changes_at(after, before)
    whole = fields(both[..., :3, :], both[..., 3:, :], slope_changes, states)
    places = [state[inner].reshape(-1, 3) for state in (after, before)]
    few = place_changes(error, places, [state[inner].reshape(-1, 3, 2) for state in states], GradientMeasures())
    for name, changes in few.items():
        expected = whole[name][inner].reshape(changes.shape)
        assert np.abs(changes - expected).max() < 1e-3 * np.abs(expected).max()


@pytest.mark.parametrize("shape", [(30, 20), (150, 80), (401, 395), (40, 300), (5, 900)])
def test_a_thinned_field_comes_back(shape):
    field = np.add.outer(np.arange(shape[0]), 0.3 * np.arange(shape[1])).astype(float)
    part = thinned_grid(np.ones(shape, dtype=bool))
    assert field[part].size <= max(4 * 2000, field.size / 4)
    coarse = field[part].copy()
    whole = nearest_on_grid(coarse, shape, part[0].step)
    assert whole.shape == shape
    assert np.abs(whole - field).max() <= 1.3 * part[0].step
    assert np.array_equal(whole[part], coarse)


def test_a_narrow_specimen_across_a_large_grid_keeps_its_neighbours():
    """A strip of 8 points' width along the diagonal: every 10th row and column of it would have no neighbours."""
    row, col = np.indices((450, 450))
    strip = abs(row - col) < 6
    assert thinned_grid(np.ones(strip.shape, dtype=bool))[0].step == 10
    part = thinned_grid(strip)
    both = np.where(strip[..., None, None], col[..., None, None], np.nan)[part]
    slopes = slope_changes(both, part[0].step)[strip[part]]
    assert np.isfinite(slopes).all()
    assert np.allclose(slopes[:, 0], 1.0)


def test_holes_of_a_thinned_field_take_the_nearest():
    field = np.ones(SHAPE)
    field[:, 10:] = 2.0
    field[3:6, 2:4] = np.nan
    assert np.array_equal(nearest_on_grid(field, SHAPE, 1), np.where(np.arange(20) >= 10, 2.0, np.ones(SHAPE)))
    assert np.isnan(nearest_on_grid(np.nan * field, SHAPE, 1)).all()
