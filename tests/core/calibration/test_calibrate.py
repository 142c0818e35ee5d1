import xml.etree.ElementTree as ET

import cv2
import numpy as np
import pytest
from boards import SIZE, SQUARE_MM, board_corners, verged_rig

from dicflow.core.calibration.bundle import Bundle, LensModel, adjust, residuals
from dicflow.core.calibration.calibrate import MAX_NOISE_DISAGREEMENT, calibrate_camera, calibrate_rig, reconcile_orders
from dicflow.core.calibration.coverage import covered_area, empty_parts, verdict
from dicflow.core.calibration.targets import checkerboard_target, find_board
from dicflow.core.cameras.camera import rotation_angle_deg, rotation_matrix

pytestmark = pytest.mark.slow

RIG = verged_rig()
BOARD = checkerboard_target(SIZE, SQUARE_MM)
IMAGE = (640, 480)
SIZES = (IMAGE, IMAGE)
FULL = LensModel(radial=2, tangential=True)


@pytest.fixture(scope="module")
def corners():
    return board_corners(RIG)


def test_perfect_corners_give_the_rig(corners):
    found = calibrate_rig(*corners, BOARD, SIZES, FULL)
    assert found.rms_px[2] < 1e-6
    np.testing.assert_allclose(found.rig.translation, RIG.translation, atol=1e-5)
    assert rotation_angle_deg(found.rig.rotation, RIG.rotation) < 1e-6
    np.testing.assert_allclose(found.rig.left.matrix, RIG.left.matrix, atol=1e-4)
    np.testing.assert_allclose(found.rig.right.distortion, RIG.right.distortion, atol=1e-6)
    assert found.used.all()
    assert found.epipolar_px.max() < 1e-6


def test_residuals_have_the_noise_that_theory_predicts(corners):
    """RMS distance² = 2 σ² (1 − parameters / observations) for independent normal errors."""
    sigma = 0.05
    generator = np.random.default_rng(5)
    left, right = (side + generator.normal(0, sigma, side.shape) for side in corners)
    found = calibrate_rig(left, right, BOARD, SIZES, FULL)
    parameters, observations = 2 * 8 + 6 + 6 * len(left), 2 * left.size
    expected = sigma * np.sqrt(2 * (1 - parameters / observations))
    assert found.rms_px[2] == pytest.approx(expected, rel=0.06)
    assert np.linalg.norm(found.rig.translation - RIG.translation) < 1.0


def test_units_of_the_board_scale_the_translation_only(corners):
    millimetres = calibrate_rig(*corners, BOARD, SIZES, FULL).rig
    inches = calibrate_rig(*corners, checkerboard_target(SIZE, SQUARE_MM / 25.4), SIZES, FULL).rig
    np.testing.assert_allclose(inches.translation * 25.4, millimetres.translation, atol=1e-4)
    np.testing.assert_allclose(inches.rotation, millimetres.rotation, atol=1e-7)


@pytest.mark.parametrize("turned", [[0, 3, 4, 9], [1, 2, 3, 5, 6, 7, 8, 10, 11]])
def test_turned_boards_are_reconciled(corners, turned):
    """Most pairs may come back turned, and boards may be turned in both photographs."""
    left, right = (side.copy() for side in corners)
    right[turned] = right[turned, ::-1]
    left[2], right[2] = left[2, ::-1].copy(), right[2, ::-1].copy()
    found = calibrate_rig(left, right, BOARD, SIZES, FULL)
    np.testing.assert_array_equal(np.flatnonzero(found.turned), turned)
    assert rotation_angle_deg(found.rig.rotation, RIG.rotation) < 1e-6


def test_of_equal_sets_the_smaller_rotation_is_chosen(corners):
    """A single pair supports both orders equally."""
    points = BOARD.points
    views = [calibrate_camera(points, side, IMAGE, FULL) for side in corners]
    for order in (1, -1):
        one = [view._replace(rotations=view.rotations[:1], translations=view.translations[:1]) for view in views]
        if order < 0:
            turn = np.diag([-1.0, -1.0, 1.0])
            one[1] = one[1]._replace(
                rotations=one[1].rotations @ turn, translations=one[1].translations + one[1].rotations @ points[-1]
            )
        chosen, rotation, translation = reconcile_orders(*one, BOARD)
        assert chosen[0] == (0 if order > 0 else 1)
        assert rotation_angle_deg(rotation, RIG.rotation) < 0.01
        np.testing.assert_allclose(translation, RIG.translation, atol=0.1)


