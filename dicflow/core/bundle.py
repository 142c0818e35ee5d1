"""Bundle adjustment: camera, rig and board poses that together explain all observed corners best.

Least squares over the reprojection errors (Triggs et al. 2000, "Bundle adjustment — a modern synthesis") by the method
of Levenberg and Marquardt, with analytic derivatives. Rotations are updated by a small rotation from the left,
R ← exp([δ]×) R, so that no parametrisation of the rotation can degenerate.

All poses carry a board's frame into the left camera's: X0 = R_b p + t_b, and X1 = R X0 + T.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.core.camera import Camera, Rig, bend, bend_slopes, distort, rotation_matrix, to_right

__all__ = ["Bundle", "Model", "adjust", "residuals"]

Array = NDArray[np.float64]

_STEPS = 200
_TOLERANCE = 1e-10
_LEAST_DAMPING, _MOST_DAMPING = 1e-12, 1e8
_RADIAL = {2: (4, 5), 3: (4, 5, 8)}
_TANGENTIAL = (6, 7)


class Model(NamedTuple):
    """Which coefficients of the lenses are estimated; the others are zero.

    radial : 2 (k1, k2) or 3 (k1, k2, k3)
    tangential : whether p1, p2
    """

    radial: int = 2
    tangential: bool = False

    @property
    def free(self) -> list[int]:
        """Places of the estimated numbers in (fx, fy, cx, cy, k1, k2, p1, p2, k3)."""
        return sorted([0, 1, 2, 3, *_RADIAL[self.radial], *(_TANGENTIAL if self.tangential else ())])


class Bundle(NamedTuple):
    """A rig and the poses of n boards before its left camera.

    rotations : (n, 3, 3), translations : (n, 3) [mm]
    """

    rig: Rig
    rotations: Array
    translations: Array


def residuals(bundle: Bundle, board: Array, left: Array, right: Array) -> Array:
    """Reprojected minus observed corners.

    board : (m, 3) — corners in the board's frame [mm]
    left, right : (n, m, 2) — observed corners [px]
    Returns (n, 2, m, 2) [px]; the second axis is the camera.
    """
    points = _posed(bundle, board)
    seen_left, seen_right = _seen(bundle.rig.left, points), _seen(bundle.rig.right, to_right(bundle.rig, points))
    return np.stack([seen_left - left, seen_right - right], axis=1)


def adjust(bundle: Bundle, board: Array, left: Array, right: Array, model: Model) -> Bundle:
    """Refine a bundle until no step lowers the sum of squared reprojection errors any more.

    board : (m, 3) [mm]; left, right : (n, m, 2) [px], as in :func:`residuals`
    """
    error = residuals(bundle, board, left, right)
    damping = 1e-3
    for _ in range(_STEPS):
        normal, gradient = _normal_equations(bundle, board, error, model)
        scale = np.diag(np.maximum(np.diag(normal), 1e-12))
        step = np.asarray(np.linalg.solve(normal + damping * scale, -gradient), dtype=np.float64)
        tried = _moved(bundle, step, model)
        tried_error = residuals(tried, board, left, right)
        gain = 1.0 - np.sum(tried_error**2) / np.sum(error**2)
        if gain >= 0.0:
            bundle, error, damping = tried, tried_error, max(damping / 10.0, _LEAST_DAMPING)
        else:
            damping *= 10.0
        if 0.0 <= gain <= _TOLERANCE or damping > _MOST_DAMPING:
            break
    return bundle


def _posed(bundle: Bundle, board: Array) -> Array:
    """Corners (n, m, 3) of all boards in the left camera's frame [mm]."""
    return np.asarray(board @ bundle.rotations.transpose(0, 2, 1) + bundle.translations[:, None])


def _seen(camera: Camera, points: Array) -> Array:
    """Pixels of points, those behind the camera included: a step of the adjustment may pass through such a state."""
    return distort(camera, points[..., :2] / points[..., 2:])


def _normal_equations(bundle: Bundle, board: Array, error: Array, model: Model) -> tuple[Array, Array]:
    """JᵀJ (p, p) and Jᵀr (p,); parameters: left camera, right camera, R and T, then six per board."""
    by_shared, by_pose = _jacobians(bundle, board, model)
    rows = np.concatenate([by_shared, by_pose], axis=-1)
    products = rows.transpose(0, 2, 1) @ rows
    slopes = np.einsum("nrp,nr->np", rows, error.reshape(len(error), -1))
    shared = by_shared.shape[-1]
    size = shared + 6 * len(rows)
    normal, gradient = np.zeros((size, size)), np.zeros(size)
    for view, (product, slope) in enumerate(zip(products, slopes, strict=True)):
        own = np.r_[:shared, shared + 6 * view : shared + 6 * view + 6]
        normal[np.ix_(own, own)] += product
        gradient[own] += slope
    return normal, gradient


