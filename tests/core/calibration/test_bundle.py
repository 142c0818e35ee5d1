import numpy as np
import pytest
from boards import SIZE, SQUARE_MM, board_corners, verged_rig

from dicflow.core.calibration.bundle import (
    Bundle,
    LensModel,
    adjust,
    adjust_with_scaled_loss,
    covariance,
    residual_lengths,
    residuals,
)
from dicflow.core.calibration.calibrate import calibrate_camera
from dicflow.core.calibration.targets import board_points
from dicflow.core.cameras.camera import project, rotation_vector, to_right
from dicflow.core.cameras.frames import LEFT_CAMERA
from dicflow.core.cameras.rig_parameters import (
    PARAMETERS,
    PARAMETERS_PER_CAMERA,
    key_figure_sigmas,
    key_figures,
    reprojection_slopes,
    rig_after_step,
)
from dicflow.core.cameras.triangulate import triangulate
from dicflow.core.strain.calibration_error import rig_error

pytestmark = pytest.mark.slow

RIG = verged_rig()
BOARD = board_points(SIZE, SQUARE_MM)
MODEL = LensModel(radial=2, tangential=True)
NOISE_PX = 0.05
TRIALS = 80


def difference(rig, other):
    """The 24 numbers of a rig less those of another."""
    turn = rotation_vector(rig.rotation @ other.rotation.T)
    lenses = [lens(getattr(rig, side)) - lens(getattr(other, side)) for side in ("left", "right")]
    return np.concatenate([*lenses, turn, rig.translation - other.translation])


def lens(camera):
    return np.append(camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], camera.distortion)


def noisy(sides, seed):
    generator = np.random.default_rng(seed)
    return [side + generator.normal(0.0, NOISE_PX, side.shape) for side in sides]


@pytest.fixture(scope="module")
def exact():
    """The true bundle of twelve boards, and where the cameras see their corners."""
    left, right = board_corners(RIG)
    views = calibrate_camera(BOARD, left, (640, 480), MODEL)
    bundle = adjust(Bundle(RIG, views.rotations, views.translations), BOARD, left, right, MODEL)
    assert residual_lengths(residuals(bundle, BOARD, left, right)).max() < 1e-9
    return bundle, left, right


@pytest.fixture(scope="module")
def calibrated(exact):
    """Rigs of many noisy calibrations and their covariances."""
    bundle, left, right = exact
    found = []
    for trial in range(TRIALS):
        sides = noisy((left, right), 100 + trial)
        solved = adjust(bundle, BOARD, *sides, MODEL)
        found.append((solved.rig, covariance(solved, BOARD, *sides, MODEL)))
    return found


@pytest.mark.slow
def test_predicted_sigmas_are_the_scatter(calibrated):
    """σ of an RMS over n trials is 1/√(2n) of it; of 22 parameters none may be off by more than 3.5 of that."""
    errors = np.array([difference(rig, RIG) for rig, _ in calibrated])
    predicted = np.sqrt(np.mean([np.diagonal(matrix) for _, matrix in calibrated], axis=0))
    scatter = np.sqrt(np.mean(errors**2, axis=0))
    np.testing.assert_allclose(scatter[MODEL.free] / predicted[MODEL.free], 1.0, atol=3.5 / np.sqrt(2 * TRIALS))
    assert not scatter[[8, PARAMETERS_PER_CAMERA + 8]].any()
    assert not predicted[[8, PARAMETERS_PER_CAMERA + 8]].any()


def test_the_whole_covariance_is_that_of_the_scatter(calibrated):
    """The mean of the normalised squared error is the number of parameters, with its own σ √(2p/n)."""
    free, squared = MODEL.free, []
    for rig, matrix in calibrated:
        error = difference(rig, RIG)[free]
        squared.append(error @ np.linalg.solve(matrix[np.ix_(free, free)], error))
    assert np.mean(squared) == pytest.approx(len(free), abs=3.5 * np.sqrt(2 * len(free) / TRIALS))


def test_sigmas_of_focal_lengths_baseline_and_angle(calibrated):
    errors = np.array([key_figures(rig) - key_figures(RIG) for rig, _ in calibrated])
    predicted = np.array([key_figure_sigmas(rig, matrix) for rig, matrix in calibrated])
    ratio = np.sqrt(np.mean(errors**2, axis=0) / np.mean(predicted**2, axis=0))
    np.testing.assert_allclose(ratio, 1.0, atol=3.5 / np.sqrt(2 * TRIALS))


def test_the_calibrations_share_of_a_displacement_is_its_scatter(calibrated):
    """Points moved by 15 mm, seen without noise, but measured with rigs that are a little wrong."""
    x, y = np.meshgrid([-25.0, 0.0, 25.0], [-18.0, 18.0])
    before = np.stack([x, y, 400.0 + 0.1 * x], axis=-1)
    after = before + np.array([8.0, -4.0, 12.0])
    seen = [(project(RIG.left, points), project(RIG.right, to_right(RIG, points))) for points in (before, after)]
    errors, shares = [], []
    for rig, matrix in calibrated:
        errors.append(triangulate(rig, *seen[1]).xyz - triangulate(rig, *seen[0]).xyz - (after - before))
        both = rig_error(rig, matrix, (LEFT_CAMERA, LEFT_CAMERA)).changes_at(after, before)
        shares.append(np.sum((both[..., :3, :] - both[..., 3:, :]) ** 2, axis=-1))
    predicted = np.sqrt(np.mean(shares, axis=0))
    scatter = np.sqrt(np.mean(np.square(errors), axis=0))
    np.testing.assert_allclose(scatter / predicted, 1.0, atol=3.5 / np.sqrt(2 * TRIALS))
    assert predicted.max() < 0.1