def test_bad_pairs_are_dropped_worst_first(corners):
    left, right = (side.copy() for side in corners)
    left[4] += np.random.default_rng(0).normal(0, 3.0, left[4].shape)
    right[7] += np.random.default_rng(1).normal(0, 1.5, right[7].shape)
    found = calibrate_rig(left, right, BOARD, SIZES, FULL)
    np.testing.assert_array_equal(np.flatnonzero(~found.used), [4, 7])
    np.testing.assert_allclose(found.rig.translation, RIG.translation, atol=1e-4)
    assert found.error_px[4, 0] > 1.0
    assert np.isnan(found.tilt_deg[[4, 7]]).all()


def test_no_more_pairs_are_dropped_than_allowed(corners):
    generator = np.random.default_rng(2)
    left, right = (side + generator.normal(0, 2.0, side.shape) for side in corners)
    found = calibrate_rig(left, right, BOARD, SIZES, LensModel(), max_error_px=0.5, min_pairs=10)
    assert np.count_nonzero(found.used) == 10
    areas = [covered_area(side, IMAGE) for side in (left, right)]
    assert verdict(found, areas, 0.5, 12).startswith("poor")


def test_adjustment_never_raises_the_cost_and_ends_at_the_optimum(corners):
    left, right = (side + np.random.default_rng(8).normal(0, 0.1, side.shape) for side in corners)
    points = BOARD.points
    views = calibrate_camera(points, left, IMAGE, LensModel())
    start = Bundle(RIG._replace(translation=RIG.translation + 5.0), views.rotations, views.translations)
    end = adjust(start, points, left, right, FULL)
    cost = np.sum(residuals(end, points, left, right) ** 2)
    assert cost < np.sum(residuals(start, points, left, right) ** 2)
    for shift in (1e-3, -1e-3):
        moved = end._replace(rig=end.rig._replace(translation=end.rig.translation + np.array([shift, 0, 0])))
        turned = end._replace(rig=end.rig._replace(rotation=rotation_matrix([0, shift, 0]) @ end.rig.rotation))
        for other in (moved, turned):
            assert np.sum(residuals(other, points, left, right) ** 2) > cost


def test_coverage_of_a_rectangle_is_its_share():
    board = np.array([[[0.0, 0.0], [319.0, 0.0], [319.0, 479.0], [0.0, 479.0]]])
    area = covered_area(board, IMAGE)
    assert area.mean() == pytest.approx(0.5, abs=0.01)
    assert empty_parts(area) == ["upper right", "right", "lower right"]


def test_verdict_names_what_to_improve(corners):
    found = calibrate_rig(*corners, BOARD, SIZES, FULL)
    full, half = np.ones((180, 240), bool), np.zeros((180, 240), bool)
    half[:, :100] = True
    assert verdict(found, [full, full], 0.5, 12) == "good: 0.000 px, 12 of 12 pairs, boards cover 100 % of the frame"
    text = verdict(found, [full, half], 0.5, 14)
    assert text.startswith("usable: 0.000 px, 12 of 14 pairs, boards cover 42 % of the frame; ")
    assert "right photographs: upper right, right, lower right" in text
    flat = found._replace(tilt_deg=np.full(12, 3.0))
    text = verdict(flat, [full, full], 0.5, 12)
    assert text.startswith("poor")
    assert "tilt the board" in text


def test_coverage_counts_what_is_seen():
    board = np.array([[[0.0, 0.0], [np.nan, np.nan], [319.0, 0.0], [319.0, 479.0], [0.0, 479.0], [np.nan, np.nan]]])
    assert covered_area(board, IMAGE).mean() == pytest.approx(0.5, abs=0.01)


def test_verdict_reports_disagreement_of_the_pairs():
    """Boards that are bent by 1 mm, in each photograph another way."""
    bend = np.random.default_rng(8).normal(0.0, 1.0, 14)
    found = calibrate_rig(*board_corners(RIG, 14, bend_mm=bend), BOARD, SIZES, FULL, max_error_px=5.0)
    full = np.ones((180, 240), bool)
    text = verdict(found, [full, full], 5.0, 14)
    assert text.startswith("usable")
    assert f"differ {found.disagreement:.0f} times more" in text
    assert "flat, stiff board" in text


