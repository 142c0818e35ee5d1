"""A flat sheet that is deformed in its plane as computed at the nodes of a lattice, and its material at pixels.

Material points (X, Y) [mm] are those of :mod:`dicflow.core.synthetic.deformation`: X across the sheet, 0 at its middle;
Y along it, 0 at the upper edge. Between the nodes, displacements are cubic splines.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike
from scipy.ndimage import spline_filter

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Camera, project
from dicflow.core.kernels import KERNEL
from dicflow.core.synthetic.deformation import Deformation, moved_rigidly, position
from dicflow.core.synthetic.trace import Box, trace

__all__ = ["Sheet", "displaced", "image_of_sheet", "place_of", "sheet_between", "trace_sheet"]

_MARGIN = 4
"""Nodes by which the lattice is continued beyond the sheet, quadratically."""
_ROUNDS, _TOLERANCE_MM = 40, 1e-10


class Sheet(NamedTuple):
    """A deformed state of a sheet.

    coefficients : (row, col, 2) — of the cubic B-splines of the displacement, with the margin [mm]
    origin, spacing : (2,) — X and Y of the first coefficient, distance of the nodes [mm]
    length, pull : of the sheet at rest, and how much longer it is [mm]
    pose : the flat sheet at rest, in a camera's frame
    """

    coefficients: Array
    origin: Array
    spacing: Array
    length: float
    pull: float
    pose: Deformation

    def moved_rigidly(self, rotation: ArrayLike, translation: ArrayLike) -> Sheet:
        """The same state in a frame with that relation, p → rotation @ p + translation."""
        return self._replace(pose=moved_rigidly(self.pose, rotation, translation))


def sheet_between(size: tuple[float, float], moved: Array, pose: Deformation) -> Sheet:
    """A sheet whose nodes are moved by (row, col, 2) [mm]; they lie evenly from edge to edge.

    size : width and length at rest [mm]
    """
    width, length = size
    spacing = np.array([width, length]) / (np.array(moved.shape[1::-1]) - 1)
    wide = moved
    for axis in (0, 1):
        for _ in range(_MARGIN):
            wide = _continued(wide, axis)
    coefficients = np.stack([spline_filter(wide[..., k], order=3, mode="mirror") for k in (0, 1)], axis=-1)
    origin = np.array([-width / 2.0, 0.0]) - _MARGIN * spacing
    return Sheet(coefficients, origin, spacing, length, float(moved[-1, :, 1].mean()), pose)


def _continued(values: Array, axis: int) -> Array:
    """Values with one more node at both ends of an axis, on the parabola through the last three."""
    lines = np.moveaxis(values, axis, 0)
    ends = [3.0 * a - 3.0 * b + c for a, b, c in (lines[:3], lines[:-4:-1])]
    return np.moveaxis(np.concatenate([ends[0][None], lines, ends[1][None]]), 0, axis)


def displaced(sheet: Sheet, material: ArrayLike) -> tuple[Array, Array]:
    """Places (..., 2) in the plane of material points (..., 2) [mm], and the deformation gradient there (..., 2, 2)."""
    points = np.asarray(material, dtype=float)
    values = _all_displaced(points.reshape(-1, 2), sheet.coefficients, sheet.origin, sheet.spacing)
    return values[:, :2].reshape(points.shape), values[:, 2:].reshape(*points.shape, 2)


def place_of(sheet: Sheet, material: ArrayLike) -> Array:
    """Positions (..., 3) [mm] of material points (..., 2) in the camera's frame."""
    return position(sheet.pose, displaced(sheet, material)[0])


def image_of_sheet(camera: Camera, sheet: Sheet, material: ArrayLike) -> Array:
    """Raw pixels (..., 2) [px] of material points (..., 2) in a camera."""
    return project(camera, place_of(sheet, material))


def trace_sheet(camera: Camera, sheet: Sheet, box: Box) -> tuple[Array, Array]:
    """Material at every pixel of a box, and its slopes, as :func:`dicflow.core.synthetic.trace.trace`."""
    plane, slopes = trace(camera, sheet.pose, box, (0.0, (sheet.length + sheet.pull) / 2.0))
    shape = plane.shape
    points, gradients = _all_found(
        plane.reshape(-1, 2),
        sheet.coefficients,
        sheet.origin,
        sheet.spacing,
        sheet.length / (sheet.length + sheet.pull),
    )
    inverse = np.full((*shape, 2), np.nan)
    known = np.isfinite(points[:, 0])
    inverse.reshape(-1, 2, 2)[known] = np.linalg.inv(gradients[known])
    return points.reshape(shape), inverse @ slopes


