"""The scale's share in σ of probe readings with one camera: all lengths have the same relative error, strains none."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.probes.weights import Probe, difference, value_of

__all__ = ["ScaleError"]

_STRAINS = ("exx", "eyy", "gxy")


class ScaleError(NamedTuple):
    """The error of a scale, and the points that probes read.

    relative : standard uncertainty of the scale over the scale
    deformed, reference : (row, col, 3) — places at the step and at the reference state
    displacements : U, V and W → (row, col)
    """

    relative: float
    deformed: Array
    reference: Array
    displacements: Mapping[str, Array]

    def mean_sigmas(self, places: Sequence[Probe]) -> dict[str, float]:
        """Shares in σ of the means of all quantities over places."""
        means = {
            name: float(np.mean([value_of(place, field) for place in places]))
            for name, field in self.displacements.items()
        }
        return {**{name: self.relative * abs(mean) for name, mean in means.items()}, **dict.fromkeys(_STRAINS, 0.0)}

    def length_sigmas(self, first: Probe, second: Probe) -> Array:
        """Shares (4,) in σ of the values of :class:`~dicflow.core.probes.weights.Extension`."""
        apart = difference(first, second)
        after, before = (float(np.linalg.norm(value_of(apart, field))) for field in (self.deformed, self.reference))
        return self.relative * np.array([before, after, abs(after - before), 0.0])
