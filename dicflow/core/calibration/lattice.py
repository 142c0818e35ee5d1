"""Places of scattered points on a lattice that perspective and lens distort."""

from __future__ import annotations

from collections import deque

import numpy as np
from scipy.spatial import cKDTree

from dicflow.core.arrays import Array

__all__ = ["lattice_places"]


_STEPS = ((1, 0), (-1, 0), (0, 1), (0, -1))
_MAX_MISPLACED = 0.25
"""Largest distance of a point from where its neighbour predicts it, over the distance to that neighbour."""
_NEAREST, _STARTS = 8, 12


def lattice_places(points: Array) -> Array:
    """Whole-number places of points on a lattice; of several, on the largest that grows from one of the central points.

    From each point, neighbours are predicted by the two steps of the lattice there, which each neighbour found adapts.

    points : (n, 2) [px]
    Returns (n, 2); NaN for a point that is not on it. Neither the origin nor the directions are determined.
    """
    if len(points) < 4:
        return np.full((len(points), 2), np.nan)
    central = np.linalg.norm(points - np.median(points, axis=0), axis=1).argsort()[:_STARTS]
    tree = cKDTree(points)
    return max((_grown(points, tree, int(start)) for start in central), key=lambda found: np.isfinite(found).sum())


def _grown(points: Array, tree: cKDTree, start: int) -> Array:
    """Places (n, 2) of points on the lattice that grows from one of them."""
    places = np.full((len(points), 2), np.nan)
    basis = _first_basis(points, tree, start)
    waiting = deque([(start, basis)] if basis is not None else [])
    places[start] = 0.0
    while waiting:
        here, steps = waiting.popleft()
        for step in _STEPS:
            along = np.asarray(step) @ steps
            distance, there = tree.query(points[here] + along)
            if distance > _MAX_MISPLACED * np.linalg.norm(along) or np.isfinite(places[there, 0]):
                continue
            places[there] = places[here] + step
            axis, sign = (0, step[0]) if step[0] else (1, step[1])
            adapted = steps.copy()
            adapted[axis] = sign * (points[there] - points[here])
            waiting.append((int(there), adapted))
    return places


def _first_basis(points: Array, tree: cKDTree, start: int) -> Array | None:
    """Steps (2, 2) from a point to its nearest neighbour, and to the nearest one in another direction."""
    _, near = tree.query(points[start], k=min(_NEAREST + 1, len(points)))
    vectors = points[near[1:]] - points[start]
    directions = vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), 1e-9)
    across = np.flatnonzero(np.abs(directions @ directions[0]) < 0.7)
    return np.stack([vectors[0], vectors[across[0]]]) if len(across) else None
