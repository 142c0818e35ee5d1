"""Camera model: from points in space to pixels of a photograph, and from pixels to rays.

A pinhole with the distortion of Brown (1971), five coefficients (k1, k2, p1, p2, k3) in the order that OpenCV and
MATLAB's toolboxes use. With x = X/Z, y = Y/Z and r² = x² + y²::

    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
    y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y
    (u, v, 1) = matrix @ (x', y', 1)
"""

from __future__ import annotations

from typing import NamedTuple, TypeVar

import cv2
import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array

__all__ = [
    "Camera",
    "Rig",
    "camera_matrix",
    "distort",
    "distort_normalised",
    "distortion_slopes",
    "homogeneous",
    "project",
    "resized",
    "rotation_angle_deg",
    "rotation_matrix",
    "rotation_vector",
    "to_right",
    "undistort",
    "windowed",
]

_Number = TypeVar("_Number", float, Array)

_MAX_NEWTON_STEPS = 40
_NEWTON_TOLERANCE = 1e-13
_MAX_SMALL_SINE = 1e-4


class Camera(NamedTuple):
    """Intrinsic parameters of one camera.

    matrix : (3, 3) — focal lengths, principal point and skew [px]
    distortion : (5,) — k1, k2, p1, p2, k3 [-]
    size : (width, height) of its photographs [px]
    """

    matrix: Array
    distortion: Array
    size: tuple[int, int]


class Rig(NamedTuple):
    """Two cameras and their relative pose: X1 = rotation @ X0 + translation, X0 in the left, X1 in the right frame.

    rotation : (3, 3)
    translation : (3,) [mm]
    """

    left: Camera
    right: Camera
    rotation: Array
    translation: Array


def windowed(camera: Camera, offset: ArrayLike, size: tuple[int, int]) -> Camera:
    """The camera with a window of its sensor: the principal point moves by the window's place.

    offset : (2,) — the window's first pixel (x, y) in the photographs of the camera [px]
    size : (width, height) of the window [px]
    """
    matrix = camera.matrix.copy()
    matrix[:2, 2] -= np.asarray(offset, dtype=float)
    return Camera(matrix, camera.distortion, size)


def resized(camera: Camera, size: tuple[int, int]) -> Camera:
    """The camera with photographs of another resolution: (width, height) [px]."""
    scale = np.divide(size, camera.size)
    matrix = camera.matrix.copy()
    matrix[:2] *= scale[:, None]
    matrix[:2, 2] += 0.5 * (scale - 1.0)  # the edge of a photograph is half a pixel before the centre of its first one
    return Camera(matrix, camera.distortion, size)


def camera_matrix(focal_px: float, centre: ArrayLike) -> Array:
    """Matrix of a camera with square pixels.

    focal_px : focal length [px]
    centre : (2,) — principal point (x, y) [px]
    """
    x, y = np.asarray(centre, dtype=float)
    return np.array([[focal_px, 0.0, x], [0.0, focal_px, y], [0.0, 0.0, 1.0]])


def to_right(rig: Rig, points: ArrayLike) -> Array:
    """Transform points (..., 3) [mm] from the left camera's frame into the right one's."""
    return np.asarray(points, dtype=float) @ rig.rotation.T + rig.translation


def homogeneous(points: Array) -> Array:
    """Points (..., d) with a last coordinate of 1: (..., d + 1)."""
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)


def project(camera: Camera, points: ArrayLike) -> Array:
    """Raw pixels of points in space.

    points : (..., 3) — in the frame of this camera [mm]
    Returns (..., 2) [px]; NaN where a point is not in front of the camera.
    """
    points = np.asarray(points, dtype=float)
    depth = points[..., 2:]
    return distort(camera, points[..., :2] / np.where(depth > 0.0, depth, np.nan))


def distort(camera: Camera, normalised: ArrayLike) -> Array:
    """Raw pixels of directions: distortion, then the camera matrix.

    normalised : (..., 2) — undistorted normalised coordinates X/Z, Y/Z [-]
    Returns (..., 2) [px].
    """
    undistorted = np.asarray(normalised, dtype=float)
    distorted = np.stack(distort_normalised(undistorted[..., 0], undistorted[..., 1], camera.distortion), axis=-1)
    return distorted @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]