@njit(**KERNEL)
def _weights(t: float) -> tuple[float, float, float, float]:
    """Of four cubic B-splines at t in 0 … 1 between the middle two."""
    s = 1.0 - t
    return s * s * s / 6.0, 2.0 / 3.0 - t * t * (2.0 - t) / 2.0, 2.0 / 3.0 - s * s * (2.0 - s) / 2.0, t * t * t / 6.0


@njit(**KERNEL)
def _slopes(t: float) -> tuple[float, float, float, float]:
    """Derivatives of :func:`_weights`."""
    s = 1.0 - t
    return -s * s / 2.0, t * (3.0 * t - 4.0) / 2.0, s * (4.0 - 3.0 * s) / 2.0, t * t / 2.0


@njit(**KERNEL)
def _displaced(
    coefficients: Array, origin: Array, spacing: Array, x: float, y: float
) -> tuple[float, float, float, float, float, float]:
    """Place of a material point and ∂x/∂X, ∂x/∂Y, ∂y/∂X, ∂y/∂Y; beyond the lattice displacements go on straight."""
    rows, cols = coefficients.shape[:2]
    u, v = (x - origin[0]) / spacing[0], (y - origin[1]) / spacing[1]
    near_u, near_v = min(max(u, 1.0), cols - 2.001), min(max(v, 1.0), rows - 2.001)
    j, i = int(near_u), int(near_v)
    wx, wy, sx, sy = _weights(near_u - j), _weights(near_v - i), _slopes(near_u - j), _slopes(near_v - i)
    d = np.zeros(2)
    dx = np.zeros(2)
    dy = np.zeros(2)
    for m in range(4):
        for n in range(4):
            for k in range(2):
                value = coefficients[i - 1 + m, j - 1 + n, k]
                d[k] += wy[m] * wx[n] * value
                dx[k] += wy[m] * sx[n] * value
                dy[k] += sy[m] * wx[n] * value
    px = x + d[0] + dx[0] * (u - near_u) + dy[0] * (v - near_v)
    py = y + d[1] + dx[1] * (u - near_u) + dy[1] * (v - near_v)
    return px, py, 1.0 + dx[0] / spacing[0], dy[0] / spacing[1], dx[1] / spacing[0], 1.0 + dy[1] / spacing[1]


@njit(**KERNEL)
def _all_displaced(points: Array, coefficients: Array, origin: Array, spacing: Array) -> Array:
    """Places and gradients (n, 6) of material points (n, 2)."""
    found = np.empty((len(points), 6))
    for k in range(len(points)):
        found[k] = _displaced(coefficients, origin, spacing, points[k, 0], points[k, 1])
    return found


@njit(**KERNEL)
def _all_found(places: Array, coefficients: Array, origin: Array, spacing: Array, shrink: float) -> tuple[Array, Array]:
    """Material points (n, 2) and gradients (n, 2, 2) at places (n, 2) in the plane, by Newton's method; NaN if lost.

    shrink : length at rest over the present one, for the first guess
    """
    points, gradients = np.full(places.shape, np.nan), np.full((len(places), 2, 2), np.nan)
    x, y, is_near = 0.0, 0.0, False
    for k in range(len(places)):
        if not is_near:
            x, y = places[k, 0], places[k, 1] * shrink
        is_near = False
        for _ in range(_ROUNDS):
            px, py, xx, xy, yx, yy = _displaced(coefficients, origin, spacing, x, y)
            du, dv = places[k, 0] - px, places[k, 1] - py
            if abs(du) + abs(dv) < _TOLERANCE_MM:
                points[k, 0], points[k, 1] = x, y
                gradients[k, 0, 0], gradients[k, 0, 1], gradients[k, 1, 0], gradients[k, 1, 1] = xx, xy, yx, yy
                is_near = True
                break
            determinant = xx * yy - xy * yx
            x += (yy * du - xy * dv) / determinant
            y += (xx * dv - yx * du) / determinant
    return points, gradients
