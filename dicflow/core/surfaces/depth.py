"""Depth gate: points of the background that are seen over the specimen's edge."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.surfaces.surface import evaluate, fit_surface

__all__ = ["background"]

_DEGREE = (2, 2)
_DEVIATIONS = 8.0
_LEAST_SHARE = 0.005
_NORMAL = 1.4826
_FEWEST = 50
_FIT_POINTS = 20_000


def background(depth: Array, gate_mm: float | None = None) -> Mask:
    """Which points lie off the surface that most of them form.

    The surface is a quadratic one by least absolute residuals, which a minority of other points does not move.

    depth : (rows, cols) — Z of the points in the region [mm], NaN where there is none
    gate_mm : how far a point may be off the surface; by default 8 standard deviations (from the median absolute one),
        and not less than 0.5 % of the depth, so that a specimen that is no quadratic surface is left whole
    Returns (rows, cols) bool; nothing where there are too few points to tell.
    """
    known = np.isfinite(depth)
    if np.count_nonzero(known) < _FEWEST:
        return np.zeros(depth.shape, dtype=bool)
    surface = fit_surface(depth, _DEGREE, "lar", _FIT_POINTS)
    residual = np.abs(depth - evaluate(surface, np.arange(depth.shape[1]), np.arange(depth.shape[0])))
    if gate_mm is None:
        spread = _NORMAL * float(np.median(residual[known]))
        gate_mm = max(_DEVIATIONS * spread, _LEAST_SHARE * float(np.median(depth[known])))
    return np.asarray(known & (residual > gate_mm))
