"""Depth gate: points of the background that are visible beside the specimen."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.surfaces.surface import evaluate, fit_surface

__all__ = ["is_background"]

_DEGREE = (2, 2)
_GATE_DEVIATIONS = 8.0
_MIN_GATE_SHARE = 0.005
_SIGMA_PER_MAD = 1.4826
_MIN_POINTS = 50
_MAX_FIT_POINTS = 20_000


def is_background(depth: Array, gate_mm: float | None = None) -> Mask:
    """Which points lie too far from the surface that most of them form.

    The surface is quadratic and fitted by least absolute residuals, on which a minority of points has little effect.

    depth : (rows, cols) — Z of the points in the region [mm], NaN where missing
    gate_mm : largest distance from the surface; by default 8 standard deviations (from the median absolute deviation),
        but at least 0.5 % of the depth, so that a specimen that is not quadratic is not cut
    Returns (rows, cols) bool; all False with fewer than 50 points.
    """
    known = np.isfinite(depth)
    if np.count_nonzero(known) < _MIN_POINTS:
        return np.zeros(depth.shape, dtype=bool)
    surface = fit_surface(depth, _DEGREE, "lar", _MAX_FIT_POINTS)
    residual = np.abs(depth - evaluate(surface, np.arange(depth.shape[1]), np.arange(depth.shape[0])))
    if gate_mm is None:
        spread = _SIGMA_PER_MAD * float(np.median(residual[known]))
        gate_mm = max(_GATE_DEVIATIONS * spread, _MIN_GATE_SHARE * float(np.median(depth[known])))
    return np.asarray(known & (residual > gate_mm))
