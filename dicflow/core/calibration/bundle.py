"""Bundle adjustment: the camera parameters, rig pose and board poses that fit all observed marks best.

Least squares over the reprojection errors (Triggs et al. 2000, "Bundle adjustment — a modern synthesis") by the method
of Levenberg and Marquardt, with analytic derivatives, on the Schur complement of the board poses. A robust loss
(:mod:`dicflow.core.calibration.robust`) enters by iterated weights. Marks that a photograph does not show are NaN.

All poses map a board's frame into the left camera's: X0 = R_b p + t_b, and X1 = R X0 + T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.calibration.robust import Loss, LossKind, cost, efficient_scale, sigma_from_median, variance, weights
from dicflow.core.cameras.camera import Camera, Rig, distort, rotation_matrix, to_right
from dicflow.core.cameras.rig_parameters import (
    PARAMETERS,
    PARAMETERS_PER_CAMERA,
    pose_slopes,
    reprojection_slopes,
    rig_after_step,
)

__all__ = [
    "Bundle",
    "LensModel",
    "adjust",
    "adjust_with_scaled_loss",
    "covariance",
    "parameter_count",
    "residual_lengths",
    "residuals",
]


_MAX_STEPS = 200
_CONVERGED_GAIN = 1e-10
_MIN_DAMPING, _MAX_DAMPING = 1e-12, 1e8
_MIN_CURVATURE = 1e-12
_MIN_EIGENVALUE = 1e-15
_MIN_LOSS_SCALE_PX = 1e-6
_RADIAL_INDICES = {2: (4, 5), 3: (4, 5, 8)}
_TANGENTIAL_INDICES = (6, 7)
_SCALE_UPDATES = 4
_LEAST_SQUARES = Loss()


class LensModel(NamedTuple):
    """Which distortion coefficients are estimated; the others are zero.

    radial : number of radial coefficients, 2 (k1, k2) or 3 (k1, k2, k3)
    tangential : whether p1 and p2 are estimated
    """

    radial: int = 2
    tangential: bool = False

    @property
    def free(self) -> list[int]:
        """Indices of the estimated parameters in :data:`~dicflow.core.cameras.rig_parameters.PARAMETERS`."""
        lens = sorted([0, 1, 2, 3, *_RADIAL_INDICES[self.radial], *(_TANGENTIAL_INDICES if self.tangential else ())])
        return [
            *lens,
            *(PARAMETERS_PER_CAMERA + place for place in lens),
            *range(2 * PARAMETERS_PER_CAMERA, len(PARAMETERS)),
        ]


class Bundle(NamedTuple):
    """A rig and the poses of n boards in its left camera's frame.

    rotations : (n, 3, 3), translations : (n, 3) [mm]
    """

    rig: Rig
    rotations: Array
    translations: Array


class _NormalEquations(NamedTuple):
    """JᵀWJ and JᵀWr in blocks: s parameters of the rig, six of each of n board poses.

    rig : (s, s), mixed : (n, s, 6), poses : (n, 6, 6); rig_slope : (s,), pose_slopes : (n, 6)
    """

    rig: Array
    mixed: Array
    poses: Array
    rig_slope: Array
    pose_slopes: Array


def residuals(bundle: Bundle, board: Array, left: Array, right: Array) -> Array:
    """Reprojected minus observed marks.

    board : (m, 3) — marks in the board's frame [mm]
    left, right : (n, m, 2) — observed marks [px], NaN where not seen
    Returns (n, 2, m, 2) [px]; the second axis is the camera.
    """
    points = _marks_in_left_frame(bundle, board)
    reprojected_left, reprojected_right = (
        _reprojected(bundle.rig.left, points),
        _reprojected(bundle.rig.right, to_right(bundle.rig, points)),
    )
    return np.stack([reprojected_left - left, reprojected_right - right], axis=1)


def residual_lengths(error: Array) -> Array:
    """Lengths (n,) of the residuals (..., 2) of all marks that were observed [px]."""
    distance = np.hypot(error[..., 0], error[..., 1])
    return np.asarray(distance[np.isfinite(distance)])


def adjust(
    bundle: Bundle, board: Array, left: Array, right: Array, model: LensModel, loss: Loss = _LEAST_SQUARES
) -> Bundle:
    """Adjust a bundle until no step lowers the sum of the losses of the reprojection errors.

    board : (m, 3) [mm]; left, right : (n, m, 2) [px], as in :func:`residuals`
    """
    error = residuals(bundle, board, left, right)
    damping = 1e-3
    for _ in range(_MAX_STEPS):
        trial = _after_step(bundle, _step(_normal_equations(bundle, board, error, model, loss), damping), model)
        trial_error = residuals(trial, board, left, right)
        gain = 1.0 - cost(loss, residual_lengths(trial_error)) / cost(loss, residual_lengths(error))
        if gain >= 0.0:
            bundle, error, damping = trial, trial_error, max(damping / 10.0, _MIN_DAMPING)
        else:
            damping *= 10.0
        if 0.0 <= gain <= _CONVERGED_GAIN or damping > _MAX_DAMPING:
            break
    return bundle


def adjust_with_scaled_loss(
    bundle: Bundle, board: Array, left: Array, right: Array, model: LensModel, kind: LossKind
) -> tuple[Bundle, Loss]:
    """Adjust with a loss whose scale is estimated from the residuals.

    Starts from least squares, then updates scale and adjustment in turn; a few updates fix the scale to 0.1 %.

    Returns the adjusted bundle and the loss of the last update.
    """
    loss = _LEAST_SQUARES
    bundle = adjust(bundle, board, left, right, model)
    for _ in range(0 if kind == "squares" else _SCALE_UPDATES):
        sigma = sigma_from_median(
            residual_lengths(residuals(bundle, board, left, right)), parameter_count(bundle, model)
        )
        loss = Loss(kind, max(efficient_scale(kind, sigma), _MIN_LOSS_SCALE_PX))
        bundle = adjust(bundle, board, left, right, model, loss)
    return bundle, loss


def covariance(
    bundle: Bundle, board: Array, left: Array, right: Array, model: LensModel, loss: Loss = _LEAST_SQUARES
) -> Array:
    """Covariance (24, 24) of the parameters of an adjusted rig, with the board poses eliminated.

    The inverse of the Schur complement of the poses, times the variance of one coordinate of the residuals. Assumes
    that the errors of the marks are independent and equally distributed. Rows and columns of parameters that were not
    estimated are 0.
    """
    error = residuals(bundle, board, left, right)
    normal = _normal_equations(bundle, board, error, model, _LEAST_SQUARES)
    complement = normal.rig - _sum_over_boards(
        normal.mixed, _solve_per_board(normal.poses, normal.mixed.transpose(0, 2, 1))
    )
    full = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    full[np.ix_(model.free, model.free)] = _inverse(complement) * variance(
        loss, residual_lengths(error), parameter_count(bundle, model)
    )
    return full


def parameter_count(bundle: Bundle, model: LensModel) -> int:
    """Number of parameters that an adjustment estimates: those of the rig and six per board."""
    return len(model.free) + 6 * len(bundle.rotations)


def _inverse(normal: Array) -> Array:
    """Inverse of a normal matrix (p, p); parameters without information get a very large variance."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), _MIN_CURVATURE))
    values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
    rows = vectors * scale[:, None]
    return np.asarray((rows / np.maximum(values, _MIN_EIGENVALUE)) @ rows.T)


