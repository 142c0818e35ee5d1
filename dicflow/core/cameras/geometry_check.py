"""Whether matched points fit a rig as they are, or with left and right exchanged.

Photographs in the wrong order betray themselves in one of two ways. Where the cameras look in parallel, all disparities
change their sign and the points come to lie behind the cameras. Where their axes meet at the specimen, disparities are
near zero and stay so; but the edge of it that is nearer to a camera is then taken for the farther one, and the points
leave their epipolar lines.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Rig, undistort
from dicflow.core.cameras.epipolar import epipolar_distance

__all__ = ["OrderCheck", "check_order", "ray_depths"]


_MOST = 0.5
"""Share of points in front of both cameras from which the geometry is possible."""
_WORSE = 3.0
_NOISE_PX = 0.3
"""An order is wrong when its epipolar distance is so many times the other's, and above what noise explains."""
_POSSIBLE_PX = 1.0


class OrderCheck(NamedTuple):
    """How matched points fit the rig as given, and with left and right exchanged.

    swapped : whether only the exchanged order fits
    epipolar_px, exchanged_epipolar_px : median distance from the epipolar lines [px]
    in_front, exchanged_in_front : share of the points that lie in front of both cameras
    points : how many were looked at
    """

    swapped: bool
    epipolar_px: float
    exchanged_epipolar_px: float
    in_front: float
    exchanged_in_front: float
    points: int

    @property
    def text(self) -> str:
        """The finding as a sentence."""
        fits = (
            f"as they are, {self.points} points lie {self.epipolar_px:.2g} px from their epipolar lines and "
            f"{self.in_front:.0%} in front of both cameras; exchanged, {self.exchanged_epipolar_px:.2g} px and "
            f"{self.exchanged_in_front:.0%}"
        )
        verdict = "look swapped" if self.swapped else "are in the order of the calibration"
        return f"left and right photographs {verdict}: {fits}" + ("; exchange left and right" if self.swapped else "")


def check_order(rig: Rig, left: ArrayLike, right: ArrayLike) -> OrderCheck:
    """See whether left and right were exchanged.

    left, right : (..., 2) — matched points in raw pixels of the photographs called so; a few may be wrong, those with
        NaN are left out
    Without a point neither order fits, and they are not called swapped.
    """
    left, right = (np.asarray(points, dtype=float).reshape(-1, 2) for points in (left, right))
    known = np.isfinite(left).all(axis=1) & np.isfinite(right).all(axis=1)
    given, exchanged = _fit(rig, left[known], right[known]), _fit(rig, right[known], left[known])
    if given[1] > _MOST:
        swapped = given[0] > max(_NOISE_PX, _WORSE * exchanged[0])
    else:
        swapped = exchanged[0] <= max(_POSSIBLE_PX, given[0])
    swapped = bool(swapped and exchanged[1] > _MOST)
    return OrderCheck(swapped, given[0], exchanged[0], given[1], exchanged[1], int(known.sum()))


def ray_depths(rig: Rig, left: ArrayLike, right: ArrayLike) -> tuple[Array, Array]:
    """Depths at which the rays of two matched points come nearest to each other, negative behind a camera.

    Least squares of z0 R x0 − z1 x1 + T over both depths, x0 and x1 being the directions (x, y, 1).

    left, right : (..., 2) — raw pixels
    Returns the depths (...) in the left and in the right camera's frame [mm]; not finite for parallel rays.
    """
    a = _homogeneous(undistort(rig.left, left)) @ rig.rotation.T
    b = _homogeneous(undistort(rig.right, right))
    aa, bb, ab = ((p * q).sum(axis=-1) for p, q in ((a, a), (b, b), (a, b)))
    at, bt = a @ rig.translation, b @ rig.translation
    determinant = aa * bb - ab * ab
    determinant = np.where(determinant > 0.0, determinant, np.nan)
    return (ab * bt - bb * at) / determinant, (aa * bt - ab * at) / determinant


def _fit(rig: Rig, left: Array, right: Array) -> tuple[float, float]:
    """Median epipolar distance [px] and the share in front of both cameras; infinite and 0 without a point."""
    distance = epipolar_distance(rig, left, right)
    distance = distance[np.isfinite(distance)]
    if not distance.size:
        return np.inf, 0.0
    z0, z1 = ray_depths(rig, left, right)
    return float(np.median(distance)), float(np.mean((z0 > 0.0) & (z1 > 0.0)))


def _homogeneous(points: Array) -> Array:
    return np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1)
