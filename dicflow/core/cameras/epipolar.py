"""Epipolar geometry: the line in the right photograph on which a point of the left one must lie, and the reverse.

With x0, x1 normalised coordinates of one point in both cameras, x1ᵀ E x0 = 0 where E = [T]× R; in pixels free of
distortion, p1ᵀ F p0 = 0 where F = K1⁻ᵀ E K0⁻¹ (Hartley and Zisserman 2004, ch. 9).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Camera, Rig, distortion_slopes, homogeneous, undistort

__all__ = [
    "cross_matrix",
    "epipolar_distance",
    "epipolar_slopes",
    "essential_matrix",
    "fundamental_matrix",
    "signed_epipolar_distance",
]


def essential_matrix(rig: Rig) -> Array:
    """E = [T]× R (3, 3), for normalised coordinates."""
    return cross_matrix(rig.translation) @ rig.rotation


def cross_matrix(vector: ArrayLike) -> Array:
    """[v]× (3, 3) of a vector v (3,), with [v]× w = v × w."""
    x, y, z = np.asarray(vector, dtype=float)
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def fundamental_matrix(rig: Rig) -> Array:
    """F (3, 3), for pixels free of distortion."""
    return np.asarray(np.linalg.inv(rig.right.matrix).T @ essential_matrix(rig) @ np.linalg.inv(rig.left.matrix))


def epipolar_distance(rig: Rig, left: ArrayLike, right: ArrayLike) -> Array:
    """Mean distance of two matched points from each other's epipolar line, after removal of the distortion.

    left, right : (..., 2) — raw pixels
    Returns (...) [px].
    """
    return np.abs(signed_epipolar_distance(rig, left, right))


def signed_epipolar_distance(rig: Rig, left: ArrayLike, right: ArrayLike) -> Array:
    """The same with the sign of x1ᵀ E x0, which changes from one side of the lines to the other."""
    pixels_left, pixels_right = _undistorted_pixels(rig.left, left), _undistorted_pixels(rig.right, right)
    fundamental = fundamental_matrix(rig)
    lines_right, lines_left = pixels_left @ fundamental.T, pixels_right @ fundamental
    product = np.sum(pixels_right * lines_right, axis=-1)
    return np.asarray(0.5 * product * (1.0 / _normal_lengths(lines_left) + 1.0 / _normal_lengths(lines_right)))


def epipolar_slopes(rig: Rig, left: ArrayLike, right: ArrayLike) -> tuple[Array, Array]:
    """Derivatives of the signed distance of matched points by their places in both photographs.

    left, right : (..., 2) — raw pixels
    Returns two arrays (..., 2) [-]. At a point on its line the derivative of x1ᵀ E x0 is all of it; the part that the
    lines' own turn adds is as much smaller as the distance is than the focal length.
    """
    directions = undistort(rig.left, left), undistort(rig.right, right)
    fundamental = fundamental_matrix(rig)
    pixels_left = homogeneous(directions[0]) @ rig.left.matrix.T
    pixels_right = homogeneous(directions[1]) @ rig.right.matrix.T
    lines_right, lines_left = pixels_left @ fundamental.T, pixels_right @ fundamental
    weights = 0.5 * (1.0 / _normal_lengths(lines_left) + 1.0 / _normal_lengths(lines_right))[..., None]
    return (
        _by_raw_pixels(rig.left, directions[0], weights * lines_left[..., :2]),
        _by_raw_pixels(rig.right, directions[1], weights * lines_right[..., :2]),
    )


def _by_raw_pixels(camera: Camera, directions: Array, slopes: Array) -> Array:
    """Derivatives (..., 2) by raw pixels, of those by pixels free of distortion."""
    scale = camera.matrix[:2, :2]
    x, y = np.moveaxis(slopes @ scale, -1, 0)
    xx, xy, yy = distortion_slopes(directions[..., 0], directions[..., 1], camera.distortion)
    by_distorted = np.stack([yy * x - xy * y, xx * y - xy * x], axis=-1) / (xx * yy - xy * xy)[..., None]
    return np.asarray(by_distorted @ np.linalg.inv(scale))


def _undistorted_pixels(camera: Camera, pixels: ArrayLike) -> Array:
    """Homogeneous pixels (..., 3) of a camera with the same matrix and no distortion."""
    return homogeneous(undistort(camera, pixels)) @ camera.matrix.T


def _normal_lengths(lines: Array) -> Array:
    """Lengths (...) of the normals of homogeneous lines (..., 3)."""
    return np.hypot(lines[..., 0], lines[..., 1])
