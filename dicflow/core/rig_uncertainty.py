"""What the calibration's uncertainty does to points and displacements.

A point X is triangulated where its reprojection errors e (4,) are least (:mod:`dicflow.core.triangulate`): there
Jᵀe = 0 with J = ∂e/∂X (4, 3), and the theorem of implicit functions gives, for errors much smaller than the photograph,

    ∂X/∂θ = −(JᵀJ)⁻¹ Jᵀ ∂e/∂θ

for the rig's 24 numbers θ at fixed pixels. One rig measures all points and steps, so that a displacement sees only the
difference of two such sensitivities, and the shares of neighbouring points are all but the same error.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dicflow.core.camera import Rig
from dicflow.core.rig_parameters import reprojection_slopes
from dicflow.core.triangulate import triangulate

__all__ = ["calibration_share", "point_sensitivity", "sensitivity_at"]

Array = NDArray[np.float64]

_UPPER = ((0, 0, 0, 1, 1, 2), (0, 1, 2, 1, 2, 2))


def point_sensitivity(rig: Rig, xy_left: ArrayLike, xy_right: ArrayLike) -> Array:
    """How triangulated points move with the rig's numbers while the measured pixels stay.

    xy_left, xy_right : (..., 2) — raw pixels, whose errors are taken to be alike
    Returns (..., 3, 24) — ∂X/∂θ in the left camera's frame, mm per unit of each of
    :data:`~dicflow.core.rig_parameters.PARAMETERS`; NaN where a pixel is.
    """
    return sensitivity_at(rig, triangulate(rig, xy_left, xy_right).xyz)


def sensitivity_at(rig: Rig, points: ArrayLike) -> Array:
    """The same, of points (..., 3) that are triangulated already [mm]."""
    by_point, by_rig = reprojection_slopes(rig, np.asarray(points, dtype=float))
    transposed = np.swapaxes(by_point, -1, -2)
    return np.asarray(-np.linalg.solve(transposed @ by_point, transposed @ by_rig))


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