def undistort(camera: Camera, pixels: ArrayLike) -> Array:
    """Directions of raw pixels: the inverse of :func:`distort`, by Newton's method to 1e-12.

    pixels : (..., 2) [px]
    Returns (..., 2) — undistorted normalised coordinates [-]; NaN beyond the radius at which the distortion folds the
    image, where it cannot be inverted.
    """
    matrix, distortion = camera.matrix, camera.distortion
    distorted = (np.asarray(pixels, dtype=float) - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T
    distorted_x, distorted_y = distorted[..., 0], distorted[..., 1]
    x, y = distorted_x, distorted_y
    for _ in range(_MAX_NEWTON_STEPS):
        trial_x, trial_y = distort_normalised(x, y, distortion)
        dx, dy = distorted_x - trial_x, distorted_y - trial_y
        if not np.any(np.abs(dx) + np.abs(dy) > _NEWTON_TOLERANCE):
            break
        xx, xy, yy = distortion_slopes(x, y, distortion)
        determinant = xx * yy - xy * xy
        determinant = np.where(determinant > 0.0, determinant, np.nan)
        x, y = x + (yy * dx - xy * dy) / determinant, y + (xx * dy - xy * dx) / determinant
    diverged = np.abs(dx) + np.abs(dy) > 10.0 * _NEWTON_TOLERANCE
    return np.where(diverged[..., None], np.nan, np.stack([x, y], axis=-1))


def distort_normalised(x: _Number, y: _Number, distortion: Array) -> tuple[_Number, _Number]:
    """Distorted normalised coordinates (x', y') of undistorted ones, for numbers and arrays."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (distortion[0] + r2 * (distortion[1] + r2 * distortion[4]))
    cross = 2.0 * x * y
    distorted_x = x * radial + distortion[2] * cross + distortion[3] * (r2 + 2.0 * x * x)
    distorted_y = y * radial + distortion[2] * (r2 + 2.0 * y * y) + distortion[3] * cross
    return distorted_x, distorted_y


def distortion_slopes(x: _Number, y: _Number, distortion: Array) -> tuple[_Number, _Number, _Number]:
    """∂x'/∂x, ∂x'/∂y = ∂y'/∂x and ∂y'/∂y of :func:`distort_normalised`."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (distortion[0] + r2 * (distortion[1] + r2 * distortion[4]))
    slope = 2.0 * (distortion[0] + r2 * (2.0 * distortion[1] + r2 * 3.0 * distortion[4]))
    p1, p2 = distortion[2], distortion[3]
    xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    xy = x * y * slope + 2.0 * (p1 * x + p2 * y)
    yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return xx, xy, yy


def rotation_matrix(vector: ArrayLike) -> Array:
    """Rotation (3, 3) about a vector (3,) by its length [rad] (Rodrigues)."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=float).reshape(3))[0], dtype=float)


def rotation_vector(matrix: ArrayLike) -> Array:
    """Axis (3,) of a rotation (3, 3), its length the angle [rad]: the inverse of :func:`rotation_matrix`."""
    rotation = np.asarray(matrix, dtype=float)
    antisymmetric = 0.5 * np.array(
        [rotation[2, 1] - rotation[1, 2], rotation[0, 2] - rotation[2, 0], rotation[1, 0] - rotation[0, 1]]
    )
    if np.trace(rotation) > 1.0 and np.linalg.norm(antisymmetric) < _MAX_SMALL_SINE:  # where cv2.Rodrigues returns zero
        return antisymmetric
    return np.asarray(cv2.Rodrigues(rotation)[0], dtype=float).reshape(3)


def rotation_angle_deg(rotation: ArrayLike, other: ArrayLike | None = None) -> float:
    """Angle of a rotation (3, 3), or between two [deg].

    From ‖R − I‖_F = 2√2 sin(θ/2), which is accurate at small angles, where the trace is not.
    """
    chord = np.linalg.norm(np.asarray(rotation) - (np.eye(3) if other is None else np.asarray(other)))
    return float(np.degrees(2.0 * np.arcsin(min(1.0, chord / np.sqrt(8.0)))))
