"""Exact material points of pixels.

The material point on the ray of a pixel is found by Newton's method on the camera's image of the deformed surface,
started at the point of the neighbouring pixel. Its slopes map the pixel's square to the material.
"""

from __future__ import annotations

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Camera, distort_normalised, distortion_slopes, project
from dicflow.core.kernels import KERNEL
from dicflow.core.synthetic.deformation import Deformation, position, surface_kernel, tangents_kernel

__all__ = ["Box", "image_of", "material_at", "trace"]

Box = tuple[int, int, int, int]
"""Pixels x0 ≤ x < x1, y0 ≤ y < y1."""

_NEWTON_STEPS = 12
_NEWTON_TOLERANCE_PX = 1e-9

_distort_kernel = njit(nogil=True)(distort_normalised)
_distortion_slopes_kernel = njit(nogil=True)(distortion_slopes)


def image_of(camera: Camera, deformation: Deformation, material: ArrayLike) -> Array:
    """Raw pixels (..., 2) [px] of material points (..., 2) [mm] in a camera."""
    return project(camera, position(deformation, material))


def material_at(camera: Camera, deformation: Deformation, pixels: ArrayLike, start: ArrayLike = (0.0, 0.0)) -> Array:
    """Material points (..., 2) [mm] at raw pixels (..., 2) of a camera: the inverse of :func:`image_of`.

    start : a material point at which the search begins [mm]
    Returns NaN where the search does not converge, as for a ray that misses the surface.
    """
    pixels = np.asarray(pixels, dtype=float)
    found = _trace_pixels(pixels.reshape(-1, 2), camera, deformation, np.array(start, dtype=float))[0]
    return np.asarray(found).reshape(pixels.shape)


def trace(camera: Camera, deformation: Deformation, box: Box, start: ArrayLike) -> tuple[Array, Array]:
    """Material at every pixel of a box (x0, y0, x1, y1), ends excluded.

    Returns points (row, col, 2) [mm] and slopes ∂material/∂pixel (row, col, 2, 2) [mm/px]; NaN where a ray misses the
    surface.
    """
    x0, y0, x1, y1 = box
    pixels = np.stack(np.meshgrid(np.arange(x0, x1), np.arange(y0, y1)), axis=-1).astype(float)
    pixels[1::2] = pixels[1::2, ::-1].copy()
    points, slopes = _trace_pixels(pixels.reshape(-1, 2), camera, deformation, np.array(start, dtype=float))
    points, slopes = points.reshape(y1 - y0, x1 - x0, 2), slopes.reshape(y1 - y0, x1 - x0, 2, 2)
    points[1::2], slopes[1::2] = points[1::2, ::-1].copy(), slopes[1::2, ::-1].copy()
    return points, slopes


@njit(**KERNEL)
def _image_and_slopes(
    camera: Camera, deformation: Deformation, x: float, y: float
) -> tuple[float, float, float, float, float, float]:
    """Pixel u, v of a material point and ∂u/∂X, ∂u/∂Y, ∂v/∂X, ∂v/∂Y; u is NaN behind the camera."""
    rotation, shift = deformation.rotation, deformation.translation
    px, py, pz = surface_kernel(deformation, x, y)
    x_x, x_y, y_y, z_x, z_y = tangents_kernel(deformation, x, y)
    depth = rotation[2, 0] * px + rotation[2, 1] * py + rotation[2, 2] * pz + shift[2]
    if depth <= 0.0:
        return np.nan, np.nan, 1.0, 0.0, 0.0, 1.0
    a = (rotation[0, 0] * px + rotation[0, 1] * py + rotation[0, 2] * pz + shift[0]) / depth
    b = (rotation[1, 0] * px + rotation[1, 1] * py + rotation[1, 2] * pz + shift[1]) / depth
    depth_x = rotation[2, 0] * x_x + rotation[2, 2] * z_x
    depth_y = rotation[2, 0] * x_y + rotation[2, 1] * y_y + rotation[2, 2] * z_y
    a_x = (rotation[0, 0] * x_x + rotation[0, 2] * z_x - a * depth_x) / depth
    a_y = (rotation[0, 0] * x_y + rotation[0, 1] * y_y + rotation[0, 2] * z_y - a * depth_y) / depth
    b_x = (rotation[1, 0] * x_x + rotation[1, 2] * z_x - b * depth_x) / depth
    b_y = (rotation[1, 0] * x_y + rotation[1, 1] * y_y + rotation[1, 2] * z_y - b * depth_y) / depth
    bent_a, bent_b = _distort_kernel(a, b, camera.distortion)
    aa, ab, bb = _distortion_slopes_kernel(a, b, camera.distortion)
    fx, skew, fy = camera.matrix[0, 0], camera.matrix[0, 1], camera.matrix[1, 1]
    u = fx * bent_a + skew * bent_b + camera.matrix[0, 2]
    v = fy * bent_b + camera.matrix[1, 2]
    u_a, u_b = fx * aa + skew * ab, fx * ab + skew * bb
    v_a, v_b = fy * ab, fy * bb
    return u, v, u_a * a_x + u_b * b_x, u_a * a_y + u_b * b_y, v_a * a_x + v_b * b_x, v_a * a_y + v_b * b_y


@njit(**KERNEL)
def _trace_pixels(pixels: Array, camera: Camera, deformation: Deformation, start: Array) -> tuple[Array, Array]:
    """Material points (n, 2) and slopes (n, 2, 2) at pixels (n, 2).

    Each search starts at the point that the last point and slopes predict. Where a search does not converge, the
    result is NaN and the next search begins at ``start``.
    """
    points = np.full(pixels.shape, np.nan)
    slopes = np.full((len(pixels), 2, 2), np.nan)
    x, y, at = start[0], start[1], -1
    for i in range(len(pixels)):
        if at >= 0:
            du, dv = pixels[i, 0] - pixels[at, 0], pixels[i, 1] - pixels[at, 1]
            x = points[at, 0] + slopes[at, 0, 0] * du + slopes[at, 0, 1] * dv
            y = points[at, 1] + slopes[at, 1, 0] * du + slopes[at, 1, 1] * dv
        else:
            x, y = start[0], start[1]
        at = -1
        for _ in range(_NEWTON_STEPS):
            u, v, u_x, u_y, v_x, v_y = _image_and_slopes(camera, deformation, x, y)
            determinant = u_x * v_y - u_y * v_x
            du, dv = pixels[i, 0] - u, pixels[i, 1] - v
            x_u, x_v, y_u, y_v = v_y / determinant, -u_y / determinant, -v_x / determinant, u_x / determinant
            x += x_u * du + x_v * dv
            y += y_u * du + y_v * dv
            if abs(du) + abs(dv) < _NEWTON_TOLERANCE_PX:
                points[i, 0], points[i, 1] = x, y
                slopes[i, 0, 0], slopes[i, 0, 1], slopes[i, 1, 0], slopes[i, 1, 1] = x_u, x_v, y_u, y_v
                at = i
                break
    return points, slopes
