"""Single gross corners are found and left out, wherever they are; good ones and bad photographs are not touched."""

import numpy as np
import pytest
from boards import SIZE, SQUARE_MM, board_corners, verged_rig

from dicflow.core.calibration.bundle import LensModel
from dicflow.core.calibration.calibrate import calibrate_rig
from dicflow.core.calibration.gross import Gross, more_gross
from dicflow.core.calibration.targets import checkerboard_target
from dicflow.core.cameras.rig_parameters import key_figure_sigmas, key_figures

pytestmark = pytest.mark.slow

RIG = verged_rig()
BOARD = checkerboard_target(SIZE, SQUARE_MM)
SIZES = ((640, 480), (640, 480))
MODEL = LensModel(radial=2, tangential=True)
SIGMA_PX = 0.03
BLUNDERS = {
    (1, 0, 0): (2.0, -1.5),
    (1, 0, 53): (-4.0, 3.0),
    (4, 0, 20): (0.6, 0.6),
    (4, 1, 20): (60.0, -45.0),
    (9, 1, 17): (0.0, 9.0),
    (9, 1, 18): (9.0, 0.0),
}
"""Pair, camera and corner → shift [px]."""


@pytest.fixture(scope="module")
def noisy():
    """(2, n, m, 2) corners with normal noise."""
    corners = np.stack(board_corners(RIG))
    return corners + np.random.default_rng(7).normal(0.0, SIGMA_PX, corners.shape)


def solved(corners, **options):
    return calibrate_rig(*corners, BOARD, SIZES, MODEL, **options)


def with_blunders(corners, blunders=BLUNDERS):
    shifted = corners.copy()
    for (pair, camera, corner), shift in blunders.items():
        shifted[camera, pair, corner] += shift
    return shifted


def places(gross_px):
    return {tuple(int(k) for k in place) for place in np.argwhere(np.isfinite(gross_px))}


def test_gross_corners_are_found_with_their_distances_and_the_rig_is_that_without_them(noisy):
    found = solved(with_blunders(noisy))
    assert places(found.gross_px) == set(BLUNDERS)
    for place, shift in BLUNDERS.items():
        assert abs(found.gross_px[place] - np.hypot(*shift)) < 6 * SIGMA_PX
    assert found.used.all()
    without = noisy.copy()
    for pair, camera, corner in BLUNDERS:
        without[camera, pair, corner] = np.nan
    expected = solved(without)
    np.testing.assert_allclose(key_figures(found.rig), key_figures(expected.rig), rtol=1e-6)
    np.testing.assert_allclose(found.error_px, expected.error_px, rtol=1e-4)
    off = (key_figures(found.rig) - key_figures(RIG)) / key_figure_sigmas(found.rig, found.covariance)
    assert np.abs(off).max() < 3.5


def test_corners_with_noise_alone_all_stay(noisy):
    found = solved(noisy, max_error_px=0.05)
    assert np.isnan(found.gross_px).all()
    lengths = np.hypot(*np.random.default_rng(3).normal(0.0, 0.1, (2, 400, 2, 54)))
    assert more_gross(Gross.none(400, 54), lengths, 0.01) is None


def test_a_blunder_below_the_limit_is_noise_to_the_user(noisy):
    assert places(solved(with_blunders(noisy), max_error_px=5.0).gross_px) == {(4, 1, 20), (9, 1, 17), (9, 1, 18)}


def test_a_bad_photograph_is_dropped_as_a_whole(noisy):
    bad = with_blunders(noisy)
    bad[1, 6] = bad[1, 7]
    found = solved(bad)
    assert np.flatnonzero(~found.used).tolist() == [6]
    assert places(found.gross_px) == set(BLUNDERS)


def test_where_more_than_a_tenth_does_not_fit_no_corner_is_gross(noisy):
    many = {(2, 0, corner): (12.0, 5.0) for corner in range(0, 54, 6)}
    found = solved(with_blunders(noisy, many))
    assert np.isnan(found.gross_px).all()
    assert np.flatnonzero(~found.used).tolist() == [2]


def test_of_a_board_that_was_detected_turned_the_corner_is_named_as_detected(noisy):
    turned = with_blunders(noisy)
    turned[1, [4, 9]] = turned[1, [4, 9]][:, ::-1]
    expected = {(pair, side, 53 - corner if side and pair in (4, 9) else corner) for pair, side, corner in BLUNDERS}
    assert places(solved(turned).gross_px) == expected
