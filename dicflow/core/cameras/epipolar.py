"""Epipolar geometry: where a point of the left photograph can lie in the right one.

With x0, x1 normalised coordinates of one point in both cameras, x1ᵀ E x0 = 0 where E = [T]× R; in pixels free of
distortion, p1ᵀ F p0 = 0 where F = K1⁻ᵀ E K0⁻¹ (Hartley and Zisserman 2004, ch. 9).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Camera, Rig, undistort

__all__ = ["epipolar_distance", "essential_matrix", "fundamental_matrix"]


def essential_matrix(rig: Rig) -> Array:
    """E = [T]× R (3, 3), for normalised coordinates."""
    x, y, z = rig.translation
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ rig.rotation


def fundamental_matrix(rig: Rig) -> Array:
    """F (3, 3), for pixels free of distortion."""
    return np.asarray(np.linalg.inv(rig.right.matrix).T @ essential_matrix(rig) @ np.linalg.inv(rig.left.matrix))


def epipolar_distance(rig: Rig, left: ArrayLike, right: ArrayLike) -> Array:
    """Mean distance of two matched points from each other's epipolar line, distortion taken out.

    left, right : (..., 2) — raw pixels
    Returns (...) [px].
    """
    ideal_left, ideal_right = _ideal(rig.left, left), _ideal(rig.right, right)
    fundamental = fundamental_matrix(rig)
    lines_right, lines_left = ideal_left @ fundamental.T, ideal_right @ fundamental
    product = np.abs(np.sum(ideal_right * lines_right, axis=-1))
    return np.asarray(0.5 * product * (1.0 / _normal(lines_left) + 1.0 / _normal(lines_right)))


def _ideal(camera: Camera, pixels: ArrayLike) -> Array:
    """Homogeneous pixels (..., 3) of a camera with the same matrix and no distortion."""
    directions = undistort(camera, pixels)
    return np.concatenate([directions, np.ones((*directions.shape[:-1], 1))], axis=-1) @ camera.matrix.T


def _normal(lines: Array) -> Array:
    """Length of the normal of lines (..., 3)."""
    return np.hypot(lines[..., 0], lines[..., 1])
