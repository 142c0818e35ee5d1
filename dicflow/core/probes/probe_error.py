"""The calibration's share in what probes read: the rig's error is one for all points, so that their changes add up."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.probes.weights import Probe, complete_mean, length_slopes, value_of
from dicflow.core.strain.calibration_error import RigError, place_changes
from dicflow.core.strain.measures import Directions, Measure
from dicflow.core.strain.surface_strain import jacobian

__all__ = ["ProbeError"]


class ProbeError(NamedTuple):
    """A rig's error, and the points that are read.

    deformed, reference : (row, col, 3) — at the step and at the reference, in the frames of ``rig`` [mm]
    slopes : (row, col, 3, 2) twice — of the surface there
    measure, directions : of the strains
    """

    rig: RigError
    deformed: Array
    reference: Array
    slopes: tuple[Array, Array]
    measure: Measure
    directions: Directions

    @classmethod
    def of(cls, rig: RigError, deformed: Array, reference: Array, measure: Measure, directions: Directions) -> Self:
        """The same, the slopes being those of planes through each point's neighbours."""
        slopes = (jacobian(deformed, (3, 3), 1), jacobian(reference, (3, 3), 1))
        return cls(rig, deformed, reference, slopes, measure, directions)

    def of_mean(self, places: Sequence[Probe]) -> dict[str, float]:
        """Shares in σ of all quantities' means over places; NaN where the points there have none."""
        after, before = (
            np.stack([complete_mean(field[place.rows, place.cols]) for place in places]) for field in self.slopes
        )
        changes = place_changes(self.rig, self._points(places), (after, before), self.measure, self.directions)
        return {name: float(np.linalg.norm(complete_mean(change))) for name, change in changes.items()}

    def of_lengths(self, first: Probe, second: Probe) -> Array:
        """Shares (4,) in σ of what :func:`~dicflow.core.probes.weights.extension` reads."""
        now, before = self._points([first, second])
        both = self.rig.at(now, before)
        changes = length_slopes(now[0] - now[1], before[0] - before[1]) @ (both[0] - both[1])
        return np.asarray(np.linalg.norm(changes, axis=-1))

    def _points(self, places: Sequence[Probe]) -> tuple[Array, Array]:
        """Where probes lie in both states, (n, 3) each."""
        after, before = (
            np.stack([value_of(place, field) for place in places]) for field in (self.deformed, self.reference)
        )
        return after, before
