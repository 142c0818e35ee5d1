"""The camera: from points in space to pixels of a photograph, and back to rays.

A pinhole with the distortion of Brown (1971), five coefficients (k1, k2, p1, p2, k3) in the order that OpenCV and
MATLAB's toolboxes use. With x = X/Z, y = Y/Z and r² = x² + y²::

    x' = x (1 + k1 r² + k2 r⁴ + k3 r⁶) + 2 p1 x y + p2 (r² + 2 x²)
    y' = y (1 + k1 r² + k2 r⁴ + k3 r⁶) + p1 (r² + 2 y²) + 2 p2 x y
    (u, v, 1) = matrix @ (x', y', 1)
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = [
    "Camera",
    "Rig",
    "camera_matrix",
    "distort",
    "project",
    "rotation_angle_deg",
    "rotation_matrix",
    "rotation_vector",
    "to_right",
    "undistort",
]

Array = NDArray[np.float64]

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
    matrix = camera.matrix
    return _bend(ideal, camera.distortion) @ matrix[:2, :2].T + matrix[:2, 2]


def undistort(camera: Camera, pixels: ArrayLike) -> Array:
    """Directions of raw pixels: the inverse of :func:`distort`, by Newton's method to 1e-12.

    pixels : (..., 2) [px]
    Returns (..., 2) — undistorted normalised coordinates [-]; NaN where the distortion has no inverse, beyond the
    radius at which it folds the image back.
    """
    matrix = camera.matrix
    bent = (np.asarray(pixels, dtype=float) - matrix[:2, 2]) @ np.linalg.inv(matrix[:2, :2]).T
    ideal = bent.copy()
    for _ in range(_NEWTON_STEPS):
        residual = bent - _bend(ideal, camera.distortion)
        xx, xy, yy = _bend_slopes(ideal, camera.distortion)
        determinant = xx * yy - xy * xy
        determinant = np.where(determinant > 0.0, determinant, np.nan)
        x, y = residual[..., 0], residual[..., 1]
        ideal = ideal + np.stack([yy * x - xy * y, xx * y - xy * x], axis=-1) / determinant[..., None]
        if not np.any(np.abs(residual) > _NEWTON_TOLERANCE):
            break
    missed = np.abs(bent - _bend(ideal, camera.distortion)) > 10.0 * _NEWTON_TOLERANCE
    return np.where(missed.any(axis=-1, keepdims=True), np.nan, ideal)


def _bend(ideal: Array, distortion: Array) -> Array:
    """Distorted normalised coordinates (..., 2) of undistorted ones."""
    k1, k2, p1, p2, k3 = distortion
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    cross = 2.0 * x * y
    return np.stack(
        [x * radial + p1 * cross + p2 * (r2 + 2.0 * x * x), y * radial + p1 * (r2 + 2.0 * y * y) + p2 * cross], axis=-1
    )


def _bend_slopes(ideal: Array, distortion: Array) -> tuple[Array, Array, Array]:
    """∂x'/∂x, ∂x'/∂y = ∂y'/∂x and ∂y'/∂y of the distortion, each (...)."""
    k1, k2, p1, p2, k3 = distortion
    x, y = ideal[..., 0], ideal[..., 1]
    r2 = x * x + y * y
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2.0 * (k1 + r2 * (2.0 * k2 + r2 * 3.0 * k3))
    xx = radial + x * x * slope + 2.0 * p1 * y + 6.0 * p2 * x
    xy = x * y * slope + 2.0 * (p1 * x + p2 * y)
    yy = radial + y * y * slope + 6.0 * p1 * y + 2.0 * p2 * x
    return xx, xy, yy


def rotation_matrix(vector: ArrayLike) -> Array:
    """Rotation (3, 3) about a vector (3,) by its length [rad] (Rodrigues)."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector, dtype=float).reshape(3))[0], dtype=float)


def rotation_vector(matrix: ArrayLike) -> Array:
    """Axis (3,) of a rotation (3, 3), its length the angle [rad]: the inverse of :func:`rotation_matrix`."""
    return np.asarray(cv2.Rodrigues(np.asarray(matrix, dtype=float))[0], dtype=float).reshape(3)


def rotation_angle_deg(rotation: ArrayLike, other: ArrayLike | None = None) -> float:
    """Angle of a rotation (3, 3), or between two [deg].

    From the chord, ‖R − I‖_F = 2√2 sin(θ/2), which keeps its digits at small angles, where the trace loses them.
    """
    chord = np.linalg.norm(np.asarray(rotation) - (np.eye(3) if other is None else np.asarray(other)))
    return float(np.degrees(2.0 * np.arcsin(min(1.0, chord / np.sqrt(8.0)))))
