"""The 24 numbers of a rig: their names, small steps of them, and how pixels and points in space depend on them.

Per camera (fx, fy, cx, cy, k1, k2, p1, p2, k3), then the small rotation δ [rad] by which the pose between the cameras
is turned from the left, R ← exp([δ]×) R, so that no parametrisation of the rotation can degenerate, and T [mm].
"""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import (
    Camera,
    Rig,
    bend,
    rotation_angle_deg,
    rotation_matrix,
    rotation_vector,
    to_right,
)
from dicflow.core.cameras.triangulate import projection_slopes

__all__ = [
    "FIGURES",
    "LENS",
    "PARAMETERS",
    "figure_sigmas",
    "figures",
    "pose_slopes",
    "reprojection_slopes",
    "rig_moved",
]


_LENS_NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
LENS = len(_LENS_NAMES)
"""Numbers of one camera."""
PARAMETERS = (
    *(f"{side} {name}" for side in ("left", "right") for name in _LENS_NAMES),
    *("rx", "ry", "rz", "tx", "ty", "tz"),
)
"""Names of the numbers of a rig, in the order of every vector and matrix over them."""
FIGURES = ("left_fx_px", "left_fy_px", "right_fx_px", "right_fy_px", "baseline_mm", "angle_deg")
"""What an engineer knows a rig by, see :func:`figures`."""
_FOCAL_LENGTHS = (0, 1, LENS, LENS + 1)


def rig_moved(rig: Rig, step: Array) -> Rig:
    """The rig after a step (24,) of its numbers."""
    turn, shift = step[2 * LENS : 2 * LENS + 3], step[2 * LENS + 3 :]
    return Rig(
        left=_camera_moved(rig.left, step[:LENS]),
        right=_camera_moved(rig.right, step[LENS : 2 * LENS]),
        rotation=rotation_matrix(turn) @ rig.rotation,
        translation=rig.translation + shift,
    )


def _camera_moved(camera: Camera, step: Array) -> Camera:
    matrix = camera.matrix.copy()
    matrix[[0, 1, 0, 1], [0, 1, 2, 2]] += step[:4]
    return Camera(matrix, camera.distortion + step[4:], camera.size)


def pose_slopes(turned: Array) -> Array:
    """∂X/∂(δ, t) (..., 3, 6) of X = exp([δ]×) q + t at δ = 0, for q (..., 3): (−[q]×, I)."""
    slopes = np.zeros((*turned.shape, 6))
    x, y, z = turned[..., 0], turned[..., 1], turned[..., 2]
    slopes[..., 0, 1], slopes[..., 0, 2] = z, -y
    slopes[..., 1, 0], slopes[..., 1, 2] = -z, x
    slopes[..., 2, 0], slopes[..., 2, 1] = y, -x
    slopes[..., 3:] = np.eye(3)
    return slopes


def reprojection_slopes(rig: Rig, points: Array) -> tuple[Array, Array]:
    """Derivatives of the pixels (left x, left y, right x, right y) of points (..., 3) in the left camera's frame [mm].

    Returns those by the point (..., 4, 3) [px/mm] and by the rig's numbers (..., 4, 24).
    """
    moved = to_right(rig, points)
    left, right = projection_slopes(rig.left, points), projection_slopes(rig.right, moved)
    by_rig = np.zeros((*points.shape[:-1], 4, len(PARAMETERS)))
    by_rig[..., :2, :LENS] = _lens_slopes(rig.left, points)
    by_rig[..., 2:, LENS : 2 * LENS] = _lens_slopes(rig.right, moved)
    by_rig[..., 2:, 2 * LENS :] = right @ pose_slopes(moved - rig.translation)
    return np.concatenate([left, right @ rig.rotation], axis=-2), by_rig


def _lens_slopes(camera: Camera, points: Array) -> Array:
    """∂pixel/∂(the camera's numbers) (..., 2, 9) of points (..., 3) in its frame."""
    x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    slopes = np.zeros((*x.shape, 2, LENS))
    slopes[..., 0, 0], slopes[..., 1, 1] = bend(x, y, camera.distortion)
    slopes[..., 0, 2] = slopes[..., 1, 3] = 1.0
    slopes[..., 4:] = camera.matrix[:2, :2] @ _distortion_slopes(x, y)
    return slopes


def _distortion_slopes(x: Array, y: Array) -> Array:
    """∂(x', y')/∂(k1, k2, p1, p2, k3) (..., 2, 5) of the distortion."""
    r2, cross = x * x + y * y, 2.0 * x * y
    across = [x * r2, x * r2**2, cross, r2 + 2.0 * x * x, x * r2**3]
    down = [y * r2, y * r2**2, r2 + 2.0 * y * y, cross, y * r2**3]
    return np.stack([np.stack(across, axis=-1), np.stack(down, axis=-1)], axis=-2)


def figures(rig: Rig) -> Array:
    """Focal lengths [px], baseline [mm] and stereo angle [deg] of a rig, in the order of :data:`FIGURES`."""
    focal = [camera.matrix[axis, axis] for camera in (rig.left, rig.right) for axis in (0, 1)]
    return np.array([*focal, np.linalg.norm(rig.translation), rotation_angle_deg(rig.rotation)])


def figure_sigmas(rig: Rig, covariance: Array) -> Array:
    """Standard deviations of :func:`figures`, to first order.

    covariance : (24, 24) — of the rig's numbers
    """
    slopes = np.zeros((len(FIGURES), len(PARAMETERS)))
    slopes[range(4), _FOCAL_LENGTHS] = 1.0
    slopes[4, -3:] = rig.translation / np.linalg.norm(rig.translation)
    axis = rotation_vector(rig.rotation)
    slopes[5, -6:-3] = np.degrees(axis / max(float(np.linalg.norm(axis)), 1e-12))
    return np.asarray(np.sqrt(np.einsum("fp,pq,fq->f", slopes, covariance, slopes)))
