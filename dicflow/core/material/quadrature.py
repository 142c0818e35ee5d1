"""Integrals over a sheet from points on a grid, up to its sides."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array

__all__ = ["row_weights", "sides_at", "smooth_derivatives"]

_DEGREE = 3
"""Of the polynomials of column and row that the places of a sheet follow."""
_NEAR = 5
"""Points next to a side whose straight line is continued to it."""


def smooth_derivatives(places: Array) -> Array:
    """Derivatives (row, col, 3, 2) of the places of a grid by column and row, without noise.

    places : (row, col, 3), NaN where unknown; a sheet that is bent little
    Cubic polynomials are fitted, and hold also at points that are unknown.
    """
    known = np.isfinite(places).all(axis=-1)
    row, col = (np.asarray(part, dtype=float) for part in np.indices(known.shape))
    scale, middle = max(known.shape) / 2.0, (np.array(known.shape) - 1.0) / 2.0
    u, v = (col - middle[1]) / scale, (row - middle[0]) / scale
    powers = [(i, j) for i in range(_DEGREE + 1) for j in range(_DEGREE + 1 - i)]
    design = np.stack([u**i * v**j for i, j in powers], axis=-1)
    factors = np.linalg.lstsq(design[known], places[known], rcond=None)[0]
    by_u = np.stack([i * u ** max(i - 1, 0) * v**j for i, j in powers], axis=-1) @ factors
    by_v = np.stack([j * u**i * v ** max(j - 1, 0) for i, j in powers], axis=-1) @ factors
    return np.asarray(np.stack([by_u, by_v], axis=-1) / scale)


def row_weights(points: Array, start: float, end: float) -> Array:
    """Weights (n,) by which values at points (n,) of a row sum up to the integral from its start to its end.

    Between points values are straight; next to the sides the line through the nearest points is continued.
    points : ascending, two or more
    """
    weights = np.zeros(len(points))
    halves = np.diff(points) / 2.0
    weights[:-1] += halves
    weights[1:] += halves
    weights[:_NEAR] += _beyond(points[:_NEAR], start, points[0])
    weights[-_NEAR:] += _beyond(points[-_NEAR:], points[-1], end)
    return weights


def _beyond(points: Array, start: float, end: float) -> Array:
    """Weights of points (m,) by which the straight line through them is integrated."""
    middle = points.mean()
    design = np.stack([np.ones(len(points)), points - middle], axis=-1)
    return np.asarray((end - start) * (np.array([1.0, (start + end) / 2.0 - middle]) @ np.linalg.pinv(design)))


def sides_at(outline: Array, y: float) -> tuple[float, float]:
    """Least and largest x of a closed outline (n, 2) at a y. Raises ValueError where it does not reach."""
    before, after = outline, np.roll(outline, -1, axis=0)
    crosses = (before[:, 1] <= y) != (after[:, 1] <= y)
    if not crosses.any():
        raise ValueError(f"the outline does not reach y = {y:g}")
    first, last = before[crosses], after[crosses]
    x = first[:, 0] + (y - first[:, 1]) / (last[:, 1] - first[:, 1]) * (last[:, 0] - first[:, 0])
    return float(x.min()), float(x.max())
