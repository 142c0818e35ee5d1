"""What stands still behind a specimen that moves: a patterned wall, a machine, a ruler.

The motion from the first photograph to a later one is estimated everywhere. A part of the pattern that stands still
while another part moves is background if the motion **jumps** at its border: the motion of the moving part,
extrapolated from its neighbourhood to the border, is not zero there. The still end of a specimen, at its grip, differs:
the motion beside it comes down to zero. A still point is background if it is nearer to a border with a jump, which
is continued straight where the motion ends. A still part without any border to a moving one, across bare surface, is
background.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Bytes, Grey, Image, Index, Mask
from dicflow.core.matching.features import detect
from dicflow.core.matching.pairs import agreeing_matches, local_motion, match_features
from dicflow.core.nearest import nearest
from dicflow.core.photographs.grey import reduced, scale_for, to_8bit
from dicflow.core.photographs.texture import speckle_size
from dicflow.core.threads import over

__all__ = ["MIN_MOTION_PX", "Motion", "estimate_motion", "still_background", "still_part"]


MIN_MOTION_PX = 2.0
"""Motion that some part must reach, before anything can be said about the background.

In pixels of photographs that are reduced to :data:`_MAX_PIXELS`, and their speckles to :data:`_FINE_PX`.
"""
_MAX_PIXELS = 2_000_000
_COARSE_PX, _FINE_PX = 8.0, 5.0
"""Diameter of speckles from which photographs are reduced, and what they are reduced to."""
_GRID_PX = 4
"""Distance of the points at which the motion is known; lengths without a unit are in these steps."""
_STILL_PX, _MOVING_PX = 0.3, 0.9
"""A point that moves less is still; one that moves more certainly moves."""
_MAX_SMOOTH_PX = 0.8
"""Largest extrapolated motion at the border of a still part of the specimen."""
_MAX_SMOOTH_SHARE, _MIN_JUMP_SHARE = 0.25, 0.5
"""The same over the median motion beside the border, and the least one where the motion jumps."""
_WINDOW_PX = 15
_MIN_CORRELATION = 0.7
"""Correlation of windows around corresponding points, from which their motion is known."""
_DETECTOR, _MAX_FEATURES = "ORB", 4000
_BLURRED, _REACH = 2.5, 12
"""Distances from the border between which the motion beside it is read: nearer, it is mixed with the still one."""
_MIN_SHARE_OF_JUMPS = 0.25
_MIN_NEIGHBOURS = 12
_NORMAL_REACH = 15
"""Distance of the points of a border from which its direction is estimated."""
_MAX_DETOUR = 15.0
"""A border with a jump may be farther than one without by this much: beside a grip it begins where the motion does."""
_SQUARE = np.ones((5, 5), np.uint8)
"""The background of reduced photographs is wider by 2, the uncertainty of its border."""
_MAX_LOST_SHARE = 0.02
"""Share of the pattern, wider than 5, without a known motion, from which features are sought."""
_MIN_PART_SHARE = 0.01
"""Least share of the pattern in a part that stands still, and in one that moves."""


class Motion(NamedTuple):
    """Motion from one photograph to another, at every fourth pixel.

    shift : (rows, cols, 2) [px]
    known : (rows, cols) bool — whether both photographs show the same there
    """

    shift: Image
    known: Mask


class _Borders(NamedTuple):
    """Points at the border of the still part.

    places : (n, 2) — row and column on the grid
    jumps : (n,) bool — whether the motion jumps there; otherwise it comes down to zero
    inward : (n, 2) — direction to the moving part
    """

    places: Index
    jumps: Mask
    inward: Array


def still_background(first: Grey, later: Sequence[Grey], textured: Mask, threads: int = 1) -> Mask | None:
    """Points of the pattern that are background, (rows, cols) bool; None where the motion is too small to tell.

    first : (height, width); a large photograph, and one of a coarse pattern, is reduced first
    later : photographs of this size, of which the first with enough motion counts
    threads : so many of them are looked at at once
    textured : (rows, cols) — points that show a pattern, on a grid over the whole photograph
    """
    scale = _working_scale(first, textured)
    before = reduced(to_8bit(first), scale)
    size = len(range(0, before.shape[1], _GRID_PX)), len(range(0, before.shape[0], _GRID_PX))
    seen = cv2.resize(textured.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0

    def still(image: Grey) -> Mask | None:
        after = reduced(to_8bit(image), scale)
        return None if _at_rest(before, after, seen) else still_part(estimate_motion(before, after, seen), seen)

    at_once = (over(threads, still, later[k : k + threads]) for k in range(0, len(later), threads))
    found = next((part for parts in at_once for part in parts if part is not None), None)
    if found is None:
        return None
    wide = cv2.dilate(found.astype(np.uint8), _SQUARE) if scale < 1.0 else found.astype(np.uint8)
    return np.asarray(textured & (cv2.resize(wide, textured.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0))


def _at_rest(before: Bytes, after: Bytes, textured: Mask) -> bool:
    """Whether photographs of half the size show that hardly anything moves by half of what counts, and nothing is lost.

    That takes a quarter of the time.
    """
    motion = _dense_motion(reduced(before, 0.5), reduced(after, 0.5), None)
    size = motion.known.shape[::-1]
    seen = cv2.resize(textured.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST) > 0
    moves = ~motion.known | (2.0 * np.linalg.norm(motion.shift, axis=-1) > 0.5 * MIN_MOTION_PX)
    return bool(np.count_nonzero(moves & _inner(seen)) < 0.5 * _MIN_PART_SHARE * np.count_nonzero(seen))


def estimate_motion(first: Bytes, later: Bytes, textured: Mask) -> Motion:
    """Motion at every fourth pixel of the first photograph, by dense inverse search (Kroeger et al. 2016).

    Parts that move too far for that search are found again from matches of features.

    textured : points that show a pattern
    """
    motion = _dense_motion(first, later, None)
    lost = textured & ~motion.known
    if np.count_nonzero(_inner(lost)) > _MAX_LOST_SHARE * np.count_nonzero(textured):
        again = _dense_motion(first, later, _motion_of_features(first, later, lost))
        better = again.known & ~motion.known
        motion = Motion(np.where(better[..., None], again.shift, motion.shift), motion.known | again.known)
    return motion


def _dense_motion(before: Bytes, after: Bytes, start: Image | None) -> Motion:
    """Motion on the grid, from a start (height, width, 2) at every pixel [px]."""
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setUseSpatialPropagation(False)  # its result depends on the number of threads
    flow = search.calc(before, after, start)
    rows, cols = (np.arange(side, dtype=np.float32) for side in before.shape)
    moved = cv2.remap(after, cols + flow[..., 0], rows[:, None] + flow[..., 1], cv2.INTER_LINEAR)
    return Motion(flow[::_GRID_PX, ::_GRID_PX], _local_correlation(before, moved) >= _MIN_CORRELATION)


def _motion_of_features(before: Bytes, after: Bytes, lost: Mask) -> Image | None:
    """Motion (height, width, 2) at every pixel, interpolated from features in the lost part; None with too few."""
    one, other = (detect(image, _DETECTOR, upright=False, max_features=_MAX_FEATURES) for image in (before, after))
    found = match_features(one, other)
    source, target = one.xy[found[:, 0]].astype(float), other.xy[found[:, 1]].astype(float)
    col, row = (source / _GRID_PX).astype(int).T
    inside = lost[row, col]
    source, target = source[inside], target[inside]
    keep = agreeing_matches(source, target)
    if np.count_nonzero(keep) < _MIN_NEIGHBOURS:
        return None
    places = np.stack(np.meshgrid(*(np.arange(0.0, side, _GRID_PX) for side in before.shape[::-1])), axis=-1)
    coarse = places.reshape(-1, 2)
    motion = local_motion(source[keep], target[keep], coarse).position - coarse
    size = before.shape[::-1]
    return np.asarray(cv2.resize(motion.reshape(places.shape).astype(np.float32), size, interpolation=cv2.INTER_LINEAR))


def _inner(mask: Mask) -> Mask:
    """A mask without the band along its edges, in which the motion is always lost."""
    return np.asarray(cv2.erode(mask.astype(np.uint8), _SQUARE) > 0)


def still_part(motion: Motion, textured: Mask) -> Mask | None:
    """Points of the pattern that stand still behind a moving part, (rows, cols) bool; None where hardly anything moves.

    textured : (rows, cols) — points that show a pattern
    """
    speed = np.linalg.norm(motion.shift, axis=-1)
    seen = _away_from_bare(textured) & motion.known
    least = max(_MIN_PART_SHARE * np.count_nonzero(textured), 1)
    if np.count_nonzero(_without_specks(seen & (speed > MIN_MOTION_PX))) < least:
        return None
    still, moving = (_without_specks(seen & part) for part in (speed < _STILL_PX, speed > _MOVING_PX))
    if np.count_nonzero(still) < least:
        return np.zeros_like(textured)
    clear = seen & (speed >= _STILL_PX) & (_distance(still) > _BLURRED)
    borders = _borders(motion.shift, still, clear)
    behind = still & (_is_behind(borders, still.shape) | _apart(still, borders, least))
    kept = (moving | still) & ~behind
    covered = np.where(seen, 0.0, np.median(speed[moving]) / _GRID_PX)  # the wall that the specimen moves over is lost
    return textured & (_distance(behind) < _distance(kept) + covered)


def _borders(shift: Image, still: Mask, clear: Mask) -> _Borders:
    """The borders of the still part, from the motion of clear points beside it."""
    edge = np.argwhere(still & (cv2.erode(still.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0))
    jumps, inward = np.full(len(edge), np.nan), np.zeros((len(edge), 2))
    for k, (i, j) in enumerate(edge):
        top, left = max(i - _REACH, 0), max(j - _REACH, 0)
        part = slice(top, i + _REACH + 1), slice(left, j + _REACH + 1)
        near = np.argwhere(clear[part]) + np.array([top - i, left - j])
        if len(near) >= _MIN_NEIGHBOURS:
            jumps[k], inward[k] = _is_jump(near, shift[part][clear[part]].astype(np.float64)), near.mean(axis=0)
    known = np.isfinite(jumps)
    return _without_outliers(_Borders(edge[known], jumps[known] > 0.5, inward[known]))


def _is_jump(offsets: Array, shifts: Array) -> float:
    """1 where the motion jumps, 0 where it comes down to zero, NaN where that is open.

    offsets : (n, 2) — of moving points from the border; shifts : (n, 2) [px]
    """
    at_border = float(np.linalg.norm(_extrapolated(offsets, shifts)))
    share = at_border / float(np.median(np.linalg.norm(shifts, axis=-1)))
    if at_border < _MAX_SMOOTH_PX or share < _MAX_SMOOTH_SHARE:
        return 0.0
    return 1.0 if share > _MIN_JUMP_SHARE else np.nan


def _without_outliers(borders: _Borders) -> _Borders:
    """The borders, each point of the sort of most points around it; a few jumps along a long border are errors."""
    if not len(borders.places):
        return borders
    votes = _sums_around(borders.places, np.where(borders.jumps, 1.0, -1.0)[None], _REACH)[0]
    jumps = votes > 0.5  # they are whole numbers, but for rounding
    return borders._replace(jumps=jumps & (jumps.mean() >= _MIN_SHARE_OF_JUMPS))


def _is_behind(borders: _Borders, shape: tuple[int, ...]) -> Mask:
    """Points (rows, cols) that are nearer to a border with a jump than to one without.

    The latter may also be nearer, by a little, for points on the outer side of the straight continuation of a border
    with a jump: the wall beside the still end of a specimen.
    """
    points = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1).astype(np.float64)
    jumps, smooth = borders.places[borders.jumps], borders.places[~borders.jumps]
    if not len(jumps):
        return np.zeros(shape, dtype=bool)
    distance, index = (table.reshape(shape) for table in nearest(jumps, points.reshape(-1, 2)))
    normals = _normals(jumps, borders.inward[borders.jumps])[index]
    outside = np.sum((points - jumps[index]) * normals, axis=-1) <= 1.0
    to_smooth = nearest(smooth, points.reshape(-1, 2))[0].reshape(shape) if len(smooth) else np.inf
    return np.asarray((distance <= to_smooth) | (outside & (distance <= to_smooth + _MAX_DETOUR)))


def _apart(still: Mask, borders: _Borders, least: float) -> Mask:
    """Points (rows, cols) of still parts that have no border to a moving one, and at least so many points."""
    count, parts = cv2.connectedComponents(cv2.morphologyEx(still.astype(np.uint8), cv2.MORPH_CLOSE, _SQUARE))
    sizes = np.bincount(parts.ravel(), minlength=count)
    apart = sizes >= least
    apart[[0, *np.unique(parts[tuple(borders.places.T)])]] = False
    return np.asarray(apart[parts])


def _normals(places: Index, inward: Array) -> Array:
    """Unit normals (n, 2) of a border at its points, towards the side of ``inward`` (n, 2)."""
    i, j = (places - places.mean(axis=0)).T
    sums = _sums_around(places, np.stack([np.ones(len(i)), i, j, i * i, i * j, j * j]), _NORMAL_REACH)
    count, (mean_i, mean_j, ii, ij, jj) = sums[0], sums[1:] / sums[0]
    spread = np.stack([ii - mean_i**2, ij - mean_i * mean_j, ij - mean_i * mean_j, jj - mean_j**2], axis=-1)
    normal = np.linalg.eigh(np.where(count[:, None] > 2, spread, np.eye(2).ravel()).reshape(-1, 2, 2))[1][..., 0]
    return np.asarray(normal * np.where(np.sum(normal * inward, axis=-1) < 0.0, -1.0, 1.0)[:, None])


def _sums_around(places: Index, values: Array, reach: int) -> Array:
    """Sums (k, n) of the values (k, n) of points at different places (n, 2), over those around each, in grid steps."""
    at = tuple(places.T)
    grid = np.zeros((len(values), *(places.max(axis=0) + 1)))
    grid[:, *at] = values
    disc = (np.hypot(*np.mgrid[-reach : reach + 1, -reach : reach + 1]) <= reach).astype(np.float64)
    return np.stack([cv2.filter2D(plane, -1, disc, borderType=cv2.BORDER_CONSTANT)[at] for plane in grid])


def _extrapolated(offsets: Array, shifts: Array) -> Array:
    """Motion (2,) at the origin of an affine field fitted to shifts (n, 2) at offsets (n, 2)."""
    design = np.column_stack([np.ones(len(offsets)), offsets])
    return np.asarray(np.linalg.lstsq(design, shifts, rcond=None)[0][0])


def _distance(mask: Mask) -> Image:
    """Distance (rows, cols) of each point from the nearest one of a mask, in grid steps; infinite for an empty mask."""
    if not mask.any():
        return np.full(mask.shape, np.inf, dtype=np.float32)
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


def _away_from_bare(textured: Mask) -> Mask:
    """Points of the pattern at some distance from bare surface, beside which the motion is not known, gaps apart."""
    closed = cv2.morphologyEx(textured.astype(np.uint8), cv2.MORPH_CLOSE, _SQUARE, iterations=2)
    return np.asarray(textured & (cv2.erode(closed, _SQUARE, iterations=2) > 0))


def _without_specks(mask: Mask) -> Mask:
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0)


def _working_scale(image: Grey, textured: Mask) -> float:
    """Scale at which a photograph has two million pixels at most, and its speckles are not large [-]."""
    scale = scale_for(image, _MAX_PIXELS)
    grey = reduced(to_8bit(image), scale)
    mask = cv2.resize(textured.astype(np.uint8), grey.shape[::-1], interpolation=cv2.INTER_NEAREST) > 0
    speckle_px = speckle_size(grey, mask) if mask.any() else np.nan
    return scale * _FINE_PX / speckle_px if speckle_px > _COARSE_PX else scale


def _local_correlation(one: Bytes, other: Bytes) -> Image:
    """Zero-mean normalised cross-correlation of the windows of two images around each point of the grid."""
    a, b = one.astype(np.float32), other.astype(np.float32)
    products = (a, b, a * b, a * a, b * b)
    mean_a, mean_b, ab, aa, bb = (
        cv2.blur(values, (_WINDOW_PX, _WINDOW_PX))[::_GRID_PX, ::_GRID_PX] for values in products
    )
    size = np.sqrt(np.maximum(aa - mean_a**2, 1e-3) * np.maximum(bb - mean_b**2, 1e-3))
    return np.asarray((ab - mean_a * mean_b) / size)
