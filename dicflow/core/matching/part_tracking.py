"""A region followed from one photograph to another, each of its parts on its own.

Parts and cuts are known in the first photograph. There each point of the material grid has its place, so that a match
in a later photograph is on the side of the points around it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from numba import njit
from scipy.spatial import cKDTree

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.kernels import KERNEL
from dicflow.core.matching.features import Features
from dicflow.core.matching.pairs import Seen
from dicflow.core.matching.steps import Matching, Sight, match_steps
from dicflow.core.matching.tracking import (
    Deviations,
    Estimation,
    SubsetGrid,
    TrackedSubsets,
    carry_points,
    deviations,
    follow_matches,
    nearest_subset,
    subset_grid,
    track_subsets,
    unknown_subsets,
)
from dicflow.core.parts import Parts, are_apart, sees
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import bounding_box, carry, contains

__all__ = [
    "FollowedRegion",
    "MaterialGrid",
    "RegionPlaces",
    "Tracking",
    "beside_gaps",
    "follow_region",
    "match_parts",
]


Box = tuple[float, float, float, float]

_AROUND = 4
"""Points around a match that must be on one side."""
_SPACINGS = 2.0
"""Reach of a window beyond its half: to the first point behind a gap, and over a speckle that lies across it."""
_CANDIDATES = 12
"""Points from which the one on the side of a corner is chosen."""


class Tracking(NamedTuple):
    """How a region is followed.

    subsets : rows and columns of subsets over each part
    overlap : share of its size by which a subset reaches into its neighbour on each side
    follow : points follow the matches around them, the transforms blended between subsets, or their subset's alone
    """

    subsets: tuple[int, int]
    overlap: float
    estimation: Estimation
    follow: Literal["matches", "blend", "subset"]


class MaterialGrid(NamedTuple):
    """The parts of the material points, and the region's outline in the first photograph [px]."""

    parts: Parts
    outline: Sequence[Polygon]


class RegionPlaces(NamedTuple):
    """Where a region is in a photograph.

    points : (rows, cols, 2) — material points, NaN where unknown [px]
    polygons : the outline [px]
    """

    points: Array
    polygons: Sequence[Polygon]


class FollowedRegion(NamedTuple):
    """A region in the next photograph.

    places : there; points of a part whose motion is unknown are NaN, and its outline stays where it is
    filled : (rows, cols) — points in subsets whose transform is that of their neighbours
    tracked : the subsets of all parts, those of one part below those of the one before
    """

    places: RegionPlaces
    filled: Mask
    tracked: TrackedSubsets


class _Matches(NamedTuple):
    """Matches (m, 2) in the region, all features of the reference photograph, and the points beside the matches.

    near : (m, 2) int — row and column of a material point on the side of each match; None for a single part
    """

    source: Array
    target: Array
    features: Array
    near: Index | None


class _Motion(NamedTuple):
    """The motion of one part; without deviations its points follow the transforms alone."""

    grid: SubsetGrid
    tracked: TrackedSubsets
    deviations: Deviations | None


def follow_region(
    material: MaterialGrid, before: RegionPlaces, pairs: tuple[Array, Array], features: Array, tracking: Tracking
) -> FollowedRegion:
    """Carry a region from one photograph to another.

    pairs : positions (m, 2) of matches in both photographs [px]
    features : (n, 2) — all features of the photograph before [px]
    """
    parts = material.parts
    matches = _in_region(parts, before, pairs, features)
    motions = [_motion(parts, part, before, matches, tracking) for part in _numbers(parts)]
    places = _carried(material, before, motions, tracking)
    filled = np.zeros(parts.number.shape, dtype=bool)
    for part, motion in zip(_numbers(parts), motions, strict=True):
        if motion is not None:
            own = _own(parts, part)
            filled[own] = motion.tracked.filled[nearest_subset(motion.grid, before.points[own])]
    every = [motion.tracked if motion else unknown_subsets(tracking.subsets) for motion in motions]
    return FollowedRegion(places, filled, TrackedSubsets(*map(np.concatenate, zip(*every, strict=True))))


def match_parts(
    material: MaterialGrid, points: Array, before: Sight, after: Sight, matching: Matching
) -> tuple[Array, Array]:
    """Positions (m, 2) of matches in two photographs, each found from matches of its own part and side [px].

    points : (rows, cols, 2) — material points in the photograph before [px]

    Features whose window holds points of another part are left out.
    """
    parts = material.parts
    places = before.features.xy.astype(float)
    near = _points_beside(parts, points, places)
    clear = np.asarray((near >= 0).all(axis=1))
    clear[clear] = _is_clear(parts, points, places[clear], near[clear], matching.window_px)
    near, features = near[clear], Features(*(values[clear] for values in before.features))
    found = match_steps(Sight(before.image, features), after, matching, _same_side(parts, near, near))
    return found.source, found.target


