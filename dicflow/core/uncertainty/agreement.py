"""How well two fields of one quantity agree."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Delaunay, QhullError

from dicflow.core.arrays import Array, Mask

__all__ = ["Agreement", "agreement", "resampled"]


_MAX_SIDE_RATIO = 3.0
"""Longest side of a triangle over the median of all; with a longer one it spans a gap and is left out."""


class Agreement(NamedTuple):
    """Statistics of a difference over the points where both fields have a value; NaN without such points.

    points : their number
    share : of all points
    sigma : standard deviation about the mean
    percentiles : 2.5 %, 50 % and 97.5 %
    largest : largest magnitude
    share_beyond_sigma : share of points with a difference larger than the combined σ, of those with a σ; None without
        any. 31.7 % for independent Gaussian errors of this σ
    """

    points: int
    share: float
    mean: float
    sigma: float
    rms: float
    percentiles: tuple[float, float, float]
    largest: float
    share_beyond_sigma: float | None


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
        None if sigma is None else _share_beyond_sigma(values, sigma[known]),
    )


def resampled(places: Array, values: Array, at: Array) -> Array:
    """Scattered values at other places, linear between the corners of Delaunay triangles.

    places : (n, 2) px; NaN where unknown
    values : (n, k); NaN where a point has no value
    at : (..., 2) px; NaN where unknown
    Returns (..., k); NaN outside the points, in gaps between them, and in triangles with a corner without a value.
    """
    found = np.full((*at.shape[:-1], values.shape[1]), np.nan)
    known, known_at = np.isfinite(places).all(axis=1), np.isfinite(at).all(axis=-1)
    corners = places[known]
    if len(corners) < 3 or not known_at.any():
        return found
    try:
        mesh = Delaunay(corners)
    except QhullError:  # all on one line: they span no triangle
        return found
    triangle = mesh.find_simplex(at[known_at])
    weights = _barycentric(mesh, triangle, at[known_at])
    inside = (triangle >= 0) & ~_spans_gap(corners, mesh.simplices)[triangle]
    between = np.einsum("ij,ijk->ik", weights, values[known][mesh.simplices[triangle]])
    found[known_at] = np.where(inside[:, None], between, np.nan)
    return found


def _share_beyond_sigma(values: Array, sigma: Array) -> float | None:
    known = np.isfinite(sigma)
    return float(np.mean(np.abs(values[known]) > sigma[known])) if known.any() else None


def _barycentric(mesh: Delaunay, triangle: NDArray[np.intp], at: Array) -> Array:
    """Weights (n, 3) of the corners of each place's triangle."""
    affine = mesh.transform[triangle]
    first = np.einsum("ijk,ik->ij", affine[:, :2], at - affine[:, 2])
    return np.concatenate([first, 1.0 - first.sum(axis=1, keepdims=True)], axis=1)


def _spans_gap(corners: Array, simplices: NDArray[np.intc]) -> Mask:
    """Which triangles have a side much longer than usual."""
    sides = corners[simplices] - corners[np.roll(simplices, 1, axis=1)]
    longest = np.linalg.norm(sides, axis=-1).max(axis=1)
    return np.asarray(longest > _MAX_SIDE_RATIO * np.median(longest))
