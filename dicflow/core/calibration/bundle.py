"""Bundle adjustment: camera, rig and board poses that together explain all observed marks best.

Least squares over the reprojection errors (Triggs et al. 2000, "Bundle adjustment — a modern synthesis") by the method
of Levenberg and Marquardt, with analytic derivatives, on the Schur complement of the board poses. A robust loss
(:mod:`dicflow.core.calibration.robust`) enters by iterated weights. Marks that a photograph does not show are NaN.

All poses carry a board's frame into the left camera's: X0 = R_b p + t_b, and X1 = R X0 + T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.calibration.robust import Kind, Loss, cost, efficient_scale, normal_sigma, variance, weights
from dicflow.core.cameras.camera import Camera, Rig, distort, rotation_matrix, to_right
from dicflow.core.cameras.rig_parameters import LENS, PARAMETERS, pose_slopes, reprojection_slopes, rig_moved

__all__ = ["Bundle", "Model", "adjust", "adjust_to_noise", "covariance", "estimated", "lengths", "residuals"]


_STEPS = 200
_TOLERANCE = 1e-10
_LEAST_DAMPING, _MOST_DAMPING = 1e-12, 1e8
_LEAST_CURVATURE = 1e-12
_LEAST_EIGENVALUE = 1e-15
_LEAST_SCALE_PX = 1e-6
_RADIAL = {2: (4, 5), 3: (4, 5, 8)}
_TANGENTIAL = (6, 7)
_SCALINGS = 4
_SQUARES = Loss()


class Model(NamedTuple):
    """Which coefficients of the lenses are estimated; the others are zero.

    radial : 2 (k1, k2) or 3 (k1, k2, k3)
    tangential : whether p1, p2
    """

    radial: int = 2
    tangential: bool = False

    @property
    def free(self) -> list[int]:
        """Places of the estimated numbers of the rig in :data:`~dicflow.core.cameras.rig_parameters.PARAMETERS`."""
        lens = sorted([0, 1, 2, 3, *_RADIAL[self.radial], *(_TANGENTIAL if self.tangential else ())])
        return [*lens, *(LENS + place for place in lens), *range(2 * LENS, len(PARAMETERS))]


class Bundle(NamedTuple):
    """A rig and the poses of n boards before its left camera.

    rotations : (n, 3, 3), translations : (n, 3) [mm]
    """

    rig: Rig
    rotations: Array
    translations: Array


class _Normal(NamedTuple):
    """JᵀWJ and JᵀWr in blocks: s numbers of the rig, six of each of n poses.

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
    points = _posed(bundle, board)
    seen_left, seen_right = _seen(bundle.rig.left, points), _seen(bundle.rig.right, to_right(bundle.rig, points))
    return np.stack([seen_left - left, seen_right - right], axis=1)


def lengths(error: Array) -> Array:
    """Lengths of the residuals (..., 2) of the marks that were seen, flat [px]."""
    distance = np.hypot(error[..., 0], error[..., 1])
    return np.asarray(distance[np.isfinite(distance)])


def adjust(bundle: Bundle, board: Array, left: Array, right: Array, model: Model, loss: Loss = _SQUARES) -> Bundle:
    """Refine a bundle until no step lowers the sum of the losses of the reprojection errors any more.

    board : (m, 3) [mm]; left, right : (n, m, 2) [px], as in :func:`residuals`
    """
    error = residuals(bundle, board, left, right)
    damping = 1e-3
    for _ in range(_STEPS):
        tried = _moved(bundle, _step(_normal_equations(bundle, board, error, model, loss), damping), model)
        tried_error = residuals(tried, board, left, right)
        gain = 1.0 - cost(loss, lengths(tried_error)) / cost(loss, lengths(error))
        if gain >= 0.0:
            bundle, error, damping = tried, tried_error, max(damping / 10.0, _LEAST_DAMPING)
        else:
            damping *= 10.0
        if 0.0 <= gain <= _TOLERANCE or damping > _MOST_DAMPING:
            break
    return bundle


def adjust_to_noise(
    bundle: Bundle, board: Array, left: Array, right: Array, model: Model, kind: Kind
) -> tuple[Bundle, Loss]:
    """Adjust with a loss whose scale follows from the residuals themselves; returns that loss as well.

    From least squares on, scale and adjustment are found in turn; a few turns settle the scale to a per mille.
    """
    loss = _SQUARES
    bundle = adjust(bundle, board, left, right, model)
    for _ in range(0 if kind == "squares" else _SCALINGS):
        sigma = normal_sigma(lengths(residuals(bundle, board, left, right)), estimated(bundle, model))
        loss = Loss(kind, max(efficient_scale(kind, sigma), _LEAST_SCALE_PX))
        bundle = adjust(bundle, board, left, right, model, loss)
    return bundle, loss


def covariance(bundle: Bundle, board: Array, left: Array, right: Array, model: Model, loss: Loss = _SQUARES) -> Array:
    """Covariance of the numbers of an adjusted rig, whatever the poses of the boards: (24, 24).

    The inverse of the Schur complement of the poses, times the variance of one coordinate of the residuals. It rests
    on errors of the marks that are independent and alike. Rows and columns of numbers that were not estimated are 0.
    """
    error = residuals(bundle, board, left, right)
    normal = _normal_equations(bundle, board, error, model, _SQUARES)
    complement = normal.rig - _condensed(normal.mixed, _solved(normal.poses, normal.mixed.transpose(0, 2, 1)))
    full = np.zeros((len(PARAMETERS), len(PARAMETERS)))
    full[np.ix_(model.free, model.free)] = _inverse(complement) * variance(
        loss, lengths(error), estimated(bundle, model)
    )
    return full