def beside_gaps(material: MaterialGrid, points: Array, matching: Matching) -> Mask:
    """Points (rows, cols) so near to another part, or to the other side of a cut, that no match counts there.

    points : (rows, cols, 2) — material points in a photograph [px]
    """
    found = np.zeros(points.shape[:2], dtype=bool)
    if not material.parts.is_single:
        known = np.argwhere(np.isfinite(points).all(axis=-1) & (material.parts.number > 0))
        at = tuple(known.T)
        found[at] = ~_is_clear(material.parts, points, points[at], known, matching.window_px)
    return found


def _is_clear(parts: Parts, points: Array, places: Array, near: Index, window_px: int) -> Mask:
    """Places (n, 2) whose window, with a margin for speckles, holds no point of another part or side.

    near : row and column (n, 2) of the point beside each place
    """
    spacing = float(np.nanmedian(np.linalg.norm(np.diff(parts.places, axis=1), axis=-1)))
    reach_px = 0.5 * window_px + _SPACINGS * spacing
    known = np.argwhere(np.isfinite(points).all(axis=-1) & (parts.number > 0))
    around = cKDTree(points[tuple(known.T)]).query_ball_point(places, reach_px, p=np.inf)
    count = np.array([len(found) for found in around])
    place = np.repeat(np.arange(len(places)), count)
    others = known[np.concatenate([np.zeros(0, dtype=np.int64), *(np.array(f, dtype=np.int64) for f in around)])]
    mixed = np.bincount(place, _apart(parts, near[place], others), minlength=len(places))
    return np.asarray(mixed == 0)


def _numbers(parts: Parts) -> Sequence[int]:
    """Numbers of the parts; a single one is 1."""
    return range(1, 1 + max(1, int(parts.number.max(initial=0))))


def _own(parts: Parts, part: int) -> Mask:
    """The points (rows, cols) of a part; the whole grid of a single one."""
    return np.ones(parts.number.shape, dtype=bool) if parts.is_single else np.asarray(parts.number == part)


def _in_region(parts: Parts, places: RegionPlaces, pairs: tuple[Array, Array], features: Array) -> _Matches:
    """The matches in the region; those between parts, of which the side is unknown, are left out."""
    source, target = pairs
    inside = contains(places.polygons, source)
    matches = _Matches(source[inside], target[inside], features, None)
    if parts.is_single:
        return matches
    near = _points_beside(parts, places.points, matches.source)
    known = np.asarray((near >= 0).all(axis=1))
    return matches._replace(source=matches.source[known], target=matches.target[known], near=near[known])


def _motion(parts: Parts, part: int, before: RegionPlaces, matches: _Matches, tracking: Tracking) -> _Motion | None:
    """The motion of a part; None where too few of its matches agree."""
    box = bounding_box(before.polygons) if parts.is_single else _box(before.points[parts.number == part])
    if box is None:
        return None
    if matches.near is not None:
        own = parts.number[tuple(matches.near.T)] == part
        matches = _Matches(matches.source[own], matches.target[own], matches.features, matches.near[own])
    grid = subset_grid(box, tracking.subsets, tracking.overlap)
    source, target, features, near = matches
    tracked = track_subsets(grid, before.polygons, source, target, features, tracking.estimation)
    if tracked is None or tracking.follow != "matches":
        return None if tracked is None else _Motion(grid, tracked, None)
    return _Motion(grid, tracked, deviations(grid, tracked.transforms, source, target, near))


def _carried(
    material: MaterialGrid, before: RegionPlaces, motions: Sequence[_Motion | None], tracking: Tracking
) -> RegionPlaces:
    """Points and outline after the motions of their parts."""
    parts, points = material.parts, np.full(before.points.shape, np.nan)
    for part, motion in zip(_numbers(parts), motions, strict=True):
        own = _own(parts, part)
        points[own] = _moved(parts, motion, before.points[own], np.argwhere(own), tracking)
    if parts.is_single:
        motion = motions[0]
        still = motion is None
        outline = carry(before.polygons, lambda ring: ring if still else _moved(parts, motion, ring, None, tracking))
        return RegionPlaces(points, outline)
    outline = []
    for polygon, first in zip(before.polygons, material.outline, strict=True):
        exterior, *holes = (
            _moved_corners(parts, motions, ring, near, tracking)
            for ring, near in zip(polygon.rings, _corner_points(parts, first), strict=True)
        )
        outline.append(Polygon(exterior, tuple(holes)))
    return RegionPlaces(points, outline)