def _marks_in_left_frame(bundle: Bundle, board: Array) -> Array:
    """Marks (n, m, 3) of all boards in the left camera's frame [mm]."""
    return np.asarray(board @ bundle.rotations.transpose(0, 2, 1) + bundle.translations[:, None])


def _reprojected(camera: Camera, points: Array) -> Array:
    """Pixels of points, also of those behind the camera, where a step of the adjustment may put them."""
    return distort(camera, points[..., :2] / points[..., 2:])


def _normal_equations(bundle: Bundle, board: Array, error: Array, model: LensModel, loss: Loss) -> _NormalEquations:
    """The normal equations at residuals (n, 2, m, 2), each weighted by the loss; marks not seen have weight 0."""
    by_rig, by_pose = _jacobians(bundle, board, model)
    distance = np.hypot(error[..., 0], error[..., 1])
    weight = np.where(np.isfinite(distance), weights(loss, np.nan_to_num(distance)), 0.0)
    weight = np.repeat(weight.reshape(len(error), -1), 2, axis=1)
    slope = weight * np.nan_to_num(error.reshape(len(error), -1))
    rig_rows = (by_rig * weight[..., None]).transpose(0, 2, 1)
    pose_rows = (by_pose * weight[..., None]).transpose(0, 2, 1)
    return _NormalEquations(
        rig=(rig_rows @ by_rig).sum(axis=0),
        mixed=rig_rows @ by_pose,
        poses=pose_rows @ by_pose,
        rig_slope=np.einsum("nrs,nr->s", by_rig, slope),
        pose_slopes=np.einsum("nrp,nr->np", by_pose, slope),
    )


