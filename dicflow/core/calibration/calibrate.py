"""Calibration: two cameras and their relative pose from photographs of a flat target.

Each camera alone (Zhang 2000), then both together with all board poses (:mod:`dicflow.core.calibration.bundle`).
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.calibration.bundle import (
    Bundle,
    LensModel,
    adjust_with_scaled_loss,
    covariance,
    parameter_count,
    residual_lengths,
    residuals,
)
from dicflow.core.calibration.gross import Gross, more_gross
from dicflow.core.calibration.leave_out import LeaveOut, leave_out
from dicflow.core.calibration.lens_model import DistortionTerm, unmodelled_distortion
from dicflow.core.calibration.robust import Loss, LossKind, noise_sigma
from dicflow.core.calibration.targets import Target
from dicflow.core.cameras.camera import Camera, Rig, rotation_matrix
from dicflow.core.cameras.epipolar import epipolar_distance
from dicflow.core.cameras.rig_parameters import key_figure_sigmas

__all__ = [
    "MAX_NOISE_DISAGREEMENT",
    "Calibration",
    "CameraCalibration",
    "board_tilt_deg",
    "calibrate_camera",
    "calibrate_rig",
    "reconcile_orders",
]

Size = tuple[int, int]

MAX_NOISE_DISAGREEMENT = 2.0
"""Limit of the disagreement that noise alone can cause; in 30 simulated calibrations of 12 noisy pairs it was < 1.7."""
_SAME_ANGLE_RAD = np.radians(5.0)
_SAME_PLACE_SHARE = 0.15
_CRITERIA = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_COUNT, 100, 1e-9)


class CameraCalibration(NamedTuple):
    """One camera calibrated on its own, and the board poses in its photographs.

    rotations : (n, 3, 3), translations : (n, 3) [mm] — board frame to camera frame, per photograph
    """

    camera: Camera
    rotations: Array
    translations: Array


class Calibration(NamedTuple):
    """A rig and how well it fits the marks.

    rig : the two cameras
    used : (n,) bool — pairs that the rig was estimated from
    turned : (n,) bool — pairs whose right marks were detected in another order than the left ones
    error_px : (n, 2) — mean distance of reprojected and observed marks, left and right; for a dropped pair its value
        when it was dropped
    rms_px : (3,) — root mean square distance over the pairs used: left, right, both
    epipolar_px : (n,) — mean epipolar distance of the marks; NaN where no mark is seen by both cameras
    tilt_deg : (n,) — angle of the board to the left image plane; NaN for pairs not used
    covariance : (24, 24) — of the rig's :data:`~dicflow.core.cameras.rig_parameters.PARAMETERS`, from independent noise
    noise_px : standard deviation of one coordinate of a mark, estimated from the residuals
    leave_out : results of calibrations without some of the pairs used
    unmodelled : distortion that the lenses have and the model leaves out
    gross_px : (n, 2, m) — of single marks that were left out, because they lie far off while the others of their
        photographs fit, the distance of the reprojected mark, left and right, in the order given; NaN for all others
    """

    rig: Rig
    used: Mask
    turned: Mask
    error_px: Array
    rms_px: Array
    epipolar_px: Array
    tilt_deg: Array
    covariance: Array
    noise_px: float
    leave_out: LeaveOut
    unmodelled: tuple[DistortionTerm, ...]
    gross_px: Array

    @property
    def disagreement(self) -> float:
        """Spread of the rigs with pairs left out, over the spread that independent noise of the marks predicts [-].

        About 1 where the marks have independent noise only, as in rendered boards; boards that are not flat can reach
        10.
        """
        ratio = self.leave_out.spread / key_figure_sigmas(self.rig, self.covariance)
        return float(np.sqrt(np.mean(ratio**2)))

    @property
    def widened_covariance(self) -> Array:
        """The covariance (24, 24), multiplied by disagreement² where noise alone cannot explain the disagreement."""
        return self.covariance * (self.disagreement**2 if self.disagreement > MAX_NOISE_DISAGREEMENT else 1.0)


class _Marks(NamedTuple):
    """Marks of the target (m, 3) [mm] and their pixels in both cameras (n, m, 2), all in the same order."""

    points: Array
    left: Array
    right: Array

    def select(self, pairs: Mask) -> _Marks:
        return _Marks(self.points, self.left[pairs], self.right[pairs])

    def without(self, marks: Mask) -> _Marks:
        """Without single marks (n, 2, m)."""
        left, right = (
            np.where(out[..., None], np.nan, xy) for out, xy in zip(marks.swapaxes(0, 1), self[1:], strict=True)
        )
        return _Marks(self.points, left, right)


class _Solution(NamedTuple):
    """An adjusted bundle of the pairs used (n,), its loss, error_px as in Calibration, and gross marks (n, 2, m)."""

    bundle: Bundle
    loss: Loss
    used: Mask
    error_px: Array
    gross: Mask


def calibrate_rig(
    left: Array,
    right: Array,
    target: Target,
    image_sizes: tuple[Size, Size],
    model: LensModel,
    max_error_px: float = 0.5,
    min_pairs: int = 8,
    loss: LossKind = "squares",
) -> Calibration:
    """Calibrate both cameras; leave out single gross marks, and while a pair exceeds the limit drop the worst one.

    left, right : (n, m, 2) — marks per pair [px], NaN where not seen; the right ones may be in another order
        (:func:`reconcile_orders`)
    image_sizes : (width, height) of the left and of the right photographs [px]
    max_error_px : limit of a pair's mean reprojection error; no mark with a smaller one is gross
    min_pairs : pairs are dropped only while more than this many remain
    loss : kind of loss; its scale is estimated from the residuals
    """
    views_left = calibrate_camera(target.points, left, image_sizes[0], model)
    views_right = calibrate_camera(target.points, right, image_sizes[1], model)
    order, rotation, translation = reconcile_orders(views_left, views_right, target)
    marks = _Marks(target.points, left, np.take_along_axis(right, target.orders[order][..., None], axis=1))
    start = Bundle(
        Rig(views_left.camera, views_right.camera, rotation, translation), views_left.rotations, views_left.translations
    )
    solved = _adjust_and_drop(start, marks, model, loss, max_error_px, min_pairs)
    off = np.full((len(left), 2, len(target.points)), np.nan)
    off[solved.used] = np.linalg.norm(residuals(solved.bundle, *marks.select(solved.used)), axis=-1)
    off[~solved.gross] = np.nan
    np.put_along_axis(off[:, 1], target.orders[order], off[:, 1].copy(), axis=1)
    return _calibration(solved, marks.without(solved.gross), model, order != 0, off)


def calibrate_camera(points: Array, marks: Array, image_size: Size, model: LensModel) -> CameraCalibration:
    """One camera from photographs of a plane (Zhang 2000).

    points : (m, 3) — marks of the target [mm]
    marks : (n, m, 2) — observed marks [px], NaN where not seen; each photograph in any of the target's orders
    image_size : (width, height) of the photographs [px]
    """
    flags = 0 if model.tangential else cv2.CALIB_ZERO_TANGENT_DIST
    flags |= cv2.CALIB_FIX_K3 if model.radial == 2 else 0
    seen: Mask = np.isfinite(marks[..., 0])
    _, matrix, distortion, rotation_vectors, translations = cv2.calibrateCamera(
        [points[shown].astype(np.float32) for shown in seen],
        [view[shown].astype(np.float32) for view, shown in zip(marks, seen, strict=True)],
        image_size,
        None,
        None,
        flags=flags,
        criteria=_CRITERIA,
    )
    rotations = np.stack([cv2.Rodrigues(turn)[0] for turn in rotation_vectors])
    camera = Camera(matrix, distortion.reshape(-1)[:5], image_size)
    return CameraCalibration(camera, rotations, np.stack(translations).reshape(-1, 3))


def reconcile_orders(left: CameraCalibration, right: CameraCalibration, target: Target) -> tuple[Index, Array, Array]:
    """Choose for each pair the order of the right marks that matches the left ones, by consensus.

    A target that looks the same after a turn by 180° gives each pair two hypotheses of the pose from the left to the
    right camera. Only the true ones agree over differently placed boards. The pose that agrees with most pairs is
    chosen; among equals, the one with the smaller rotation.

    Returns the index (n,) into the target's orders, rotation (3, 3) and translation (3,) [mm].
    """
    rotations, translations = _relative_poses(left, right, target)
    pairs, orders = rotations.shape[:2]
    distance = np.mean(np.linalg.norm(left.translations, axis=1))
    flat_rotations, flat_translations = rotations.reshape(-1, 3, 3), translations.reshape(-1, 3)
    chord = np.linalg.norm(flat_rotations[:, None] - flat_rotations[None], axis=(-2, -1))
    angle = 2.0 * np.arcsin(np.minimum(chord / np.sqrt(8.0), 1.0)) / _SAME_ANGLE_RAD
    shift = np.linalg.norm(flat_translations[:, None] - flat_translations[None], axis=-1) / (
        _SAME_PLACE_SHARE * distance
    )
    unlike = np.maximum(angle, shift).reshape(-1, pairs, orders)
    nearest = np.minimum(unlike.min(axis=-1), 1.0)
    agreeing = np.sum(nearest < 1.0, axis=1)
    turn = np.linalg.norm(flat_rotations - np.eye(3), axis=(-2, -1))
    best = _best_hypothesis(agreeing, turn, nearest.sum(axis=1))
    return unlike[best].argmin(axis=-1), flat_rotations[best], flat_translations[best]


def board_tilt_deg(rotations: Array) -> Array:
    """Angles between boards and the image plane.

    rotations : (n, 3, 3) — board frame to camera frame
    Returns (n,) [deg], 0 for a board that faces the camera.
    """
    return np.asarray(np.degrees(np.arccos(np.clip(np.abs(rotations[:, 2, 2]), 0.0, 1.0))))


def _relative_poses(left: CameraCalibration, right: CameraCalibration, target: Target) -> tuple[Array, Array]:
    """Poses from the left to the right camera, per pair and order of the right marks: (n, o, 3, 3) and (n, o, 3)."""
    turns, shifts = _reordering_motions(target)
    rotations = right.rotations[:, None] @ turns @ left.rotations.transpose(0, 2, 1)[:, None]
    translations = shifts @ right.rotations.transpose(0, 2, 1) + right.translations[:, None]
    return rotations, translations - np.einsum("noij,nj->noi", rotations, left.translations)


def _reordering_motions(target: Target) -> tuple[Array, Array]:
    """Motions of the target in its plane that map the marks onto each of their orders: (o, 3, 3) and (o, 3) [mm]."""
    middle = target.points.mean(axis=0)
    given, turned = target.points - middle, target.points[target.orders] - middle
    along = np.einsum("mi,omi->o", given, turned)
    across = np.einsum("m,om->o", given[:, 0], turned[..., 1]) - np.einsum("m,om->o", given[:, 1], turned[..., 0])
    turns = np.stack([rotation_matrix([0.0, 0.0, angle]) for angle in np.arctan2(across, along)])
    return turns, middle - turns @ middle


def _best_hypothesis(agreeing: Index, turn: Array, spread: Array) -> int:
    """Index of the hypothesis in the middle of the largest agreeing set; of equal sets, that of smaller rotation."""
    largest = np.flatnonzero(agreeing == agreeing.max())
    least_turn = largest[np.argmin(turn[largest])]
    same = largest[np.abs(turn[largest] - turn[least_turn]) < _SAME_ANGLE_RAD]
    return int(same[np.argmin(spread[same])])


def _adjust_and_drop(
    bundle: Bundle, marks: _Marks, model: LensModel, loss: LossKind, max_error_px: float, min_pairs: int
) -> _Solution:
    """Adjust without gross marks, and drop the worst pair until none exceeds the limit or ``min_pairs`` remain."""
    used = np.ones(len(marks.left), dtype=bool)
    error_px, gross = np.empty((len(used), 2)), Gross.none(len(used), len(marks.points))
    while True:
        kept = marks.without(gross.marks).select(used)
        bundle, scaled_loss = adjust_with_scaled_loss(bundle, *kept, model, loss)
        lengths = np.full(gross.marks.shape, np.nan)
        lengths[used] = np.linalg.norm(residuals(bundle, *kept), axis=-1)
        if (found := more_gross(gross, lengths, max_error_px)) is not None:
            gross = found
            continue
        error_px[used] = _mean(lengths[used])
        mean = error_px[used].mean(axis=1)
        worst = int(mean.argmax())
        if mean[worst] <= max_error_px or np.count_nonzero(used) <= min_pairs:
            return _Solution(bundle, scaled_loss, used, error_px, gross.marks)
        used[np.flatnonzero(used)[worst]] = False
        bundle = Bundle(bundle.rig, np.delete(bundle.rotations, worst, 0), np.delete(bundle.translations, worst, 0))


def _calibration(solved: _Solution, marks: _Marks, model: LensModel, turned: Mask, gross_px: Array) -> Calibration:
    """The calibration of a solution: its errors, covariance and checks."""
    bundle, loss, used, error_px, _ = solved
    kept = marks.select(used)
    error = residuals(bundle, *kept)
    tilt = np.full(len(used), np.nan)
    tilt[used] = board_tilt_deg(bundle.rotations)
    return Calibration(
        rig=bundle.rig,
        used=used,
        turned=turned,
        error_px=error_px,
        rms_px=_rms(error),
        epipolar_px=_mean(epipolar_distance(bundle.rig, marks.left, marks.right)),
        tilt_deg=tilt,
        covariance=covariance(bundle, *kept, model, loss),
        noise_px=noise_sigma(loss, residual_lengths(error), parameter_count(bundle, model)),
        leave_out=leave_out(bundle, *kept, model, loss),
        unmodelled=unmodelled_distortion(bundle, *kept, model, loss),
        gross_px=gross_px,
    )


def _mean(values: Array) -> Array:
    """Mean (...) over the last axis, without NaN; NaN where all values are."""
    known = np.isfinite(values)
    count = known.sum(axis=-1)
    return np.asarray(np.where(known, values, 0.0).sum(axis=-1) / np.where(count > 0, count, np.nan))


def _rms(error: Array) -> Array:
    """Root mean square length of residuals (n, 2, m, 2): left, right, both."""
    sides = [residual_lengths(error[:, 0]), residual_lengths(error[:, 1]), residual_lengths(error)]
    return np.array([np.sqrt(np.mean(side**2)) for side in sides])
