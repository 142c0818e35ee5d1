"""Whether matched points fit a rig as given, or only with left and right photographs exchanged.

Exchanged photographs show in one of two ways. With parallel optical axes all disparities change their sign, and the
triangulated points lie behind the cameras. With axes that meet at the specimen the disparities stay near zero, but the
points are far from their epipolar lines.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Rig, homogeneous, undistort
from dicflow.core.cameras.epipolar import epipolar_distance

__all__ = ["OrderCheck", "check_order", "distance_and_share_in_front", "ray_depths"]


_MIN_SHARE_IN_FRONT = 0.5
"""Share of points in front of both cameras above which an order of the photographs is possible."""
_MIN_DISTANCE_RATIO = 3.0
_MAX_NOISE_PX = 0.3
"""A possible order is wrong where its epipolar distance exceeds that of the other order times the ratio, and noise."""
_MAX_FITTING_PX = 1.0


class OrderCheck(NamedTuple):
    """How well matched points fit the rig as given, and with left and right exchanged.

    swapped : whether only the exchanged order fits
    epipolar_px, exchanged_epipolar_px : median distance from the epipolar lines [px]
    in_front, exchanged_in_front : share of the points in front of both cameras
    points : number of points that were checked
    """

    swapped: bool
    epipolar_px: float
    exchanged_epipolar_px: float
    in_front: float
    exchanged_in_front: float
    points: int

    @property
    def text(self) -> str:
        """The result as a sentence."""
        fits = (
            f"in the given order, {self.points} points lie {self.epipolar_px:.2g} px from their epipolar lines and "
            f"{self.in_front:.0%} of them in front of both cameras; exchanged, {self.exchanged_epipolar_px:.2g} px and "
            f"{self.exchanged_in_front:.0%}"
        )
        verdict = "look swapped" if self.swapped else "are in the order of the calibration"
        return f"left and right photographs {verdict}: {fits}" + ("; exchange left and right" if self.swapped else "")


def check_order(rig: Rig, left: ArrayLike, right: ArrayLike) -> OrderCheck:
    """Check whether left and right photographs are exchanged.

    left, right : (..., 2) — matched points in raw pixels; a few may be wrong, those with NaN are left out
    Without points, ``swapped`` is False.
    """
    left, right = (np.asarray(points, dtype=float).reshape(-1, 2) for points in (left, right))
    known = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    given, exchanged = (
        distance_and_share_in_front(rig, left[known], right[known]),
        distance_and_share_in_front(rig, right[known], left[known]),
    )
    if given[1] > _MIN_SHARE_IN_FRONT:
        swapped = given[0] > max(_MAX_NOISE_PX, _MIN_DISTANCE_RATIO * exchanged[0])
    else:
        swapped = exchanged[0] <= max(_MAX_FITTING_PX, given[0])
    swapped = bool(swapped and exchanged[1] > _MIN_SHARE_IN_FRONT)
    return OrderCheck(swapped, given[0], exchanged[0], given[1], exchanged[1], int(known.sum()))


def ray_depths(rig: Rig, left: ArrayLike, right: ArrayLike) -> tuple[Array, Array]:
    """Depths at which the rays of two matched points are nearest to each other; negative behind a camera.

    Least squares of z0 R x0 − z1 x1 + T over both depths, x0 and x1 being the directions (x, y, 1).

    left, right : (..., 2) — raw pixels
    Returns the depths (...) in the left and in the right camera's frame [mm]; not finite for parallel rays.
    """
    a = homogeneous(undistort(rig.left, left)) @ rig.rotation.T
    b = homogeneous(undistort(rig.right, right))
    aa, bb, ab = ((p * q).sum(axis=-1) for p, q in ((a, a), (b, b), (a, b)))
    at, bt = a @ rig.translation, b @ rig.translation
    determinant = aa * bb - ab * ab
    determinant = np.where(determinant > 0.0, determinant, np.nan)
    return (ab * bt - bb * at) / determinant, (aa * bt - ab * at) / determinant


def distance_and_share_in_front(rig: Rig, left: Array, right: Array) -> tuple[float, float]:
    """Median epipolar distance [px] and share of the points in front of both cameras; infinite and 0 without points."""
    distance = epipolar_distance(rig, left, right)
    distance = distance[np.isfinite(distance)]
    if not distance.size:
        return np.inf, 0.0
    z0, z1 = ray_depths(rig, left, right)
    return float(np.median(distance)), float(np.mean((z0 > 0.0) & (z1 > 0.0)))
