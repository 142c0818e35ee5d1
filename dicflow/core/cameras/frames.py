"""Frames in which results are given: the left camera's, the specimen's best plane, or what the user says."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array

__all__ = ["CAMERA", "Frame", "axes_frame", "into_frame", "plane_frame", "three_point_frame", "within"]


_PARALLEL = 1e-6


class Frame(NamedTuple):
    """A right-handed frame, x = rotation @ (X − origin) for X in the left camera's frame.

    rotation : (3, 3) — the axes in rows
    origin : (3,) [mm]
    """

    rotation: Array
    origin: Array


CAMERA = Frame(np.eye(3), np.zeros(3))
"""The left camera's: X right, Y down, Z away."""


def into_frame(points: ArrayLike, frame: Frame) -> Array:
    """Points (..., 3) of the left camera's frame in another one [mm]."""
    return np.asarray((np.asarray(points, dtype=np.float64) - frame.origin) @ frame.rotation.T)


def within(inner: Frame, outer: Frame) -> Frame:
    """A frame that is given in another one, in the left camera's."""
    return Frame(inner.rotation @ outer.rotation, outer.origin + inner.origin @ outer.rotation)


def plane_frame(points: ArrayLike) -> Frame:
    """The frame of the plane that lies best (least squares) among points (..., 3) [mm].

    Z is its normal, away from the camera; X the camera's X projected on it; Y points down as Z × X does. The origin is
    the points' mean. NaN does not count.

    Raises ValueError where they are fewer than three, or on one line, or in a plane that the camera's X is normal to.
    """
    flat = np.asarray(points, dtype=np.float64).reshape(-1, 3)
    flat = flat[np.isfinite(flat).all(axis=1)]
    if len(flat) < 3:
        raise ValueError(f"a plane needs three points, found {len(flat)}")
    origin = flat.mean(axis=0)
    _, strengths, directions = np.linalg.svd(flat - origin, full_matrices=False)
    if strengths[1] <= _PARALLEL * strengths[0]:
        raise ValueError("a plane needs points that do not lie on one line")
    normal = directions[2] * (1.0 if directions[2] @ origin > 0.0 else -1.0)
    down = np.cross(normal, [1.0, 0.0, 0.0])
    return axes_frame(np.cross(down, normal), down, origin)


def three_point_frame(origin: ArrayLike, on_x: ArrayLike, beside: ArrayLike) -> Frame:
    """The frame of three points (3,) [mm]: X runs from the first to the second, Y towards the side of the third.

    Raises ValueError where they lie on one line.
    """
    start = np.asarray(origin, dtype=np.float64)
    return axes_frame(np.asarray(on_x, dtype=np.float64) - start, np.asarray(beside, dtype=np.float64) - start, start)


def axes_frame(x_axis: ArrayLike, y_side: ArrayLike, origin: ArrayLike = (0.0, 0.0, 0.0)) -> Frame:
    """The frame with the plane of two directions (3,) as its X-Y plane, Y on the side of the second; Z = X × Y.

    Raises ValueError where they are parallel.
    """
    x, y = np.asarray(x_axis, dtype=np.float64), np.asarray(y_side, dtype=np.float64)
    normal = np.cross(x, y)
    if np.linalg.norm(normal) <= _PARALLEL * np.linalg.norm(x) * np.linalg.norm(y):
        raise ValueError("the axes of a frame need two directions that are not parallel")
    normal, x = normal / np.linalg.norm(normal), x / np.linalg.norm(x)
    return Frame(np.stack([x, np.cross(normal, x), normal]), np.asarray(origin, dtype=np.float64))
