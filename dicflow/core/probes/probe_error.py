"""The calibration's share in σ of probe readings: the rig's error is common to all points, so their changes add up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.probes.weights import Probe, complete_mean, length_slopes, value_of
from dicflow.core.strain.calibration_error import RigError, place_changes
from dicflow.core.strain.measures import GradientMeasures
from dicflow.core.strain.surface_strain import jacobian

__all__ = ["ProbeError"]


class ProbeError(NamedTuple):
    """A rig's error, and the points that probes read.

    deformed, reference : (row, col, 3) — at the step and at the reference state, in the frames of ``rig`` [mm]
    slopes : (row, col, 3, 2) twice — of the surface in both
    measures : of the deformation
    """

    rig: RigError
    deformed: Array
    reference: Array
    slopes: tuple[Array, Array]
    measures: GradientMeasures

    @classmethod
    def with_plane_slopes(cls, rig: RigError, deformed: Array, reference: Array, measures: GradientMeasures) -> Self:
        """With slopes of planes through each point and its neighbours."""
        slopes = (jacobian(deformed, (3, 3), 1), jacobian(reference, (3, 3), 1))
        return cls(rig, deformed, reference, slopes, measures)

    def mean_sigmas(self, places: Sequence[Probe]) -> dict[str, float]:
        """Shares in σ of the means of all quantities over places; NaN where unknown."""
        after, before = (
            np.stack([complete_mean(field[place.rows, place.cols]) for place in places]) for field in self.slopes
        )
        changes = place_changes(self.rig, self._points(places), (after, before), self.measures)
        return {name: float(np.linalg.norm(complete_mean(change))) for name, change in changes.items()}

    def length_sigmas(self, first: Probe, second: Probe) -> Array:
        """Shares (4,) in σ of the values of :class:`~dicflow.core.probes.weights.Extension`."""
        after, before = self._points([first, second])
        ends = self.rig.changes_at(after, before)
        changes = length_slopes(after[0] - after[1], before[0] - before[1]) @ (ends[0] - ends[1])
        return np.asarray(np.linalg.norm(changes, axis=-1))

    def _points(self, places: Sequence[Probe]) -> tuple[Array, Array]:
        """Places of probes at the step and at the reference state, (n, 3) each."""
        after, before = (
            np.stack([value_of(place, field) for place in places]) for field in (self.deformed, self.reference)
        )
        return after, before
