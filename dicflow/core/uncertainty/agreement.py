"""How well two fields of one quantity agree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from dicflow.core.arrays import Array, Mask

__all__ = ["Agreement", "agreement", "resampled"]


_LONGEST = 3.0
"""Triangles with a longer side, in sides of the usual triangle, span a gap or a hole and are left out."""


class Agreement(NamedTuple):
    """Statistics of a difference over the points where both fields have a value; NaN without any.

    points : their number
    share : of all points
    sigma : standard deviation about the mean
    percentiles : 2.5 %, 50 % and 97.5 %
    largest : largest size
    outside : share of the points whose difference is larger than the combined σ, of those that have one; None
        without any. Independent Gaussian errors of the σ that is told give 31.7 %
    """

    points: int
    share: float
    mean: float
    sigma: float
    rms: float
    percentiles: tuple[float, float, float]
    largest: float
    outside: float | None


def agreement(difference: Array, sigma: Array | None = None) -> Agreement:
    """Statistics of a difference.

    difference : (...) any unit, NaN where either field has no value
    sigma : (...) combined σ of the difference, NaN where it is unknown
    """
    known = np.isfinite(difference)
    values = difference[known]
    if not values.size:
        return Agreement(0, 0.0, np.nan, np.nan, np.nan, (np.nan, np.nan, np.nan), np.nan, None)
    low, middle, high = np.percentile(values, [2.5, 50.0, 97.5])
    return Agreement(
        int(values.size),
        float(values.size / difference.size),
        float(values.mean()),
        float(values.std()),
        float(np.sqrt(np.mean(values**2))),
        (float(low), float(middle), float(high)),
        float(np.abs(values).max()),
        None if sigma is None else _outside(values, sigma[known]),
    )


def resampled(places: Array, values: Array, at: Array) -> Array:
    """Scattered values at other places, linearly between the three nearest corners of a Delaunay triangle.

    places : (n, 2) px, NaN where there is no point
    values : (n, k), NaN where a point has no value
    at : (..., 2) px
    Returns (..., k); NaN outside the points, in gaps between them, and beside a point without value.
    """
    found = np.full((*at.shape[:-1], values.shape[1]), np.nan)
    known, wanted = np.isfinite(places).all(axis=1), np.isfinite(at).all(axis=-1)
    corners = places[known]
    if len(corners) < 3 or not wanted.any():
        return found
    try:
        mesh = Delaunay(corners)
    except QhullError:  # all on one line: no place lies between them
        return found
    triangle = mesh.find_simplex(at[wanted])
    weights = _barycentric(mesh, triangle, at[wanted])
    inside = (triangle >= 0) & ~_spans_gap(corners, mesh.simplices)[triangle]
    between = np.einsum("ij,ijk->ik", weights, values[known][mesh.simplices[triangle]])
    found[wanted] = np.where(inside[:, None], between, np.nan)
    return found


def _outside(values: Array, sigma: Array) -> float | None:
    told = np.isfinite(sigma)
    return float(np.mean(np.abs(values[told]) > sigma[told])) if told.any() else None


def _barycentric(mesh: Delaunay, triangle: NDArray[np.intp], at: Array) -> Array:
    """Weights (n, 3) of the corners of each place's triangle."""
    affine = mesh.transform[triangle]
    first = np.einsum("ijk,ik->ij", affine[:, :2], at - affine[:, 2])
    return np.concatenate([first, 1.0 - first.sum(axis=1, keepdims=True)], axis=1)


def _spans_gap(corners: Array, simplices: NDArray[np.intc]) -> Mask:
    """Which triangles are much longer than the usual one."""
    sides = corners[simplices] - corners[np.roll(simplices, 1, axis=1)]
    longest = np.linalg.norm(sides, axis=-1).max(axis=1)
    return np.asarray(longest > _LONGEST * np.median(longest))