def test_verdict_names_the_distortion_that_is_not_estimated(corners):
    """The lenses have tangential distortion (p1, p2) of 4·10⁻⁴ and no third radial coefficient."""
    left, right = (side + np.random.default_rng(3).normal(0.0, 0.01, side.shape) for side in corners)
    plain, full = (calibrate_rig(left, right, BOARD, SIZES, model) for model in (LensModel(), FULL))
    assert plain.unmodelled == ("tangential",)
    assert full.unmodelled == ()
    covered = [np.ones((180, 240), bool)] * 2
    text = verdict(plain, covered, 0.5, 12)
    assert "the lenses show distortion that is not estimated: set tangential: true" in text
    assert verdict(full, covered, 0.5, 12).startswith("good")


def test_verdict_asks_for_a_third_coefficient_of_wide_lenses():
    wide = RIG._replace(
        left=RIG.left._replace(distortion=np.array([-0.3, 0.5, 0.0, 0.0, 60.0])),
        right=RIG.right._replace(distortion=np.array([-0.3, 0.5, 0.0, 0.0, 60.0])),
    )
    left, right = (side + np.random.default_rng(3).normal(0.0, 0.01, side.shape) for side in board_corners(wide))
    found = calibrate_rig(left, right, BOARD, SIZES, LensModel(2, True))
    assert found.unmodelled == ("third radial",)
    assert "set radial: 3" in verdict(found, [np.ones((180, 240), bool)] * 2, 0.5, 12)


def test_a_robust_loss_keeps_pairs_with_single_bad_corners(corners):
    """One corner in each of three pairs is taken for its neighbour, which is closer than the limit of gross ones."""
    left, right = (side + np.random.default_rng(3).normal(0.0, 0.05, side.shape) for side in corners)
    for pair, corner in ((2, 5), (6, 30), (9, 50)):
        left[pair, corner] = left[pair, corner + 1]
    squares, cauchy = (
        calibrate_rig(left, right, BOARD, SIZES, FULL, max_error_px=99.0, loss=loss) for loss in ("squares", "cauchy")
    )
    away = [np.linalg.norm(found.rig.translation - RIG.translation) for found in (cauchy, squares)]
    assert away[0] < 0.2 * away[1]
    assert cauchy.used.all()
    assert cauchy.noise_px == pytest.approx(0.05, rel=0.1)


def found_boards(folder, size):
    return np.stack(
        [find_board(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), size) for path in sorted(folder.iterdir())]
    )


@pytest.fixture(scope="module")
def rendered(shared_data):
    folder = shared_data / "d_specimen" / "boards"
    sides = [found_boards(folder / side, (12, 8)) for side in ("left", "right")]
    return calibrate_rig(*sides, checkerboard_target((12, 8), 5.0), ((1920, 1200),) * 2, LensModel())


def test_rendered_boards_give_the_rig_they_were_rendered_with(rendered, shared_data):
    """21 pairs of a 12 × 8 board, more than half of which come back turned."""
    camera = ET.parse(shared_data / "d_specimen" / "reference" / "boards_truth.xml").getroot()[-1]
    truth = {entry.get("name"): entry.get("value") for entry in camera}
    translation = [float(truth[name]) for name in ("TX", "TY", "TZ")]
    angles = [float(truth[name]) for name in ("ALPHA", "BETA", "GAMMA")]
    assert rendered.used.all()
    assert rendered.turned.any()
    assert rendered.rms_px[2] < 0.003
    np.testing.assert_allclose(rendered.rig.translation, translation, atol=0.003)
    np.testing.assert_allclose(cv2.RQDecomp3x3(rendered.rig.rotation)[0], angles, atol=0.002)


def test_rendered_boards_agree_and_measure_their_squares(rendered, shared_data):
    """The spread with pairs left out is that of noise of 0.002 px; the squares' size is right to 0.0001 %."""
    assert rendered.noise_px < 0.0025
    assert rendered.disagreement < MAX_NOISE_DISAGREEMENT
    assert rendered.leave_out.scale.mean() == pytest.approx(1.0, abs=1e-6)
    assert rendered.leave_out.scale.std() < 1e-6


def test_real_boards(shared_data):
    sides = [found_boards(shared_data / "boards" / side, (11, 7)) for side in ("left", "right")]
    found = calibrate_rig(*sides, checkerboard_target((11, 7), 8.0), ((613, 513),) * 2, LensModel())
    assert np.count_nonzero(found.used) == 20
    assert found.rms_px[2] < 0.11
    assert found.disagreement > MAX_NOISE_DISAGREEMENT
    assert found.leave_out.scale.mean() == pytest.approx(1.0, abs=5e-4)
