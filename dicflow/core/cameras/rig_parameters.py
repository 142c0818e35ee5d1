"""The 24 parameters of a rig: their names, steps of them, and the derivatives of pixels with respect to them.

Per camera (fx, fy, cx, cy, k1, k2, p1, p2, k3), then a small rotation δ [rad], R ← exp([δ]×) R, and T [mm]. The
rotation is parametrised by a step from its current value, so that the parametrisation is never singular.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import (
    Camera,
    Rig,
    distort_normalised,
    rotation_angle_deg,
    rotation_matrix,
    rotation_vector,
    to_right,
)
from dicflow.core.cameras.triangulate import projection_slopes

__all__ = [
    "KEY_FIGURES",
    "PARAMETERS",
    "PARAMETERS_PER_CAMERA",
    "error_modes",
    "key_figure_sigmas",
    "key_figures",
    "pose_slopes",
    "reprojection_slopes",
    "rig_after_step",
]


_CAMERA_PARAMETERS = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
PARAMETERS_PER_CAMERA = len(_CAMERA_PARAMETERS)
"""Number of parameters of one camera."""
PARAMETERS = (
    *(f"{side} {name}" for side in ("left", "right") for name in _CAMERA_PARAMETERS),
    *("rx", "ry", "rz", "tx", "ty", "tz"),
)
"""Names of the parameters of a rig, in the order of every vector and matrix over them."""
KEY_FIGURES = ("left_fx_px", "left_fy_px", "right_fx_px", "right_fy_px", "baseline_mm", "angle_deg")
"""Names of a rig's focal lengths, baseline and stereo angle, see :func:`key_figures`."""
_FOCAL_LENGTH_INDICES = (0, 1, PARAMETERS_PER_CAMERA, PARAMETERS_PER_CAMERA + 1)
_MIN_EIGENVALUE = 1e-9
"""Of the correlation matrix of the rig's parameters; modes with a smaller one are dropped."""


def rig_after_step(rig: Rig, step: Array) -> Rig:
    """The rig after a step (24,) of its parameters."""
    turn, shift = step[2 * PARAMETERS_PER_CAMERA : 2 * PARAMETERS_PER_CAMERA + 3], step[2 * PARAMETERS_PER_CAMERA + 3 :]
    return Rig(
        left=_camera_after_step(rig.left, step[:PARAMETERS_PER_CAMERA]),
        right=_camera_after_step(rig.right, step[PARAMETERS_PER_CAMERA : 2 * PARAMETERS_PER_CAMERA]),
        rotation=rotation_matrix(turn) @ rig.rotation,
        translation=rig.translation + shift,
    )


def _camera_after_step(camera: Camera, step: Array) -> Camera:
    matrix = camera.matrix.copy()
    matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += step[:4]
    return Camera(matrix, camera.distortion + step[4:], camera.size)


def pose_slopes(rotated: Array) -> Array:
    """∂X/∂(δ, t) (..., 3, 6) of X = exp([δ]×) q + t at δ = 0, for q (..., 3): (−[q]×, I)."""
    slopes = np.zeros((*rotated.shape, 6))
    x, y, z = rotated[..., 0], rotated[..., 1], rotated[..., 2]
    slopes[..., 0, 1], slopes[..., 0, 2] = z, -y
    slopes[..., 1, 0], slopes[..., 1, 2] = -z, x
    slopes[..., 2, 0], slopes[..., 2, 1] = y, -x
    slopes[..., 3:] = np.eye(3)
    return slopes


def reprojection_slopes(rig: Rig, points: Array) -> tuple[Array, Array]:
    """Derivatives of the pixels (left x, left y, right x, right y) of points (..., 3) in the left camera's frame [mm].

    Returns those with respect to the point (..., 4, 3) [px/mm] and to the rig's parameters (..., 4, 24).
    """
    points_right = to_right(rig, points)
    left, right = projection_slopes(rig.left, points), projection_slopes(rig.right, points_right)
    by_rig = np.zeros((*points.shape[:-1], 4, len(PARAMETERS)))
    by_rig[..., :2, :PARAMETERS_PER_CAMERA] = _camera_slopes(rig.left, points)
    by_rig[..., 2:, PARAMETERS_PER_CAMERA : 2 * PARAMETERS_PER_CAMERA] = _camera_slopes(rig.right, points_right)
    by_rig[..., 2:, 2 * PARAMETERS_PER_CAMERA :] = right @ pose_slopes(points_right - rig.translation)
    return np.concatenate([left, right @ rig.rotation], axis=-2), by_rig


def _camera_slopes(camera: Camera, points: Array) -> Array:
    """∂pixel/∂(the camera's parameters) (..., 2, 9) of points (..., 3) in its frame."""
    x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    slopes = np.zeros((*x.shape, 2, PARAMETERS_PER_CAMERA))
    slopes[..., 0, 0], slopes[..., 1, 1] = distort_normalised(x, y, camera.distortion)
    slopes[..., 0, 2] = slopes[..., 1, 3] = 1.0
    slopes[..., 4:] = camera.matrix[:2, :2] @ _coefficient_slopes(x, y)
    return slopes


def _coefficient_slopes(x: Array, y: Array) -> Array:
    """∂(x', y')/∂(k1, k2, p1, p2, k3) (..., 2, 5) at undistorted normalised coordinates x, y (...)."""
    r2, cross = x * x + y * y, 2.0 * x * y
    across = [x * r2, x * r2**2, cross, r2 + 2.0 * x * x, x * r2**3]
    down = [y * r2, y * r2**2, r2 + 2.0 * y * y, cross, y * r2**3]
    return np.stack([np.stack(across, axis=-1), np.stack(down, axis=-1)], axis=-2)


def key_figures(rig: Rig) -> Array:
    """Focal lengths [px], baseline [mm] and stereo angle [deg] of a rig, in the order of :data:`KEY_FIGURES`."""
    focal = [camera.matrix[axis, axis] for camera in (rig.left, rig.right) for axis in (0, 1)]
    return np.array([*focal, np.linalg.norm(rig.translation), rotation_angle_deg(rig.rotation)])


def key_figure_sigmas(rig: Rig, covariance: Array) -> Array:
    """Standard deviations of :func:`key_figures`, to first order.

    covariance : (24, 24) — of the rig's parameters
    """
    slopes = np.zeros((len(KEY_FIGURES), len(PARAMETERS)))
    slopes[range(4), _FOCAL_LENGTH_INDICES] = 1.0
    slopes[4, -3:] = rig.translation / np.linalg.norm(rig.translation)
    axis = rotation_vector(rig.rotation)
    slopes[5, -6:-3] = np.degrees(axis / max(float(np.linalg.norm(axis)), 1e-12))
    return np.asarray(np.sqrt(np.einsum("fp,pq,fq->f", slopes, covariance, slopes)))


def error_modes(covariance: ArrayLike) -> Array:
    """Modes M (p, m) of a covariance C (p, p), with M Mᵀ = C: independent errors of unit variance."""
    full = np.asarray(covariance, dtype=np.float64)
    scale = np.sqrt(np.diagonal(full))
    units = np.where(scale > 0.0, scale, 1.0)
    strengths, directions = np.linalg.eigh(full / np.outer(units, units))
    kept = strengths > _MIN_EIGENVALUE
    return np.asarray(scale[:, None] * directions[:, kept] * np.sqrt(strengths[kept]))
