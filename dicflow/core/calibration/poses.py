"""Where boards stood, for a rig that is known: what their marks leave as residuals shows which photographs are bad."""

from __future__ import annotations

import cv2
import numpy as np
from scipy.optimize import least_squares

from dicflow.core.arrays import Array
from dicflow.core.calibration.bundle import Bundle, residuals
from dicflow.core.cameras.camera import Rig, rotation_matrix, rotation_vector, undistort

__all__ = ["fitted_boards"]

_MIN_MARKS = 6


def fitted_boards(rig: Rig, board: Array, left: Array, right: Array) -> Bundle:
    """Poses of n boards that fit their marks in both photographs best, for a rig that stays as it is.

    board : (m, 3) — marks in the board's frame [mm]
    left, right : (n, m, 2) — observed marks [px], NaN where not seen
    Poses are NaN where the left photograph shows fewer than six marks.
    """
    poses = [_fitted(rig, board, one, other) for one, other in zip(left, right, strict=True)]
    rotations = np.array([rotation for rotation, _ in poses]).reshape(-1, 3, 3)
    return Bundle(rig, rotations, np.array([translation for _, translation in poses]).reshape(-1, 3))


def _fitted(rig: Rig, board: Array, left: Array, right: Array) -> tuple[Array, Array]:
    """Rotation (3, 3) and translation (3,) [mm] of one board in the left camera's frame."""
    seen = np.isfinite(left[:, 0])
    if seen.sum() < _MIN_MARKS:
        return np.full((3, 3), np.nan), np.full(3, np.nan)
    rays = undistort(rig.left, left[seen])
    _, rotation, translation = cv2.solvePnP(board[seen], np.ascontiguousarray(rays), np.eye(3), None)

    def error(pose: Array) -> Array:
        one = Bundle(rig, rotation_matrix(pose[:3])[None], pose[None, 3:])
        found = residuals(one, board, left[None], right[None])
        return np.asarray(found[np.isfinite(found)])

    start = np.concatenate([rotation_vector(cv2.Rodrigues(rotation)[0]), translation.ravel()])
    pose = least_squares(error, start, x_scale="jac", method="lm").x
    return rotation_matrix(pose[:3]), np.asarray(pose[3:])
