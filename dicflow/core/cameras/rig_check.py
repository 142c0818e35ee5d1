"""Whether a rig still fits the photographs: how far points lie from their epipolar lines, and how far they may lie.

The distance of a matched point from its epipolar line has two causes as long as the cameras have not moved: the noise
of the point, and the error that the calibration left in the rig, whose covariance is known. Real lenses add what the
model of the distortion has not. All three give the distance that is expected.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.relative_orientation import (
    MIN_POINTS,
    MatchedPoints,
    residuals_and_slopes,
    unmodelled_lenses,
)
from dicflow.core.cameras.rig_parameters import PARAMETERS

__all__ = ["RigCheck", "check_rig"]

_MOST_EXPECTED = 2.0
"""Ratio of the distance to the expected one up to which a rig fits: its error is as large in 1 of 20 rigs."""
_SIGMA_PER_MEDIAN = 1.4826
_LEAST_EXPECTED_PX = 0.05
"""Where the covariance of a calibration is unknown."""
_REMEDY = (
    "the cameras have moved since the calibration, or a lens was refocused. Add a stage 'refine', which refines the "
    "rig from the photographs of the specimen, or photograph the board again as the cameras stand now"
)


class RigCheck(NamedTuple):
    """Distances of points from their epipolar lines.

    distance_px : root mean square without outliers; expected_px : the same by noise and calibration [px]
    points : number of points
    """

    distance_px: float
    expected_px: float
    points: int

    @property
    def fits(self) -> bool:
        """Whether the rig is still calibrated."""
        return self.distance_px <= _MOST_EXPECTED * self.expected_px

    @property
    def sentence(self) -> str:
        """Yes or no, the figure, and what to do."""
        found = (
            f"the points of the first step lie {self.distance_px:.2g} px from their epipolar lines, and "
            f"{self.expected_px:.2g} px are expected by the noise and the calibration"
        )
        if self.fits:
            return f"Yes, the rig is still calibrated: {found}. There is nothing to do."
        return f"No, the rig is not calibrated any more: {found}; {_REMEDY}."


def check_rig(rig: Rig, covariance: Array | None, points: MatchedPoints) -> RigCheck | None:
    """Whether a rig fits matched points; None for too few of them, or for points that lie behind the cameras.

    covariance : (24, 24) — of the rig's parameters; None if unknown
    points : with the covariance of their noise [px²]
    """
    if len(points.left) < MIN_POINTS:
        return None
    try:
        residual, slopes = residuals_and_slopes(rig, points)
    except ValueError:
        return None
    sigma = _noise_px(points)
    known = np.zeros((len(PARAMETERS),) * 2) if covariance is None else covariance
    lenses = unmodelled_lenses(rig, known)
    share = np.einsum("ni,ij,nj->n", slopes, known + lenses @ lenses.T, slopes)
    expected = float(np.sqrt(np.median(sigma**2 * (1.0 + share))))
    if covariance is None:
        expected = max(expected, _LEAST_EXPECTED_PX)
    distance = _SIGMA_PER_MEDIAN * float(np.median(np.abs(residual * sigma)))
    return RigCheck(distance, expected, len(residual))


def _noise_px(points: MatchedPoints) -> Array:
    """Standard deviation (n,) of the distances by noise, for epipolar lines along any direction [px]."""
    covariances = points.covariance_left + points.covariance_right
    return np.asarray(np.sqrt(0.5 * (covariances[:, 0] + covariances[:, 2])))
