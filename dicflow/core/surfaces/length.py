"""Length of a specimen between the two edges that a caliper touches, from a cloud or from tracked points.

Lengths are measured along y, from the upper edge to the lower one; exchange the two pixel coordinates to measure along
x. Where the data do not reach an edge, they are extrapolated along the line towards it, by a parabola through the third
of the line next to the edge, over at most 15 % of the line.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dicflow.core.arrays import Array
from dicflow.core.surfaces.displacement import bilinear

__all__ = ["cloud_length", "edge_pairs", "edge_span", "tracked_length"]


_EXTRAPOLATED_SHARE = 1.0 / 3.0
_MAX_GAP_SHARE = 0.15
_POINTS_PER_EDGE = 101
_SAMPLES_PER_LINE = 101


def edge_pairs(exterior: Array) -> Array:
    """Opposite points on the upper and lower edge of an outline.

    exterior : (n, 2) — corners in order [px]
    Returns (2, 101, 2): the edge between the two upper and the edge between the two lower corners, each from left to
    right and evenly divided, so that points stay opposite when the outline shears or tilts.
    """
    low, high = exterior.min(axis=0), exterior.max(axis=0)
    u, v = ((exterior - low) / np.maximum(high - low, 1e-12)).T
    corners = [int(np.argmin(distance)) for distance in (u + v, 1 - u + v, u + 1 - v, 2 - u - v)]
    upper_left, upper_right, lower_left, lower_right = corners
    upper = _path_along_ring(exterior, upper_left, upper_right, avoid=(lower_left, lower_right))
    lower = _path_along_ring(exterior, lower_left, lower_right, avoid=(upper_left, upper_right))
    return np.stack([_evenly_divided(upper), _evenly_divided(lower)])


def cloud_length(xyz: NDArray[np.floating], origin: tuple[float, float], pairs: Array) -> float:
    """Mean distance in space between opposite points of two edges.

    xyz : (row, col, 3) [mm]
    origin : (x, y) of element [0, 0] [px]
    pairs : (2, n, 2) [px], from :func:`edge_pairs`
    Returns the length [mm]; NaN where no line of the cloud comes near both edges.
    """
    share = np.linspace(0.0, 1.0, _SAMPLES_PER_LINE)
    lines = pairs[0][:, None] + share[:, None] * (pairs[1] - pairs[0])[:, None]
    points = bilinear(xyz, lines, origin)
    ends = [[_value_at_edge(line, share, 0.0), _value_at_edge(line, share, 1.0)] for line in points]
    return _mean_distance(np.array(ends))


def edge_span(exterior: Array, x: Array) -> Array:
    """y of the upper and the lower edge of an outline at each x (n,), (n, 2) [px]; NaN beyond the ends of an edge."""
    spans = []
    for edge in edge_pairs(exterior):
        along = edge[np.argsort(edge[:, 0])]
        spans.append(np.interp(x, along[:, 0], along[:, 1], left=np.nan, right=np.nan))
    return np.stack(spans, axis=-1)


def tracked_length(points: Array, reference: Array, exterior: Array) -> float:
    """Mean distance between the material points that lay on the upper and lower edge at the first step.

    points : (row, col, k) — the material grid at this step, in space [mm] or in the image [px]
    reference : (row, col, 2) — the grid in the image at the first step [px]; NaN outside the region
    exterior : (n, 2) — outline of the region at the first step [px]

    The grid ends before the edges, so every column is extrapolated to the outline along its reference y.
    Returns the length [mm or px]; NaN where no column comes near both edges.
    """
    known = np.isfinite(reference[..., 0])
    x = np.where(known, reference[..., 0], 0.0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    spans = edge_span(exterior, np.where(known.any(axis=0), x, np.nan))
    ends = [
        [_value_at_edge(points[:, col], reference[:, col, 1], edge) for edge in span]
        for col, span in enumerate(spans)
        if np.isfinite(span).all()
    ]
    return _mean_distance(np.array(ends).reshape(-1, 2, points.shape[-1]))


def _path_along_ring(ring: Array, first: int, last: int, avoid: tuple[int, int]) -> Array:
    """The corners of a ring from index ``first`` to ``last``, in the direction that avoids two others."""
    forward = (first + np.arange((last - first) % len(ring) + 1)) % len(ring)
    backward = (first - np.arange((first - last) % len(ring) + 1)) % len(ring)
    return ring[backward if np.isin(avoid, forward).any() else forward]


def _evenly_divided(line: Array) -> Array:
    """Points that divide a line through corners (n, 2) evenly, ends included."""
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(line, axis=0), axis=1))])
    places = np.linspace(0.0, along[-1], _POINTS_PER_EDGE)
    return np.stack([np.interp(places, along, coordinate) for coordinate in line.T], axis=-1)


def _value_at_edge(values: Array, places: Array, edge: float) -> Array:
    """Value (k,) at an edge of values (n, k) at increasing places (n,); NaN where none of them is near the edge."""
    known = np.isfinite(values).all(axis=1) & np.isfinite(places)
    missing = np.full(values.shape[1], np.nan)
    if not known.any():
        return missing
    here, distance = places[known], np.abs(places[known] - edge)
    if distance.min() == 0.0:
        return np.asarray(values[known][distance.argmin()])
    whole = float(np.nanmax(places) - np.nanmin(places))
    near = distance <= distance.min() + _EXTRAPOLATED_SHARE * whole
    if distance.min() > _MAX_GAP_SHARE * whole or np.count_nonzero(near) < 4:
        return missing
    unit = (here[near] - edge) / whole
    parabola = np.linalg.lstsq(np.vander(unit, 3, increasing=True), values[known][near], rcond=None)[0]
    return np.asarray(parabola[0])


def _mean_distance(ends: Array) -> float:
    """Mean over n of the distance between ends (n, 2, k); NaN if all are unknown."""
    distances = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=-1)
    distances = distances[np.isfinite(distances)]
    return float(distances.mean()) if distances.size else float("nan")
