"""The camera: from points in space to pixels of a photograph, and back to rays.

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
    "bend",
    "bend_slopes",
    "camera_matrix",
    "distort",
    "project",
    "rotation_angle_deg",
    "rotation_matrix",
    "rotation_vector",
    "to_right",
    "undistort",
]

_Number = TypeVar("_Number", float, Array)

_NEWTON_STEPS = 40
_NEWTON_TOLERANCE = 1e-13


class Camera(NamedTuple):
    """What one camera does to light, whatever its place.

    matrix : (3, 3) — focal lengths, principal point and skew [px]
    distortion : (5,) — k1, k2, p1, p2, k3 [-]
    size : (width, height) of its photographs [px]
    """

    matrix: Array
    distortion: Array
    size: tuple[int, int]


class Rig(NamedTuple):
    """Two cameras on one frame; a point X0 seen from the left one is X1 = rotation @ X0 + translation from the right.

    rotation : (3, 3)
    translation : (3,) [mm]
    """

    left: Camera
    right: Camera
    rotation: Array
    translation: Array


def camera_matrix(focal_px: float, centre: ArrayLike) -> Array:
    """Matrix of a camera with square pixels.

    focal_px : focal length [px]
    centre : (2,) — principal point (x, y) [px]
    """
    x, y = np.asarray(centre, dtype=float)
    return np.array([[focal_px, 0.0, x], [0.0, focal_px, y], [0.0, 0.0, 1.0]])


def to_right(rig: Rig, points: ArrayLike) -> Array:
    """Carry points (..., 3) [mm] from the left camera's frame into the right one's."""
    return np.asarray(points, dtype=float) @ rig.rotation.T + rig.translation


def project(camera: Camera, points: ArrayLike) -> Array:
    """Image points in raw pixels of the photograph.

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
    ideal = np.asarray(normalised, dtype=float)
    bent = np.stack(bend(ideal[..., 0], ideal[..., 1], camera.distortion), axis=-1)
    return bent @ camera.matrix[:2, :2].T + camera.matrix[:2, 2]


def undistort(camera: Camera, pixels: ArrayLike) -> Array:
    """Directions of raw pixels: the inverse of :func:`distort`, by Newton's method to 1e-12.

    pixels : (..., 2) [px]
    Returns (..., 2) — undistorted normalised coordinates [-]; NaN where the distortion has no inverse, beyond the
    radius at which it folds the image back.
    """
    matrix, distortion = camera.matrix, camera.distortion
    bent = (np.asarray(pixels, dtype=float) - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T
    bent_x, bent_y = bent[..., 0], bent[..., 1]
    x, y = bent_x, bent_y
    for _ in range(_NEWTON_STEPS):
        at_x, at_y = bend(x, y, distortion)
        dx, dy = bent_x - at_x, bent_y - at_y
        if not np.any(np.abs(dx) + np.abs(dy) > _NEWTON_TOLERANCE):
            break
        xx, xy, yy = bend_slopes(x, y, distortion)
        determinant = xx * yy - xy * xy
        determinant = np.where(determinant > 0.0, determinant, np.nan)
        x, y = x + (yy * dx - xy * dy) / determinant, y + (xx * dy - xy * dx) / determinant
    missed = np.abs(dx) + np.abs(dy) > 10.0 * _NEWTON_TOLERANCE
    return np.where(missed[..., None], np.nan, np.stack([x, y], axis=-1))


def bend(x: _Number, y: _Number, distortion: Array) -> tuple[_Number, _Number]:
    """Distorted normalised coordinates (x', y') of undistorted ones: plain arithmetic, for numbers and arrays alike."""
    r2 = x * x + y * y
    radial = 1.0 + r2 * (distortion[0] + r2 * (distortion[1] + r2 * distortion[4]))
    cross = 2.0 * x * y
    bent_x = x * radial + distortion[2] * cross + distortion[3] * (r2 + 2.0 * x * x)
    bent_y = y * radial + distortion[2] * (r2 + 2.0 * y * y) + distortion[3] * cross
    return bent_x, bent_y


def bend_slopes(x: _Number, y: _Number, distortion: Array) -> tuple[_Number, _Number, _Number]:
    """∂x'/∂x, ∂x'/∂y = ∂y'/∂x and ∂y'/∂y of :func:`bend`."""
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


_SMALL_RAD = 1e-4


def rotation_vector(matrix: ArrayLike) -> Array:
    """Axis (3,) of a rotation (3, 3), its length the angle [rad]: the inverse of :func:`rotation_matrix`."""
    turn = np.asarray(matrix, dtype=float)
    odd = 0.5 * np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    if np.trace(turn) > 1.0 and np.linalg.norm(odd) < _SMALL_RAD:  # where the general formula gives zero
        return odd
    return np.asarray(cv2.Rodrigues(turn)[0], dtype=float).reshape(3)


def rotation_angle_deg(rotation: ArrayLike, other: ArrayLike | None = None) -> float:
    """Angle of a rotation (3, 3), or between two [deg].

    From the chord, ‖R − I‖_F = 2√2 sin(θ/2), which keeps its digits at small angles, where the trace loses them.
    """
    chord = np.linalg.norm(np.asarray(rotation) - (np.eye(3) if other is None else np.asarray(other)))
    return float(np.degrees(2.0 * np.arcsin(min(1.0, chord / np.sqrt(8.0)))))
