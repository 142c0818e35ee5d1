"""What the calibration's uncertainty does to points and displacements.

A point X is triangulated where its reprojection errors e (4,) are least, so that there Jᵀe = 0 with J = ∂e/∂X (4, 3).
The theorem of implicit functions gives, for errors much smaller than the photograph,

    ∂X/∂θ = −(JᵀJ)⁻¹ Jᵀ ∂e/∂θ

for the rig's 24 numbers θ at fixed pixels. One rig measures all points and steps, so that a displacement sees only the
difference of two such sensitivities, and the shares of neighbouring points are all but the same error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dicflow.core.camera import Rig, project, to_right, undistort
from dicflow.core.rig_parameters import point_slopes, reprojection_slopes

__all__ = ["calibration_share", "intersection", "point_sensitivity", "sensitivity_at"]

Array = NDArray[np.float64]

_REFINEMENTS = 2
_UPPER = ((0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2))


def point_sensitivity(rig: Rig, xy_left: ArrayLike, xy_right: ArrayLike) -> Array:
    """How triangulated points move with the rig's numbers while the measured pixels stay.

    xy_left, xy_right : (..., 2) — raw pixels
    Returns (..., 3, 24) — ∂X/∂θ in the left camera's frame, mm per unit of each of
    :data:`~dicflow.core.rig_parameters.PARAMETERS`; NaN where a pixel is.
    """
    return sensitivity_at(rig, intersection(rig, xy_left, xy_right))


def sensitivity_at(rig: Rig, points: ArrayLike) -> Array:
    """The same, of points (..., 3) that are triangulated already [mm]."""
    by_point, by_rig = reprojection_slopes(rig, np.asarray(points, dtype=float))
    return np.asarray(-_pseudoinverse(by_point) @ by_rig)


def calibration_share(sensitivity: ArrayLike, sensitivity_reference: ArrayLike, covariance: ArrayLike) -> Array:
    """The calibration's share in the covariance of displacements between two states.

    sensitivity, sensitivity_reference : (..., 3, 24) — of the points in the two states (:func:`point_sensitivity`);
        0 as the reference gives the share of the points themselves
    covariance : (24, 24) — of the rig's numbers
    Returns (..., 6) — XX, XY, XZ, YY, YZ, ZZ [mm²].
    """
    difference = np.asarray(sensitivity, dtype=float) - np.asarray(sensitivity_reference, dtype=float)
    full = difference @ np.asarray(covariance, dtype=float) @ np.swapaxes(difference, -1, -2)
    return np.asarray(full[..., _UPPER[0], _UPPER[1]])


def intersection(rig: Rig, xy_left: ArrayLike, xy_right: ArrayLike) -> Array:
    """Points whose reprojections are nearest to measured pixels, in the least squares over both photographs.

    From the point midway between the two rays (Beardsley et al. 1994) by steps of Gauss and Newton.

    xy_left, xy_right : (..., 2) — raw pixels
    Returns (..., 3) [mm] in the left camera's frame; NaN where a pixel is.
    """
    left, right = np.asarray(xy_left, dtype=float), np.asarray(xy_right, dtype=float)
    points = _between_rays(rig, left, right)
    for _ in range(_REFINEMENTS):
        moved = to_right(rig, points)
        error = np.concatenate([project(rig.left, points) - left, project(rig.right, moved) - right], axis=-1)
        slopes = [point_slopes(rig.left, points), point_slopes(rig.right, moved) @ rig.rotation]
        points = points - (_pseudoinverse(np.concatenate(slopes, axis=-2)) @ error[..., None])[..., 0]
    return points


def _between_rays(rig: Rig, left: Array, right: Array) -> Array:
    """Midpoints (..., 3) of the shortest lines between the rays of pixels (..., 2)."""
    ray_left, ray_right = _rays(undistort(rig.left, left)), _rays(undistort(rig.right, right)) @ rig.rotation
    centre = -rig.rotation.T @ rig.translation
    ll, rr = np.sum(ray_left**2, axis=-1), np.sum(ray_right**2, axis=-1)
    lr = np.sum(ray_left * ray_right, axis=-1)
    lc, rc = ray_left @ centre, ray_right @ centre
    determinant = ll * rr - lr**2
    along_left, along_right = (rr * lc - lr * rc) / determinant, (lr * lc - ll * rc) / determinant
    return np.asarray(0.5 * (along_left[..., None] * ray_left + centre + along_right[..., None] * ray_right))


def _rays(directions: Array) -> Array:
    return np.concatenate([directions, np.ones((*directions.shape[:-1], 1))], axis=-1)


def _pseudoinverse(slopes: Array) -> Array:
    """(JᵀJ)⁻¹ Jᵀ (..., 3, 4) of J (..., 4, 3); NaN stays NaN."""
    transposed = np.swapaxes(slopes, -1, -2)
    return np.asarray(np.linalg.solve(transposed @ slopes, transposed))