def estimated(bundle: Bundle, model: Model) -> int:
    """How many numbers an adjustment estimates."""
    return len(model.free) + 6 * len(bundle.rotations)


def _inverse(normal: Array) -> Array:
    """Inverse of a normal matrix (p, p); what the observations do not determine gets a very large variance."""
    scale = 1.0 / np.sqrt(np.maximum(np.diag(normal), _LEAST_CURVATURE))
    values, vectors = np.linalg.eigh(normal * np.outer(scale, scale))
    rows = vectors * scale[:, None]
    return np.asarray((rows / np.maximum(values, _LEAST_EIGENVALUE)) @ rows.T)


def _posed(bundle: Bundle, board: Array) -> Array:
    """Marks (n, m, 3) of all boards in the left camera's frame [mm]."""
    return np.asarray(board @ bundle.rotations.transpose(0, 2, 1) + bundle.translations[:, None])


def _seen(camera: Camera, points: Array) -> Array:
    """Pixels of points, those behind the camera included: a step of the adjustment may pass through such a state."""
    return distort(camera, points[..., :2] / points[..., 2:])


def _normal_equations(bundle: Bundle, board: Array, error: Array, model: Model, loss: Loss) -> _Normal:
    """The normal equations at residuals (n, 2, m, 2), each weighted by the loss; unseen marks weigh nothing."""
    by_rig, by_pose = _jacobians(bundle, board, model)
    distance = np.hypot(error[..., 0], error[..., 1])
    weight = np.where(np.isfinite(distance), weights(loss, np.nan_to_num(distance)), 0.0)
    weight = np.repeat(weight.reshape(len(error), -1), 2, axis=1)
    slope = weight * np.nan_to_num(error.reshape(len(error), -1))
    rig_rows = (by_rig * weight[..., None]).transpose(0, 2, 1)
    pose_rows = (by_pose * weight[..., None]).transpose(0, 2, 1)
    return _Normal(
        rig=(rig_rows @ by_rig).sum(axis=0),
        mixed=rig_rows @ by_pose,
        poses=pose_rows @ by_pose,
        rig_slope=np.einsum("nrs,nr->s", by_rig, slope),
        pose_slopes=np.einsum("nrp,nr->np", by_pose, slope),
    )


def _step(normal: _Normal, damping: float) -> tuple[Array, Array]:
    """The damped step of the rig's numbers (s,) and of the poses (n, 6), by elimination of the poses."""
    rig, poses = _damped(normal.rig, damping), _damped(normal.poses, damping)
    back, alone = _solved(poses, normal.mixed.transpose(0, 2, 1)), _solved(poses, normal.pose_slopes[..., None])
    slope = normal.rig_slope - _condensed(normal.mixed, alone)[:, 0]
    step = np.asarray(np.linalg.solve(rig - _condensed(normal.mixed, back), -slope), dtype=np.float64)
    return step, -(alone + back @ step[:, None])[..., 0]


def _damped(normal: Array, damping: float) -> Array:
    """Normal matrices (..., p, p) with their diagonals raised in proportion (Marquardt 1963)."""
    diagonal = np.maximum(np.einsum("...ii->...i", normal), _LEAST_CURVATURE)
    return np.asarray(normal + damping * diagonal[..., None] * np.eye(normal.shape[-1]))


def _solved(poses: Array, right: Array) -> Array:
    """poses⁻¹ right, for each board."""
    return np.asarray(np.linalg.solve(poses, right))


def _condensed(mixed: Array, back: Array) -> Array:
    """Σ over the boards of mixed (n, s, 6) @ back (n, 6, q)."""
    return np.asarray(np.einsum("nsp,npq->sq", mixed, back))


def _jacobians(bundle: Bundle, board: Array, model: Model) -> tuple[Array, Array]:
    """Derivatives of the residuals of each pair, in the order of :func:`residuals`.

    Returns those by the rig's estimated numbers (n, 4m, s) and by the board's own pose (n, 4m, 6).
    """
    points = _posed(bundle, board)
    by_point, by_rig = reprojection_slopes(bundle.rig, points)
    by_pose = by_point @ pose_slopes(points - bundle.translations[:, None])
    return _camera_by_camera(by_rig[..., model.free]), _camera_by_camera(by_pose)


def _camera_by_camera(rows: Array) -> Array:
    """Rows (n, m, 4, p) of each mark as (n, 4m, p): all marks of the left photograph, then those of the right one."""
    pairs, marks, _, numbers = rows.shape
    return rows.reshape(pairs, marks, 2, 2, numbers).swapaxes(1, 2).reshape(pairs, 4 * marks, numbers)


def _moved(bundle: Bundle, step: tuple[Array, Array], model: Model) -> Bundle:
    """The bundle after a step of the rig's estimated numbers and of the poses."""
    by_rig, poses = step
    full = np.zeros(len(PARAMETERS))
    full[model.free] = by_rig
    turns = np.stack([rotation_matrix(pose[:3]) for pose in poses])
    return Bundle(rig_moved(bundle.rig, full), turns @ bundle.rotations, bundle.translations + poses[:, 3:])