def _step(normal: _NormalEquations, damping: float) -> tuple[Array, Array]:
    """The damped step of the rig's parameters (s,) and of the poses (n, 6), by elimination of the poses."""
    rig, poses = _damped(normal.rig, damping), _damped(normal.poses, damping)
    poses_by_rig, poses_alone = (
        _solve_per_board(poses, normal.mixed.transpose(0, 2, 1)),
        _solve_per_board(poses, normal.pose_slopes[..., None]),
    )
    slope = normal.rig_slope - _sum_over_boards(normal.mixed, poses_alone)[:, 0]
    step = np.asarray(np.linalg.solve(rig - _sum_over_boards(normal.mixed, poses_by_rig), -slope), dtype=np.float64)
    return step, -(poses_alone + poses_by_rig @ step[:, None])[..., 0]


def _damped(normal: Array, damping: float) -> Array:
    """Normal matrices (..., p, p) with their diagonals multiplied by 1 + damping (Marquardt 1963)."""
    diagonal = np.maximum(np.einsum("...ii->...i", normal), _MIN_CURVATURE)
    return np.asarray(normal + damping * diagonal[..., None] * np.eye(normal.shape[-1]))


def _solve_per_board(poses: Array, right: Array) -> Array:
    """poses⁻¹ right for each board: (n, 6, 6) and (n, 6, q) give (n, 6, q)."""
    return np.asarray(np.linalg.solve(poses, right))


def _sum_over_boards(mixed: Array, poses: Array) -> Array:
    """Σ over the boards of mixed (n, s, 6) @ poses (n, 6, q)."""
    return np.asarray(np.einsum("nsp,npq->sq", mixed, poses))


def _jacobians(bundle: Bundle, board: Array, model: LensModel) -> tuple[Array, Array]:
    """Derivatives of the residuals of each pair, in the order of :func:`residuals`.

    Returns those with respect to the rig's estimated parameters (n, 4m, s) and to the board's own pose (n, 4m, 6).
    """
    points = _marks_in_left_frame(bundle, board)
    by_point, by_rig = reprojection_slopes(bundle.rig, points)
    by_pose = by_point @ pose_slopes(points - bundle.translations[:, None])
    return _rows_by_camera(by_rig[..., model.free]), _rows_by_camera(by_pose)


def _rows_by_camera(rows: Array) -> Array:
    """Rows (n, m, 4, p) per mark as (n, 4m, p): all marks of the left photograph, then those of the right one."""
    pairs, marks, _, numbers = rows.shape
    return rows.reshape(pairs, marks, 2, 2, numbers).swapaxes(1, 2).reshape(pairs, 4 * marks, numbers)


def _after_step(bundle: Bundle, step: tuple[Array, Array], model: LensModel) -> Bundle:
    """The bundle after a step (s,) of the rig's estimated parameters and (n, 6) of the poses."""
    by_rig, poses = step
    full = np.zeros(len(PARAMETERS))
    full[model.free] = by_rig
    rotations = np.stack([rotation_matrix(pose[:3]) for pose in poses])
    return Bundle(rig_after_step(bundle.rig, full), rotations @ bundle.rotations, bundle.translations + poses[:, 3:])
