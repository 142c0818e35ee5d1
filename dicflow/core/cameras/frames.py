"""Frames of results: the left camera's, that of the specimen's best plane, or one that the user gives."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array

__all__ = ["LEFT_CAMERA", "Frame", "axes_frame", "compose_frames", "into_frame", "plane_frame", "three_point_frame"]


_MIN_SINE = 1e-6


class Frame(NamedTuple):
    """A right-handed frame, x = rotation @ (X − origin) for X in the left camera's frame.

    rotation : (3, 3) — the axes in rows
    origin : (3,) [mm]
    """

    rotation: Array
    origin: Array


LEFT_CAMERA = Frame(np.eye(3), np.zeros(3))
"""The left camera's: X right, Y down, Z away."""


def into_frame(points: ArrayLike, frame: Frame) -> Array:
    """Transform points (..., 3) [mm] from the left camera's frame into another one."""
    return np.asarray((np.asarray(points, dtype=np.float64) - frame.origin) @ frame.rotation.T)


def compose_frames(inner: Frame, outer: Frame) -> Frame:
    """The frame ``inner``, given relative to the frame ``outer``, as one relative to the left camera's."""
    return Frame(inner.rotation @ outer.rotation, outer.origin + inner.origin @ outer.rotation)


def plane_frame(points: ArrayLike) -> Frame:
    """The frame of the plane that fits points (..., 3) [mm] best by least squares; points with NaN are left out.

    Z is the plane's normal, away from the camera; X is the camera's X projected onto the plane; Y = Z × X points down.
    The origin is the points' mean.

    Raises ValueError for fewer than three points, points on one line, or a plane normal to the camera's X.
    """
    known = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    known = known[np.isfinite(known).all(axis=1)]
    if len(known) < 3:
        raise ValueError(f"a plane needs three points, found {len(known)}")
    origin = known.mean(axis=0)
    _, singular_values, directions = np.linalg.svd(known - origin, full_matrices=False)
    if singular_values[1] <= _MIN_SINE * singular_values[0]:
        raise ValueError("a plane needs points that do not lie on one line")
    normal = directions[2] * (1.0 if directions[2] @ origin > 0.0 else -1.0)
    down = np.cross(normal, [1.0, 0.0, 0.0])
    return axes_frame(np.cross(down, normal), down, origin)


def three_point_frame(origin: ArrayLike, on_x: ArrayLike, beside: ArrayLike) -> Frame:
    """The frame of three points (3,) [mm]: X from ``origin`` to ``on_x``, Y towards the side of ``beside``.

    Raises ValueError for points on one line.
    """
    start = np.asarray(origin, dtype=np.float64)
    return axes_frame(np.asarray(on_x, dtype=np.float64) - start, np.asarray(beside, dtype=np.float64) - start, start)


def axes_frame(x_axis: ArrayLike, y_side: ArrayLike, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Frame:
    """The frame with X along ``x_axis`` (3,), Y normal to it on the side of ``y_side`` (3,), and Z = X × Y.

    Raises ValueError for parallel directions.
    """
    x, y = np.asarray(x_axis, dtype=np.float64), np.asarray(y_side, dtype=np.float64)
    normal = np.cross(x, y)
    if np.linalg.norm(normal) <= _MIN_SINE * np.linalg.norm(x) * np.linalg.norm(y):
        raise ValueError("the x axis and the y side of a frame must not be parallel")
    normal, x = normal / np.linalg.norm(normal), x / np.linalg.norm(x)
    return Frame(np.stack([x, np.cross(normal, x), normal]), np.asarray(origin, dtype=np.float64))
