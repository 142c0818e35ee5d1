import numpy as np
import pytest
from boards import SIZE, SQUARE_MM, board_corners, verged_rig

from dicflow.core.calibration.bundle import Bundle, LensModel, adjust, covariance
from dicflow.core.calibration.calibrate import MAX_NOISE_DISAGREEMENT, calibrate_camera, calibrate_rig
from dicflow.core.calibration.leave_out import leave_out, reconstructed_scale
from dicflow.core.calibration.robust import Loss
from dicflow.core.calibration.targets import board_points, checkerboard_target
from dicflow.core.cameras.rig_parameters import key_figure_sigmas

pytestmark = pytest.mark.slow

RIG = verged_rig()
BOARD = board_points(SIZE, SQUARE_MM)
MODEL = LensModel(radial=2, tangential=True)


def solved(left, right):
    views = calibrate_camera(BOARD, left, (640, 480), MODEL)
    return adjust(Bundle(RIG, views.rotations, views.translations), BOARD, left, right, MODEL)


def test_exact_corners_give_the_same_rig_from_all_pairs():
    left, right = board_corners(RIG)
    found = leave_out(solved(left, right), BOARD, left, right, MODEL, Loss())
    assert found.spread.max() < 1e-4
    np.testing.assert_allclose(found.scale, 1.0, atol=1e-6)


def test_spread_of_independent_noise_is_the_predicted_sigma():
    """Twenty-four pairs in ten folds: the jackknife's σ is known to 1/√18 of it for each figure."""
    left, right = board_corners(RIG, 24)
    generator = np.random.default_rng(6)
    left, right = (side + generator.normal(0.0, 0.05, side.shape) for side in (left, right))
    bundle = solved(left, right)
    spread = leave_out(bundle, BOARD, left, right, MODEL, Loss()).spread
    sigma = key_figure_sigmas(bundle.rig, covariance(bundle, BOARD, left, right, MODEL))
    assert np.sqrt(np.mean((spread / sigma) ** 2)) == pytest.approx(1.0, abs=0.5)


def test_bent_boards_show_in_the_disagreement_of_the_pairs():
    """A board that is bent another way in each photograph, by 0.3 mm; the spread shows it, the residuals hardly."""
    generator = np.random.default_rng(8)
    left, right = board_corners(RIG, 14, bend_mm=generator.normal(0.0, 0.3, 14))
    left, right = (side + generator.normal(0.0, 0.02, side.shape) for side in (left, right))
    found = calibrate_rig(left, right, checkerboard_target(SIZE, SQUARE_MM), ((640, 480),) * 2, MODEL)
    assert found.disagreement > MAX_NOISE_DISAGREEMENT
    np.testing.assert_allclose(found.widened_covariance, found.disagreement**2 * found.covariance)
    error = np.abs(np.linalg.norm(found.rig.translation) - np.linalg.norm(RIG.translation))
    assert error < 3.0 * key_figure_sigmas(found.rig, found.widened_covariance)[4]


def test_few_pairs_are_left_out_one_by_one():
    left, right = (side[:4] for side in board_corners(RIG))
    found = leave_out(solved(left, right), BOARD, left, right, MODEL, Loss())
    assert found.scale.shape == (4,)
    assert np.isfinite(found.spread).all()


def test_the_scale_is_that_of_the_reconstructed_target():
    left, right = board_corners(RIG, 5)
    np.testing.assert_allclose(reconstructed_scale(RIG, BOARD / 1.01, left, right), 1.01, rtol=1e-9)


def test_the_scale_of_a_part_of_the_target():
    left, right = board_corners(RIG, 3)
    left[0, 10:], left[1, :20], left[2, 2:] = np.nan, np.nan, np.nan
    scale = reconstructed_scale(RIG, BOARD, left, right)
    np.testing.assert_allclose(scale[:2], 1.0, rtol=1e-9)
    assert np.isnan(scale[2])


def test_noise_does_not_lengthen_the_target():
    """Noise of 0.1 px is 0.7 % of a square's side in depth; the mean scale of 200 boards stays within 3 σ / √200."""
    left, right = board_corners(RIG, 200)
    generator = np.random.default_rng(9)
    noisy = (side + generator.normal(0.0, 0.1, side.shape) for side in (left, right))
    scale = reconstructed_scale(RIG, BOARD, *noisy)
    assert scale.mean() == pytest.approx(1.0, abs=3.0 * scale.std() / np.sqrt(200))
    assert scale.std() < 1e-3
