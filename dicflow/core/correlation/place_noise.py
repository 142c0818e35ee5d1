"""The noise of photographs by what the residuals of subsets do to their places.

A pattern that is almost too fine for the pixels leaves residuals near the highest frequencies, which interpolation
cannot follow. They are no noise, and move no place: the slopes of the pattern are lower in frequency. What residuals do
to places (:mod:`dicflow.core.correlation.misfit`), over what white noise of one grey level does, is the variance of the
noise, and nothing else of the residuals counts.
"""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Index, all_finite
from dicflow.core.correlation.edges import residual_variance
from dicflow.core.correlation.misfit import place_covariances
from dicflow.core.correlation.search import CorrelatedField, Search
from dicflow.core.correlation.warp import gradient
from dicflow.core.photographs.noise import interpolated_noise_ratio
from dicflow.core.status import Status

__all__ = ["noise_of_places"]

_PLAIN_SHARE, _MEAN_OF_PLAIN = 0.1, 1.755
"""Share of the subsets whose residual is noise alone, at least, and standard deviations from the mean of a normal
distribution to the mean of this share."""
_SAMPLES = 200
"""Subsets that are computed, about."""


def noise_of_places(correlation: CorrelatedField, origin: tuple[int, int], search: Search) -> float:
    """Standard deviation of the noise that moves places as the residuals do [grey levels]; infinite where unknown.

    The subsets with the least residuals tell, along the axis along which these do less: what subsets do not follow adds
    to the others.

    origin : of the template in the first photograph [px]
    """
    chosen = _plain(correlation)
    if len(chosen) == 0:
        return float("inf")
    field, damping = correlation.field, correlation.damping
    warp = field.warp.reshape(-1, *field.warp.shape[-2:])[chosen]
    centres = np.rint(correlation.centres.reshape(-1, 2)[chosen] - origin).astype(np.int64)
    found = place_covariances(correlation.template, correlation.target, centres, warp, search.subset, search.threads)
    ratio = damping.target * correlation.gain * interpolated_noise_ratio(gradient(warp), search.degree)
    of_noise = (damping.template + ratio)[:, None] * found.noise[:, [0, 1], [0, 1]]
    share = found.residual[:, [0, 1], [0, 1]] / np.maximum(of_noise, 1e-300)
    known = share[all_finite(share)]
    chance = 1.0 - _MEAN_OF_PLAIN * np.sqrt(2.0) / search.subset.size
    return float(np.sqrt(known.mean(axis=0).min() / chance)) if len(known) else float("inf")


def _plain(correlation: CorrelatedField) -> Index:
    """Numbers (n,) of subsets with the least residuals, evenly chosen ones of many."""
    field = correlation.field
    valid = np.flatnonzero(field.status == Status.VALID)
    variance = residual_variance(field).ravel()[valid]
    plain = valid[variance <= np.quantile(variance, _PLAIN_SHARE)] if len(valid) else valid
    return np.asarray(plain[:: 1 + len(plain) // _SAMPLES])
