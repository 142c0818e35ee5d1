"""Whether the misfit of subsets is the same in both photographs of a step.

Both are compared with one template. Where the pattern itself has changed, by large strain or a coarse template, both
places are wrong by the same part of the material, and its place in space moves along the surface alone. A misfit of the
photographs, as by sampling, differs from one to the other and shows in the distances from the epipolar lines. Their
scatter beyond what noise explains, over what the misfit would make if it were independent, is the independent share.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.epipolar import epipolar_slopes, signed_epipolar_distance

__all__ = ["PlaceErrors", "independent_share", "shared_part"]


_MIN_POINTS, _ENOUGH_POINTS = 100, 3000
"""With fewer, the misfit counts as independent; about so many are looked at."""
_LEAST_SHARE = 1e-6
"""Least variance along any direction, over the sum of both, with which a covariance counts as invertible."""
_NORMAL = 1.4826
"""Standard deviation of a normal distribution over the median of its distances from 0."""


class PlaceErrors(NamedTuple):
    """Places in one photograph and their errors.

    xy : (row, col, 2) [px]; noise, misfit : (row, col, 3) — covariances xx, xy, yy [px²]
    """

    xy: Array
    noise: Array
    misfit: Array


def independent_share(rig: Rig, left: PlaceErrors, right: PlaceErrors) -> float:
    """Share of the variance by misfit that is independent in both photographs, 0 to 1."""
    left, right = _thinned(left), _thinned(right)
    distance = signed_epipolar_distance(rig, left.xy, right.xy)
    slopes = epipolar_slopes(rig, left.xy, right.xy)
    noise = _along(slopes[0], left.noise) + _along(slopes[1], right.noise)
    misfit = _along(slopes[0], left.misfit) + _along(slopes[1], right.misfit)
    known = np.isfinite(distance + noise + misfit)
    by_misfit = float(np.median((misfit / (noise + misfit))[known])) if known.any() else 0.0
    if known.sum() < _MIN_POINTS or by_misfit <= 0.0:
        return 1.0
    scatter = _without_trend(distance[known], left.xy[known])
    scaled = scatter**2 / (noise + misfit)[known]
    observed = _NORMAL**2 * float(np.median(scaled))
    return float(np.clip((observed - (1.0 - by_misfit)) / by_misfit, 0.0, 1.0))


def shared_part(one: Array, other: Array) -> Array:
    """The largest covariance (..., 3) that both covariances (..., 3) contain: along no direction more than either has.

    With one = L Lᵀ and other = L V D Vᵀ Lᵀ it is L V min(D, 1) Vᵀ Lᵀ.
    """
    xx, xy, yy = np.moveaxis(one, -1, 0)
    least = np.maximum(_LEAST_SHARE * (xx + yy), 1e-300)
    p, q, r = (scale := np.sqrt(np.maximum(xx, least))), xy / scale, np.sqrt(np.maximum(yy - xy * xy / scale**2, least))
    xx, xy, yy = np.moveaxis(other, -1, 0)
    xx, xy, yy = xx / p**2, (xy - q / p * xx) / (p * r), (yy - 2.0 * q / p * xy + (q / p) ** 2 * xx) / r**2
    middle, half = 0.5 * (xx + yy), np.hypot(0.5 * (xx - yy), xy)
    high, low = np.minimum(middle + half, 1.0), np.minimum(middle - half, 1.0)
    slope = (high - low) / np.maximum(2.0 * half, 1e-300)
    more = low - slope * (middle - half)
    xx, xy, yy = slope * xx + more, slope * xy, slope * yy + more
    return np.stack([p * p * xx, p * (q * xx + r * xy), q * q * xx + 2.0 * q * r * xy + r * r * yy], axis=-1)


def _thinned(errors: PlaceErrors) -> PlaceErrors:
    """Every so many points of a grid."""
    stride = max(1, int(np.sqrt(errors.xy[..., 0].size / _ENOUGH_POINTS)))
    return PlaceErrors._make(part[::stride, ::stride].reshape(-1, part.shape[-1]) for part in errors)


def _along(slope: Array, covariance: Array) -> Array:
    """Variance (...) of the distance by an error of a place."""
    x, y = slope[..., 0], slope[..., 1]
    return np.asarray(x * x * covariance[..., 0] + 2.0 * x * y * covariance[..., 1] + y * y * covariance[..., 2])


def _without_trend(distance: Array, places: Array) -> Array:
    """Distances (n,) less a cubic trend over the photograph, which the rig has made."""
    x, y = ((places - places.mean(axis=0)) / np.maximum(places.std(axis=0), 1e-12)).T
    terms = np.stack([x**a * y**b for a in range(4) for b in range(4 - a)], axis=-1)
    return np.asarray(distance - terms @ np.linalg.lstsq(terms, distance, rcond=None)[0])