def _moved_corners(
    parts: Parts, motions: Sequence[_Motion | None], ring: Array, near: Index, tracking: Tracking
) -> Array:
    """Corners (n, 2) after the motions of their parts; those of unknown motion stay. near : row and column (n, 2)."""
    moved = ring.copy()
    number = np.where((near >= 0).all(axis=1), parts.number[tuple(near.T)], 0)
    for part, motion in zip(_numbers(parts), motions, strict=True):
        own = number == part
        moved[own] = _moved(parts, motion, ring[own], near[own], tracking)
    return np.where(np.isfinite(moved), moved, ring)


def _moved(parts: Parts, motion: _Motion | None, places: Array, near: Index | None, tracking: Tracking) -> Array:
    """Places (n, 2) of one part after its motion; NaN if it is unknown.

    near : row and column (n, 2) of the points that they move with
    """
    if motion is None:
        return np.full(places.shape, np.nan)
    transforms = motion.tracked.transforms
    if motion.deviations is None:
        return carry_points(motion.grid, transforms, places, blend=tracking.follow == "blend")
    seen = _same_side(parts, near, motion.deviations.near) if len(parts.cuts) else None
    return follow_matches(motion.grid, transforms, motion.deviations, places, seen)


def _same_side(parts: Parts, of_places: Index | None, of_matches: Index | None) -> Seen | None:
    """Which matches are on the same side of all cuts as a place; None where that is unknown of all."""
    if of_places is None or of_matches is None:
        return None
    return lambda places, matches: ~_apart(parts, *np.broadcast_arrays(of_places[places], of_matches[matches]))


def _box(points: Array) -> Box | None:
    """Extent (x0, y0, x1, y1) of the known points (n, 2) [px]; None without two columns and rows."""
    known = points[np.isfinite(points).all(axis=-1)]
    if len(known) == 0 or not (np.ptp(known, axis=0) > 0.0).all():
        return None
    (x0, y0), (x1, y1) = known.min(axis=0), known.max(axis=0)
    return float(x0), float(y0), float(x1), float(y1)


def _points_beside(parts: Parts, points: Array, places: Array) -> Index:
    """Row and column (n, 2) of the point nearest to each place; −1 where the points around a place are apart.

    points : (rows, cols, 2) — of the grid; places : (n, 2) — in the same photograph [px]
    """
    known = np.argwhere(np.isfinite(points).all(axis=-1) & (parts.number > 0))
    if len(known) == 0:
        return np.full(places.shape, -1, dtype=np.int64)
    count = min(_AROUND, len(known))
    _, near = cKDTree(points[tuple(known.T)]).query(places, k=np.arange(1, count + 1))
    around = known[near]
    mixed = np.asarray(_apart(parts, np.broadcast_to(around[:, :1], around.shape), around).any(axis=1))
    return np.where(mixed[:, None], -1, around[:, 0])


def _corner_points(parts: Parts, polygon: Polygon) -> list[Index]:
    """Row and column (n, 2) of the point that each corner of a polygon moves with, ring by ring; −1 for none.

    polygon : in the first photograph [px]
    """
    own = np.argwhere(contains([polygon], parts.places) & (parts.number > 0))
    if len(own) == 0:
        return [np.full(ring.shape, -1, dtype=np.int64) for ring in polygon.rings]
    places = parts.places[tuple(own.T)]
    tree, count, found = cKDTree(places), min(_CANDIDATES, len(own)), []
    for ring in polygon.rings:
        _, near = tree.query(ring, k=np.arange(1, count + 1))
        seen = [sees(corner, places[candidates], parts.cuts) for corner, candidates in zip(ring, near, strict=True)]
        found.append(own[near[np.arange(len(ring)), np.argmax(seen, axis=1)]])
    return found


def _apart(parts: Parts, some: Index, others: Index) -> Mask:
    """Whether points of the grid, row and column (..., 2) of each, belong to different parts or sides of a cut."""
    one, other = (np.ascontiguousarray(index.reshape(-1, 2), dtype=np.int64) for index in (some, others))
    return np.asarray(_are_apart(parts, one, other).reshape(some.shape[:-1]))


@njit(**KERNEL)
def _are_apart(parts: Parts, some: Index, others: Index) -> Mask:
    """:func:`_apart` for row and column (n, 2)."""
    found = np.zeros(len(some), dtype=np.bool_)
    for n in range(len(some)):
        found[n] = are_apart(parts, some[n, 0], some[n, 1], others[n, 0], others[n, 1])
    return found
