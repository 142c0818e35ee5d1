"""Stereo rectification: photographs with aligned rows, and points in space from disparities.

Both cameras are turned about their centres until their image planes coincide and the baseline runs along the rows
(Fusiello, Trucco and Verri 2000, "A compact algorithm for rectification of stereo pairs"). A point then has the same y
in both rectified images, and its depth follows from its disparity x_left − x_right.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Grey, Image, Mask
from dicflow.core.cameras.camera import Camera, Rig, distort, homogeneous, undistort

__all__ = [
    "Rectification",
    "covered",
    "photograph_outline",
    "raw_to_rectified",
    "rectification",
    "rectified_to_raw",
    "rectify",
    "rectify_counts",
    "triangulate_disparity",
]


_MAX_ANGLE_DEG = 75.0
_OUTLINE_POINTS_PER_SIDE = 65
_LANCZOS_PX = 8


class Rectification(NamedTuple):
    """The two rectified cameras.

    rotation_left, rotation_right : (3, 3) — from a camera's frame into its rectified one
    matrix_left, matrix_right : (3, 3) — rectified camera matrices; they differ in the principal point's x only [px]
    size : (width, height) of both rectified images [px]
    baseline_mm : x of the right camera's centre in the left rectified frame; negative where it is left of the left one
    """

    rotation_left: Array
    rotation_right: Array
    matrix_left: Array
    matrix_right: Array
    size: tuple[int, int]
    baseline_mm: float


def rectification(rig: Rig) -> Rectification:
    """The rectification of a rig, at the mean scale of the photographs and large enough for all of both.

    Each image has its own principal point, so that disparities are near 0 also where the cameras' axes converge.

    Raises ValueError where a ray of a photograph makes too large an angle with the common optical axis.
    """
    centre = -rig.rotation.T @ rig.translation
    rotation_left = _common_axes(centre, rig.rotation)
    rotation_right = rotation_left @ rig.rotation.T
    focal = float(np.mean([rig.left.matrix[[0, 1], [0, 1]], rig.right.matrix[[0, 1], [0, 1]]]))
    left, right = _extent(rig.left, rotation_left) * focal, _extent(rig.right, rotation_right) * focal
    top, bottom = min(left[0, 1], right[0, 1]), max(left[1, 1], right[1, 1])
    width = max(left[1, 0] - left[0, 0], right[1, 0] - right[0, 0])
    return Rectification(
        rotation_left,
        rotation_right,
        _camera_matrix(focal, -left[0, 0], -top),
        _camera_matrix(focal, -right[0, 0], -top),
        (int(np.ceil(width)) + 1, int(np.ceil(bottom - top)) + 1),
        float(rotation_left[0] @ centre),
    )


def raw_to_rectified(points: ArrayLike, camera: Camera, rotation: Array, matrix: Array) -> Array:
    """Transform raw pixels (..., 2) of a photograph into its rectified image.

    rotation, matrix : (3, 3) — of this camera, from a :class:`Rectification`
    """
    directions = homogeneous(undistort(camera, points)) @ rotation.T
    return np.asarray(directions[..., :2] / directions[..., 2:] @ matrix[:2, :2].T + matrix[:2, 2])


def rectified_to_raw(points: ArrayLike, camera: Camera, rotation: Array, matrix: Array) -> Array:
    """The inverse of :func:`raw_to_rectified`."""
    directions = homogeneous(np.asarray(points, dtype=float)) @ (rotation.T @ np.linalg.inv(matrix)).T
    return distort(camera, directions[..., :2] / directions[..., 2:])


def rectify(
    image: Grey, camera: Camera, rotation: Array, matrix: Array, size: tuple[int, int], *, is_rough: bool = False
) -> Grey:
    """The rectified image of a photograph; 0 outside the photograph.

    Interpolated with the Lanczos kernel of 8 × 8 pixels, whose periodic error in the disparity of fine speckles is
    smaller than that of cubic convolution. Positions are rounded to 1/32 px; the error of that is smaller still.

    image : (rows, cols) uint8, uint16 or float32
    rotation, matrix : (3, 3) — of a :class:`Rectification`
    size : (width, height) [px]
    is_rough : whether linear interpolation is enough, which takes a sixth of the time
    Returns (height, width) of the same type.
    """
    x, y = _places(camera, rotation, matrix, size)
    kernel = cv2.INTER_LINEAR if is_rough else cv2.INTER_LANCZOS4
    return np.asarray(cv2.remap(image, x, y, kernel, borderMode=cv2.BORDER_CONSTANT, borderValue=0))


def covered(camera: Camera, rotation: Array, matrix: Array, size: tuple[int, int]) -> Mask:
    """Which pixels (height, width) of a rectified image show the photograph; parameters as for :func:`rectify`."""
    x, y = _places(camera, rotation, matrix, size)
    width, height = camera.size
    return np.asarray((x >= -0.5) & (x <= width - 0.5) & (y >= -0.5) & (y <= height - 0.5))


def rectify_counts(counts: Mask, camera: Camera, rotation: Array, matrix: Array, size: tuple[int, int]) -> Mask:
    """Which pixels of a rectified image depend on none that does not count; True outside the photograph.

    counts : (rows, cols) bool — False for pixels of the photograph that are not measured
    rotation, matrix, size : as for :func:`rectify`
    Returns (height, width) bool.
    """
    kernel = np.ones((_LANCZOS_PX + 1, _LANCZOS_PX + 1), dtype=np.uint8)
    clean = cv2.erode(counts.astype(np.uint8), kernel, borderType=cv2.BORDER_CONSTANT, borderValue=(1,))
    x, y = _places(camera, rotation, matrix, size)
    return np.asarray(cv2.remap(clean, x, y, cv2.INTER_NEAREST, borderMode=cv2.BORDER_CONSTANT, borderValue=1) > 0)


def _places(camera: Camera, rotation: Array, matrix: Array, size: tuple[int, int]) -> tuple[Image, Image]:
    """x and y of each pixel of a rectified image in the photograph [px]."""
    x, y = cv2.initUndistortRectifyMap(camera.matrix, camera.distortion, rotation, matrix, size, cv2.CV_32FC1)
    focal, skew = camera.matrix[1, 1], camera.matrix[0, 1]
    if skew:  # initUndistortRectifyMap ignores it
        x += (skew / focal) * (y - camera.matrix[1, 2])
    return x, y


def photograph_outline(camera: Camera, rotation: Array, matrix: Array) -> Array:
    """Outline (n, 2) [px] of a photograph in its rectified image."""
    return raw_to_rectified(_border_pixels(camera.size, _OUTLINE_POINTS_PER_SIDE), camera, rotation, matrix)


def triangulate_disparity(xy_left: ArrayLike, disparity: ArrayLike, rectified: Rectification) -> Array:
    """Points in space from their pixels in the rectified left image and their disparities.

    Both rays lie in one plane, so they intersect.

    xy_left : (..., 2) — rectified left pixels
    disparity : (...) — x_left − x_right [px]
    Returns (..., 3) — points in the left camera's (unrectified) frame [mm]; NaN where they would not be in front of it.
    """
    xy = np.asarray(xy_left, dtype=float)
    focal = rectified.matrix_left[0, 0]
    parallax = np.asarray(disparity, dtype=float) - rectified.matrix_left[0, 2] + rectified.matrix_right[0, 2]
    in_front = parallax * np.sign(rectified.baseline_mm) > 0.0
    depth = focal * rectified.baseline_mm / np.where(in_front, parallax, np.nan)
    rotation = rectified.rotation_left
    directions = (xy - rectified.matrix_left[:2, 2]) / focal @ rotation[:2] + rotation[2]
    return np.asarray(directions * depth[..., None])


def _common_axes(centre: Array, rotation: Array) -> Array:
    """The rectified x, y and z axes in the left camera's frame, as rows (3, 3).

    x runs along the baseline, in the direction that keeps the photographs upright; z is the mean of both optical axes,
    made normal to x.

    centre : (3,) — the right camera's, in the left one's frame; rotation : (3, 3) — from the left to the right frame
    """
    along = centre / np.linalg.norm(centre)
    if along[0] + (rotation @ along)[0] < 0.0:
        along = -along
    down = np.cross(np.array([0.0, 0.0, 1.0]) + rotation[2], along)
    down /= np.linalg.norm(down)
    return np.stack([along, down, np.cross(along, down)])


def _extent(camera: Camera, rotation: Array) -> Array:
    """Least and greatest rectified normalised (x, y) over a photograph, (2, 2)."""
    directions = homogeneous(undistort(camera, _border_pixels(camera.size, max(camera.size)))) @ rotation.T
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    if not np.nanmin(directions[:, 2]) > np.cos(np.radians(_MAX_ANGLE_DEG)):
        raise ValueError(
            f"a photograph reaches more than {_MAX_ANGLE_DEG:.0f}° from the optical axis of the rectified cameras; "
            "expected cameras side by side that look at one scene: check the calibration"
        )
    seen = directions[:, :2] / directions[:, 2:]
    return np.stack([np.nanmin(seen, axis=0), np.nanmax(seen, axis=0)])


def _border_pixels(size: tuple[int, int], points: int) -> Array:
    """Pixels (4 · points, 2) along the border of a photograph, once around."""
    width, height = size
    x, y = np.linspace(0.0, width - 1.0, points), np.linspace(0.0, height - 1.0, points)
    sides = ((x, 0.0), (width - 1.0, y), (x[::-1], height - 1.0), (0.0, y[::-1]))
    return np.concatenate([np.stack(np.broadcast_arrays(*side), axis=-1) for side in sides])


def _camera_matrix(focal: float, x: float, y: float) -> Array:
    return np.array([[focal, 0.0, x], [0.0, focal, y], [0.0, 0.0, 1.0]])
