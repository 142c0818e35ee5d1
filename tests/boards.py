"""Exact photographs of checkerboards and exact corners, for the tests of calibration."""

from __future__ import annotations

import numpy as np

from dicflow.core.calibration.bundle import LensModel, covariance
from dicflow.core.calibration.poses import fitted_boards
from dicflow.core.calibration.targets import board_points
from dicflow.core.cameras.camera import Camera, Rig, project, rotation_matrix, to_right

SIZE = (9, 6)
SQUARE_MM = 10.0


def verged_rig(angle_deg: float = 19.0, distance_mm: float = 400.0) -> Rig:
    """Two cameras of 640 × 480 px with distortion that look at one point, with a little roll and tilt."""
    rotation = rotation_matrix([0.004, np.radians(angle_deg), -0.006])
    target = np.array([0.0, 0.0, distance_mm])
    left = Camera(
        np.array([[1800.0, 0, 318.0], [0, 1795.0, 242.0], [0, 0, 1]]),
        np.array([-0.1, 0.2, 4e-4, -3e-4, 0.0]),
        (640, 480),
    )
    right = Camera(
        np.array([[1780.0, 0, 322.0], [0, 1782.0, 237.0], [0, 0, 1]]),
        np.array([-0.12, 0.1, -2e-4, 5e-4, 0.0]),
        (640, 480),
    )
    return Rig(left, right, rotation, target - rotation @ target + np.array([0.5, -1.0, 2.0]))


def swapped(rig: Rig) -> Rig:
    """The same rig with its cameras' names exchanged."""
    return Rig(rig.right, rig.left, rig.rotation.T, -rig.rotation.T @ rig.translation)


def board_corners(
    rig: Rig,
    count: int = 12,
    seed: int = 3,
    board: np.ndarray | None = None,
    bend_mm: np.ndarray | float = 0.0,
    reach: float = 1.0,
) -> tuple[np.ndarray, np.ndarray]:
    """Corners (count, m, 2) of boards in all places and tilts, as both cameras see them [px].

    board : (m, 3) — the marks of another target [mm]
    bend_mm : sagitta of a cylinder along the rows, of each board or of all
    reach : how far from the middle the boards stand, over 20 mm
    """
    generator = np.random.default_rng(seed)
    board = board_points(SIZE, SQUARE_MM) if board is None else board
    board = board - board.mean(axis=0)
    bow = np.array([0.0, 0.0, 1.0]) * (1.0 - (board[:, :1] / board[:, 0].max()) ** 2)
    left, right = [], []
    for bend in np.broadcast_to(bend_mm, count):
        turn = rotation_matrix(generator.uniform([-0.5, -0.5, -0.3], [0.5, 0.5, 0.3]))
        place = generator.uniform([-20.0 * reach, -15.0 * reach, 380.0], [20.0 * reach, 15.0 * reach, 430.0])
        points = (board + bend * bow) @ turn.T + place
        left.append(project(rig.left, points))
        right.append(project(rig.right, to_right(rig, points)))
    return np.stack(left), np.stack(right)


def calibration_covariance(rig: Rig, scale: float = 1.0, noise_px: float = 0.05, count: int = 20) -> np.ndarray:
    """Covariance (24, 24) of a rig calibrated with boards whose corners have noise. scale : of the boards"""
    board = scale * board_points(SIZE, SQUARE_MM)
    board = board - board.mean(axis=0)
    corners = board_corners(rig, count, board=board, reach=scale)
    bundle = fitted_boards(rig, board, *corners)
    generator = np.random.default_rng(0)
    noisy = [xy + generator.normal(0.0, noise_px, xy.shape) for xy in corners]
    return covariance(bundle, board, *noisy, LensModel(2, tangential=True))


def board_photograph(
    homography: np.ndarray, shape: tuple[int, int], size: tuple[int, int] = SIZE, finer: int = 6
) -> np.ndarray:
    """A board seen through a homography from its squares to pixels; a pixel is the mean of finer × finer points.

    The square's corner (0, 0) is the first inner corner. Returns (rows, cols) uint8.
    """
    backward = np.linalg.inv(homography)
    rows, cols = np.arange(shape[0], dtype=float)[:, None], np.arange(shape[1], dtype=float)[None]
    total = np.zeros(shape)
    for dy, dx in np.ndindex(finer, finer):
        y, x = rows + (dy + 0.5) / finer - 0.5, cols + (dx + 0.5) / finer - 0.5
        u, v, w = (line[0] * x + line[1] * y + line[2] for line in backward)
        u, v = u / w, v / w
        inside = (u > -1) & (u < size[0]) & (v > -1) & (v < size[1])
        total += np.where(inside & ((np.floor(u) + np.floor(v)) % 2 == 0), 30.0, 210.0)
    return np.round(total / finer**2).astype(np.uint8)
