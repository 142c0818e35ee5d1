"""Single gross marks of a calibration target: blunders among marks that are right.

A mark is gross if its residual is far longer than noise explains, in a photograph whose other marks fit. Least squares
spread a blunder over its neighbours, and a bad photograph over all others, so only the largest residuals are judged
before the rig is adjusted again (data snooping, Baarda 1968). Scales come from medians, which a minority of blunders
does not move.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.calibration.robust import sigma_from_median

__all__ = ["Gross", "more_gross"]

_MOST_SIGMA = 8.0
"""Residual of a mark over the noise. Of marks with normal noise, one in 10¹⁴ lies so far off."""
_OF_LARGEST = 0.5
"""Residual over the largest of all, from which a mark is judged before the next adjustment."""
_MOST_SHARE = 0.1
"""Of the marks of a photograph; where more do not fit, the photograph is bad and not its marks."""


class Gross(NamedTuple):
    """What adjustments so far have found.

    marks : (n, 2, m) bool — gross marks of n pairs, left and right
    bad : (n, 2) bool — photographs of which too many marks do not fit; none of them counts as gross
    """

    marks: Mask
    bad: Mask

    @classmethod
    def none(cls, pairs: int, marks: int) -> Gross:
        """Before the first adjustment."""
        return cls(np.zeros((pairs, 2, marks), dtype=bool), np.zeros((pairs, 2), dtype=bool))


def more_gross(before: Gross, lengths: Array, limit_px: float) -> Gross | None:
    """What is to be left out before the rig is adjusted again; None if nothing more is gross.

    lengths : (n, 2, m) — of the residuals [px]; NaN where a mark is not seen or was left out
    limit_px : a shorter residual is not gross, however small the noise is
    """
    found = _far(lengths, limit_px) & ~before.bad[..., None]
    if not found.any():
        return None
    marks = before.marks | found
    seen = (np.isfinite(lengths) | before.marks).sum(axis=-1)
    bad = before.bad | (marks.sum(axis=-1) > np.maximum(1, _MOST_SHARE * seen))
    return Gross(marks & ~bad[..., None], bad)


def _far(lengths: Array, limit_px: float) -> Mask:
    """Marks (n, 2, m) whose residuals are far beyond noise, and among the largest of all."""
    known: Mask = np.isfinite(lengths)
    noise = sigma_from_median(lengths[known])
    own = [
        [sigma_from_median(one[np.isfinite(one)]) if np.isfinite(one).any() else np.inf for one in pair]
        for pair in lengths
    ]
    threshold = np.maximum(limit_px, _MOST_SIGMA * np.maximum(own, noise))[..., None]
    length = np.where(known, lengths, 0.0)
    return np.asarray(length > np.maximum(threshold, _OF_LARGEST * length.max()))
