"""Calibration: two cameras and their relative pose from photographs of a checkerboard.

Each camera alone (Zhang 2000), then both together with all board poses (:mod:`dicflow.core.bundle`).
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dicflow.core.bundle import Bundle, Model, adjust, residuals
from dicflow.core.camera import Camera, Rig
from dicflow.core.epipolar import epipolar_distance
from dicflow.core.targets import board_orders, board_points

__all__ = ["Calibration", "Views", "board_tilt_deg", "calibrate_camera", "calibrate_rig", "reconcile_orders"]

Array = NDArray[np.float64]
Size = tuple[int, int]

_SAME_ANGLE_RAD = np.radians(5.0)
_SAME_PLACE = 0.15
_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-9)


class Views(NamedTuple):
    """What one camera tells alone.

    camera : the calibrated camera
    rotations : (n, 3, 3), translations : (n, 3) [mm] — board frame to camera frame, per photograph
    """

    camera: Camera
    rotations: Array
    translations: Array


class Calibration(NamedTuple):
    """A rig and how well it explains the corners.

    rig : the two cameras
    used : (n,) bool — pairs that the rig rests on
    turned : (n,) bool — pairs whose right corners came in another order than the left ones
    error_px : (n, 2) — mean distance of reprojected and observed corners, left and right; of a pair
        that was dropped the one at which it was dropped
    rms_px : (3,) — root mean square distance over the pairs used: left, right, both
    epipolar_px : (n,) — mean epipolar distance of the corners
    tilt_deg : (n,) — angle of the board to the left image plane; NaN for pairs not used
    """

    rig: Rig
    used: NDArray[np.bool_]
    turned: NDArray[np.bool_]
    error_px: Array
    rms_px: Array
    epipolar_px: Array
    tilt_deg: Array


def calibrate_rig(
    left: Array,
    right: Array,
    board: tuple[Size, float],
    image_size: Size,
    model: Model,
    max_error_px: float = 0.5,
    min_pairs: int = 8,
) -> Calibration:
    """Calibrate both cameras; drop the worst pair and solve again while one is above the limit.

    left, right : (n, m, 2) — corners per pair [px]; the right ones may be in another order (:func:`reconcile_orders`)
    board : size (columns, rows) of inner corners and side of a square [mm]
    image_size : (width, height) of all photographs [px]
    max_error_px : limit of a pair's mean reprojection error
    min_pairs : pairs are dropped only while more than this many remain
    """
    points = board_points(*board)
    views_left = calibrate_camera(points, left, image_size, model)
    views_right = calibrate_camera(points, right, image_size, model)
    order, rotation, translation = reconcile_orders(views_left, views_right, board)
    right = np.take_along_axis(right, board_orders(board[0])[order][..., None], axis=1)
    rig = Rig(views_left.camera, views_right.camera, rotation, translation)
    start = Bundle(rig, views_left.rotations, views_left.translations)
    bundle, used, error = _adjust_and_drop(start, (points, left, right), model, max_error_px, min_pairs)
    tilt = np.full(len(left), np.nan)
    tilt[used] = board_tilt_deg(bundle.rotations)
    return Calibration(
        rig=bundle.rig,
        used=used,
        turned=order != 0,
        error_px=error,
        rms_px=_rms(residuals(bundle, points, left[used], right[used])),
        epipolar_px=epipolar_distance(bundle.rig, left, right).mean(axis=1),
        tilt_deg=tilt,
    )


def calibrate_camera(points: Array, corners: Array, image_size: Size, model: Model) -> Views:
    """One camera from photographs of a plane (Zhang 2000).

    points : (m, 3) — board's corners [mm]
    corners : (n, m, 2) — observed corners [px], each photograph in any order that a turn of the board explains
    """
    flags = 0 if model.tangential else cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K3 if model.radial == 2 else 0
    _, matrix, distortion, turns, places = cv2.calibrateCamera(
        [points.astype(np.float32)] * len(corners),
        list(corners.astype(np.float32)),
        image_size,
        None,
        None,
        flags=flags,
        criteria=_CRITERIA,
    )
    rotations = np.stack([cv2.Rodrigues(turn)[0] for turn in turns])
    camera = Camera(matrix, distortion.reshape(-1)[:5], image_size)
    return Views(camera, rotations, np.stack(places).reshape(-1, 3))


def reconcile_orders(left: Views, right: Views, board: tuple[Size, float]) -> tuple[NDArray[np.intp], Array, Array]:
    """Choose for each pair the order of the right corners that agrees with the left ones, by consensus.

    A board that looks the same turned by 180° gives each pair two hypotheses of the pose from the left to the right
    camera, and only the true ones agree with each other over differently placed boards. The pose that the most pairs
    can agree with is taken; of equals the one with the smaller rotation.

    board : size (columns, rows) and side of a square [mm]
    Returns the index (n,) into :func:`~dicflow.core.targets.board_orders`, rotation (3, 3) and translation (3,) [mm].
    """
    rotations, translations = _relative_poses(left, right, board)
    pairs, orders = rotations.shape[:2]
    distance = np.mean(np.linalg.norm(left.translations, axis=1))
    flat_rotations, flat_translations = rotations.reshape(-1, 3, 3), translations.reshape(-1, 3)
    chord = np.linalg.norm(flat_rotations[:, None] - flat_rotations[None], axis=(-2, -1))
    angle = 2.0 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0)) / _SAME_ANGLE_RAD
    shift = np.linalg.norm(flat_translations[:, None] - flat_translations[None], axis=-1) / (_SAME_PLACE * distance)
    unlike = np.maximum(angle, shift).reshape(-1, pairs, orders)
    nearest = np.minimum(unlike.min(axis=-1), 1.0)
    agreeing = np.sum(nearest < 1.0, axis=1)
    turn = np.linalg.norm(flat_rotations - np.eye(3), axis=(-2, -1))
    best = _first_of_largest_set(agreeing, turn, nearest.sum(axis=1))
    return unlike[best].argmin(axis=-1), flat_rotations[best], flat_translations[best]


def board_tilt_deg(rotations: Array) -> Array:
    """Angle between boards and the image plane.

    rotations : (n, 3, 3) — board frame to camera frame
    Returns (n,) [deg], 0 for a board that faces the camera.
    """
    return np.asarray(np.degrees(np.arccos(np.clip(np.abs(rotations[:, 2, 2]), 0.0, 1.0))))


def _relative_poses(left: Views, right: Views, board: tuple[Size, float]) -> tuple[Array, Array]:
    """Pose from the left to the right camera, per pair and order of the right corners: (n, o, 3, 3) and (n, o, 3)."""
    points, orders = board_points(*board), board_orders(board[0])
    columns = board[0][0]
    origins = points[orders[:, 0]]
    along, down = points[orders[:, 1]] - origins, points[orders[:, columns]] - origins
    frames = np.stack([along, down, np.cross(along, down) / board[1]], axis=-1) / board[1]
    turned = right.rotations[:, None] @ frames
    rotations = turned @ left.rotations.transpose(0, 2, 1)[:, None]
    places = origins @ right.rotations.transpose(0, 2, 1) + right.translations[:, None]
    return rotations, places - np.einsum("noij,nj->noi", rotations, left.translations)


def _first_of_largest_set(agreeing: NDArray[np.intp], turn: Array, spread: Array) -> int:
    """The hypothesis in the middle of the largest agreeing set; of sets of one size, that of the smaller rotation."""
    largest = np.flatnonzero(agreeing == agreeing.max())
    least_turn = largest[np.argmin(turn[largest])]
    same = largest[np.abs(turn[largest] - turn[least_turn]) < _SAME_ANGLE_RAD]
    return int(same[np.argmin(spread[same])])


def _adjust_and_drop(
    bundle: Bundle, seen: tuple[Array, Array, Array], model: Model, max_error_px: float, min_pairs: int
) -> tuple[Bundle, NDArray[np.bool_], Array]:
    """Adjust; drop the worst pair above the limit; repeat. Returns the bundle, used (n,), error (n, 2) [px]."""
    points, left, right = seen
    used = np.ones(len(left), dtype=bool)
    error = np.empty((len(left), 2))
    while True:
        bundle = adjust(bundle, points, left[used], right[used], model)
        error[used] = np.linalg.norm(residuals(bundle, points, left[used], right[used]), axis=-1).mean(axis=-1)
        mean = error[used].mean(axis=1)
        worst = int(mean.argmax())
        if mean[worst] <= max_error_px or np.count_nonzero(used) <= min_pairs:
            return bundle, used, error
        used[np.flatnonzero(used)[worst]] = False
        bundle = Bundle(bundle.rig, np.delete(bundle.rotations, worst, 0), np.delete(bundle.translations, worst, 0))


def _rms(error: Array) -> Array:
    """Root mean square length of residuals (n, 2, m, 2): left, right, both."""
    squared = np.sum(error**2, axis=-1).mean(axis=(0, 2))
    return np.asarray(np.sqrt(np.append(squared, squared.mean())))
