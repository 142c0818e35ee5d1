"""Boards stand where their marks fit a known rig best."""

from __future__ import annotations

import numpy as np
from boards import SIZE, SQUARE_MM, board_corners, verged_rig

from dicflow.core.calibration.bundle import residuals
from dicflow.core.calibration.poses import fitted_boards
from dicflow.core.calibration.targets import board_points

RIG = verged_rig()
BOARD = board_points(SIZE, SQUARE_MM)


def test_exact_marks_leave_no_residuals():
    left, right = board_corners(RIG, 5)
    right[2, 7] = np.nan
    error = residuals(fitted_boards(RIG, BOARD, left, right), BOARD, left, right)
    assert np.nanmax(np.abs(error)) < 1e-6
    assert np.isnan(error).sum() == 2


def test_a_wrong_mark_keeps_nearly_all_of_its_error():
    left, right = board_corners(RIG, 3)
    left[1, 20] += (2.0, -1.0)
    error = residuals(fitted_boards(RIG, BOARD, left, right), BOARD, left, right)
    assert np.abs(error[1, 0, 20] - (-2.0, 1.0)).max() < 0.15
    assert np.abs(np.delete(error[1, 0], 20, axis=0)).max() < 0.3
    assert np.abs(error[[0, 2]]).max() < 1e-6


def test_noise_leaves_residuals_of_its_size():
    generator = np.random.default_rng(5)
    left, right = (side + generator.normal(0.0, 0.1, side.shape) for side in board_corners(RIG, 8))
    error = residuals(fitted_boards(RIG, BOARD, left, right), BOARD, left, right)
    freedom = 1.0 - 6.0 / (4 * len(BOARD))
    assert abs(error.std() / (0.1 * np.sqrt(freedom)) - 1.0) < 0.05


def test_a_board_of_which_too_little_is_seen_has_no_pose():
    left, right = board_corners(RIG, 1)
    left[0, 5:] = np.nan
    bundle = fitted_boards(RIG, BOARD, left, right)
    assert np.isnan(bundle.rotations).all()
    assert np.isnan(bundle.translations).all()
