import numpy as np
import pytest
from boards import board_corners, verged_rig

from dicflow.core.camera import project, to_right
from dicflow.core.rig_parameters import PARAMETERS, rig_moved
from dicflow.core.rig_uncertainty import calibration_share, point_sensitivity, sensitivity_at
from dicflow.core.triangulate import triangulate

RIG = verged_rig()
POINTS = np.array([[-20.0, 12.0, 390.0], [15.0, -8.0, 420.0], [0.0, 0.0, 405.0]])
STEPS = np.array([*[1e-2] * 4, *[1e-5] * 5] * 2 + [1e-6] * 3 + [1e-3] * 3)


def seen(points):
    return project(RIG.left, points), project(RIG.right, to_right(RIG, points))


def test_sensitivity_is_the_difference_quotient():
    sides = [side[:2, ::9] for side in board_corners(RIG)]
    sensitivity = point_sensitivity(RIG, *sides)
    assert sensitivity.shape == (2, 6, 3, len(PARAMETERS))
    for k, step in enumerate(np.diag(STEPS)):
        ahead, back = (triangulate(rig_moved(RIG, sign * step), *sides).xyz for sign in (1.0, -1.0))
        scale = np.abs(sensitivity[..., k]).max()
        np.testing.assert_allclose(sensitivity[..., k], (ahead - back) / (2.0 * STEPS[k]), atol=1e-5 * scale)


def test_sensitivity_of_triangulated_points_is_that_of_their_pixels():
    np.testing.assert_allclose(sensitivity_at(RIG, POINTS), point_sensitivity(RIG, *seen(POINTS)), rtol=1e-6, atol=1e-6)


def test_a_longer_baseline_scales_all_points():
    """∂X/∂T · T = X: the unit of length is the baseline's."""
    along = point_sensitivity(RIG, *seen(POINTS))[..., -3:] @ RIG.translation
    np.testing.assert_allclose(along, POINTS, atol=1e-9)


def test_pixels_that_are_missing_give_no_value():
    left, right = seen(POINTS)
    left[1] = np.nan
    assert np.isnan(point_sensitivity(RIG, left, right)).any(axis=(-2, -1)).tolist() == [False, True, False]


def test_a_point_that_stays_has_no_share_in_its_displacement():
    sensitivity = point_sensitivity(RIG, *seen(POINTS))
    covariance = np.diag(STEPS**2)
    assert not calibration_share(sensitivity, sensitivity, covariance).any()
    own = calibration_share(sensitivity, np.zeros_like(sensitivity), covariance)
    assert own.shape == (3, 6)
    full = sensitivity[0] @ covariance @ sensitivity[0].T
    assert own[0] == pytest.approx(full[np.triu_indices(3)])


def test_an_error_of_the_baseline_alone_is_a_share_in_proportion_to_the_displacement():
    """σ of the baseline's length 0.1 %: σ of each displacement 0.1 % of it."""
    relative = 1e-3
    covariance = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    covariance[-3:, -3:] = relative**2 * np.outer(RIG.translation, RIG.translation)
    displacement = np.array([6.0, -3.0, 2.0])
    states = [point_sensitivity(RIG, *seen(points)) for points in (POINTS, POINTS + displacement)]
    share = calibration_share(states[1], states[0], covariance)
    expected = relative**2 * np.outer(displacement, displacement)[np.triu_indices(3)]
    np.testing.assert_allclose(share, np.broadcast_to(expected, share.shape), rtol=1e-6)