def _jacobians(bundle: Bundle, board: Array, model: Model) -> tuple[Array, Array]:
    """Derivatives of the residuals of each pair, in the order of :func:`residuals`.

    Returns those by the parameters of both cameras, R and T (n, 4m, s), and by the board's own pose (n, 4m, 6).
    """
    rig, lens = bundle.rig, len(model.free)
    points = _posed(bundle, board)
    moved = to_right(rig, points)
    left, left_lens = _projection_slopes(rig.left, points, model)
    right, right_lens = _projection_slopes(rig.right, moved, model)
    by_shared = np.zeros((len(points), 2, len(board), 2, 2 * lens + 6))
    by_shared[:, 0, ..., :lens] = left_lens
    by_shared[:, 1, ..., lens : 2 * lens] = right_lens
    by_shared[:, 1, ..., 2 * lens :] = right @ _pose_slopes(moved - rig.translation)
    from_pose = _pose_slopes(points - bundle.translations[:, None])
    by_pose = np.stack([left @ from_pose, right @ rig.rotation @ from_pose], axis=1)
    return by_shared.reshape(len(points), -1, 2 * lens + 6), by_pose.reshape(len(points), -1, 6)


def _pose_slopes(turned: Array) -> Array:
    """∂X/∂(δ, t) (..., 3, 6) of X = exp([δ]×) q + t at δ = 0, for q (..., 3): (−[q]×, I)."""
    slopes = np.zeros((*turned.shape, 6))
    x, y, z = turned[..., 0], turned[..., 1], turned[..., 2]
    slopes[..., 0, 1], slopes[..., 0, 2] = z, -y
    slopes[..., 1, 0], slopes[..., 1, 2] = -z, x
    slopes[..., 2, 0], slopes[..., 2, 1] = y, -x
    slopes[..., 3:] = np.eye(3)
    return slopes


def _projection_slopes(camera: Camera, points: Array, model: Model) -> tuple[Array, Array]:
    """Derivatives of the pixels of points (..., 3): by the point (..., 2, 3) and by the free numbers (..., 2, l)."""
    fx, fy = camera.matrix[0, 0], camera.matrix[1, 1]
    x, y = points[..., 0] / points[..., 2], points[..., 1] / points[..., 2]
    r2 = x * x + y * y
    xx, xy, yy = bend_slopes(x, y, camera.distortion)
    by_point = np.empty((*x.shape, 2, 3))
    by_point[..., 0, 0], by_point[..., 0, 1] = fx * xx, fx * xy
    by_point[..., 1, 0], by_point[..., 1, 1] = fy * xy, fy * yy
    by_point[..., 2] = -(by_point[..., 0] * x[..., None] + by_point[..., 1] * y[..., None])
    by_point /= points[..., 2, None, None]
    by_lens = np.zeros((*x.shape, 2, 9))
    by_lens[..., 0, 0], by_lens[..., 1, 1] = bend(x, y, camera.distortion)
    by_lens[..., 0, 2] = by_lens[..., 1, 3] = 1.0
    for place, power in ((4, r2), (5, r2**2), (8, r2**3)):
        by_lens[..., 0, place], by_lens[..., 1, place] = fx * x * power, fy * y * power
    by_lens[..., 0, 6], by_lens[..., 1, 6] = fx * 2.0 * x * y, fy * (r2 + 2.0 * y * y)
    by_lens[..., 0, 7], by_lens[..., 1, 7] = fx * (r2 + 2.0 * x * x), fy * 2.0 * x * y
    return by_point, by_lens[..., model.free]


def _moved(bundle: Bundle, step: Array, model: Model) -> Bundle:
    """The bundle after a step (p,) in the order of :func:`_normal_equations`."""
    lens = len(model.free)
    rig, motion, poses = bundle.rig, step[2 * lens : 2 * lens + 6], step[2 * lens + 6 :].reshape(-1, 6)
    moved = Rig(
        left=_camera_moved(rig.left, step[:lens], model),
        right=_camera_moved(rig.right, step[lens : 2 * lens], model),
        rotation=rotation_matrix(motion[:3]) @ rig.rotation,
        translation=rig.translation + motion[3:],
    )
    turns = np.stack([rotation_matrix(pose[:3]) for pose in poses])
    return Bundle(moved, turns @ bundle.rotations, bundle.translations + poses[:, 3:])


def _camera_moved(camera: Camera, step: Array, model: Model) -> Camera:
    numbers = np.concatenate([camera.matrix[[0, 1, 0, 1], [0, 1, 2, 2]], camera.distortion])
    numbers[model.free] += step
    matrix = np.array([[numbers[0], 0.0, numbers[2]], [0.0, numbers[1], numbers[3]], [0.0, 0.0, 1.0]])
    return Camera(matrix, numbers[4:], camera.size)