def test_slopes_of_the_pixels_are_their_differences(exact):
    bundle = exact[0]
    points = BOARD[::7] @ bundle.rotations[0].T + bundle.translations[0]
    matrix = RIG.left.matrix.copy()
    matrix[0, 1] = 3.0
    skewed = RIG._replace(left=RIG.left._replace(matrix=matrix))

    def pixels(rig, at):
        return np.concatenate([project(rig.left, at), project(rig.right, to_right(rig, at))], axis=-1)

    by_point, by_rig = reprojection_slopes(skewed, points)
    for axis, step in enumerate(1e-3 * np.eye(3)):
        numeric = (pixels(skewed, points + step) - pixels(skewed, points - step)) / 2e-3
        np.testing.assert_allclose(by_point[..., axis], numeric, atol=1e-6)
    for k, step in enumerate(1e-5 * np.eye(len(PARAMETERS))):
        numeric = (pixels(rig_after_step(skewed, step), points) - pixels(rig_after_step(skewed, -step), points)) / 2e-5
        np.testing.assert_allclose(by_rig[..., k], numeric, rtol=1e-6, atol=1e-4)


def test_marks_that_are_not_seen_do_not_matter(exact):
    """Of each photograph another part is missing; what is seen is exact, so the rig is too."""
    bundle, left, right = exact
    generator = np.random.default_rng(1)
    partial = [np.where(generator.random(side.shape[:2])[..., None] < 0.4, np.nan, side) for side in (left, right)]
    start = bundle._replace(rig=rig_after_step(RIG, np.repeat([2.0, 0.0, 0.01, 1.0], [4, 14, 3, 3])))
    solved = adjust(start, BOARD, *partial, MODEL)
    np.testing.assert_allclose(difference(solved.rig, RIG)[-3:], 0.0, atol=1e-5)
    assert np.isfinite(residual_lengths(residuals(solved, BOARD, *partial))).all()


def test_covariance_of_half_the_marks_is_twice_as_large(exact):
    bundle, left, right = exact
    whole = noisy((left, right), 2)
    half = np.arange(len(BOARD)) % 2 == 0
    partial = [np.where(half[:, None], side, np.nan) for side in whole]
    full, reduced = (
        covariance(adjust(bundle, BOARD, *sides, MODEL), BOARD, *sides, MODEL) for sides in (whole, partial)
    )
    ratio = np.diagonal(reduced)[MODEL.free] / np.diagonal(full)[MODEL.free]
    assert np.median(ratio) == pytest.approx(2.0, rel=0.15)


def test_parameters_without_information_are_very_uncertain(exact):
    """Boards that all face the left camera leave its focal length open."""
    bundle, _, _ = exact
    facing = Bundle(RIG, np.broadcast_to(np.eye(3), (6, 3, 3)), bundle.translations[:6] - BOARD.mean(axis=0))
    points = BOARD + facing.translations[:, None]
    sides = noisy((project(RIG.left, points), project(RIG.right, to_right(RIG, points))), 3)
    tilted = covariance(bundle, BOARD, *noisy(exact[1:], 3), MODEL)
    assert key_figure_sigmas(RIG, covariance(facing, BOARD, *sides, MODEL))[0] > 5.0 * key_figure_sigmas(RIG, tilted)[0]


@pytest.mark.parametrize("kind", ["huber", "cauchy"])
def test_single_bad_corners_have_little_effect_under_a_robust_loss(exact, kind):
    """Three corners in a hundred are off by 1 to 5 px."""
    bundle, left, right = exact
    clean, spoilt = noisy((left, right), 4), noisy((left, right), 4)
    generator = np.random.default_rng(4)
    for side in spoilt:
        bad = generator.random(side.shape[:2]) < 0.03
        side[bad] += generator.uniform(1.0, 5.0, (np.count_nonzero(bad), 2))
    best = adjust(bundle, BOARD, *clean, MODEL)
    squares = adjust(bundle, BOARD, *spoilt, MODEL)
    robust, loss = adjust_with_scaled_loss(bundle, BOARD, *spoilt, MODEL, kind)
    errors = [np.linalg.norm(one.rig.translation - RIG.translation) for one in (best, robust, squares)]
    assert errors[1] < 0.25 * errors[2]
    assert errors[1] < 4.0 * errors[0]
    sigma = key_figure_sigmas(robust.rig, covariance(robust, BOARD, *spoilt, MODEL, loss))
    np.testing.assert_array_less(np.abs(key_figures(robust.rig) - key_figures(RIG)), 3.5 * sigma)
    np.testing.assert_allclose(sigma, key_figure_sigmas(best.rig, covariance(best, BOARD, *clean, MODEL)), rtol=0.25)


@pytest.mark.parametrize("kind", ["huber", "cauchy"])
def test_a_robust_loss_loses_little_where_there_are_no_bad_corners(exact, kind):
    bundle, left, right = exact
    sides = noisy((left, right), 5)
    squares, robust = (adjust_with_scaled_loss(bundle, BOARD, *sides, MODEL, name) for name in ("squares", kind))
    least, bent = (covariance(solved, BOARD, *sides, MODEL, loss) for solved, loss in (squares, robust))
    ratio = np.diagonal(bent)[MODEL.free] / np.diagonal(least)[MODEL.free]
    assert np.median(ratio) == pytest.approx(1.0 / 0.95, abs=0.05)
