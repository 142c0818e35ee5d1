"""What stands still behind a specimen that moves: a patterned wall, a machine, a ruler.

The motion from the first photograph to a later one is estimated everywhere. A part of the pattern that stands still
while another part moves is background if the motion **jumps** at its border: the motion of the moving part,
extrapolated from its neighbourhood to the border, is not zero there. The still end of a specimen, at its grip, differs:
the motion beside it comes down to zero. A still point is background if it lies outside the border with a jump that is
nearest to it, continued straight where the motion ends, and not much nearer to a border without a jump. A still part
without any border to a moving one, across bare surface, is background.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from scipy.spatial import cKDTree

from dicflow.core.arrays import Array, Bytes, Grey, Image, Mask
from dicflow.core.matching.features import detect
from dicflow.core.matching.pairs import agreeing_matches, local_motion, match_features
from dicflow.core.photographs.grey import to_8bit

__all__ = ["MIN_MOTION_PX", "Motion", "estimate_motion", "still_background"]


MIN_MOTION_PX = 2.0
"""Motion that some part must reach, before anything can be said about the background."""
_MAX_PIXELS = 2_000_000
_STILL_PX, _MOVING_PX = 0.3, 0.9
"""A point that moves less is still; one that moves more certainly moves."""
_MAX_SMOOTH_PX = 0.8
"""Largest extrapolated motion at the border of a still part of the specimen."""
_MAX_SMOOTH_SHARE, _MIN_JUMP_SHARE = 0.25, 0.5
"""The same over the median motion beside the border, and the least one where the motion jumps."""
_WINDOW_PX = 15
_MIN_CORRELATION = 0.7
"""Correlation of windows around corresponding points, from which their motion is known."""
_DETECTOR = "SIFT"
_BLURRED_PX, _REACH_PX = 10.0, 48.0
"""Distances from the border between which the motion beside it is read: nearer, it is mixed with the still one."""
_MIN_SHARE_OF_JUMPS = 0.25
_MIN_NEIGHBOURS = 12
_NORMAL_REACH = 15
"""Points of a border from which its direction is estimated, in grid steps."""
_MAX_DETOUR_PX = 60.0
"""A border with a jump may be farther than one without by this much: beside a grip it begins where the motion does."""
_BAND, _MAX_LOST_SHARE = 5, 0.02
"""Width of a part of the pattern without a known motion [grid steps], and its share from which features are sought."""
_MIN_PART_SHARE = 0.01
"""Least share of the pattern in a part that stands still, and in one that moves."""


class Motion(NamedTuple):
    """Motion from one photograph to another, on every ``stride``-th pixel.

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

    places: Array
    jumps: Mask
    inward: Array


def estimate_motion(first: Grey, later: Grey, textured: Mask, stride_px: int) -> Motion:
    """Motion at the pixels (j, i) · stride of the first photograph, by dense inverse search (Kroeger et al., ECCV 2016).

    Parts that move too far for that search are found again from matches of features.

    first, later : (rows, cols), of one size; large ones are reduced to two million pixels
    textured : points that show a pattern
    """
    scale = min(1.0, float(np.sqrt(_MAX_PIXELS / first.size)))
    before, after = (_reduced(to_8bit(image), scale) for image in (first, later))
    rows, cols = (np.arange(0, side, stride_px, dtype=np.float32) for side in first.shape)
    places = np.stack(np.meshgrid((cols + 0.5) * scale - 0.5, (rows + 0.5) * scale - 0.5), axis=-1)
    motion = _dense_motion(before, after, places, None)
    lost = textured & ~motion.known
    inner = cv2.erode(lost.astype(np.uint8), np.ones((_BAND, _BAND), np.uint8))  # a band along the edges is always lost
    if np.count_nonzero(inner) > _MAX_LOST_SHARE * np.count_nonzero(textured):
        again = _dense_motion(before, after, places, _motion_of_features(before, after, places, lost))
        better = again.known & ~motion.known
        motion = Motion(np.where(better[..., None], again.shift, motion.shift), motion.known | again.known)
    return Motion(motion.shift / np.float32(scale), motion.known)


def _dense_motion(before: Bytes, after: Bytes, places: Image, start: Image | None) -> Motion:
    """Motion at places (rows, cols, 2), from a start (height, width, 2) at every pixel [px]."""
    search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
    search.setUseSpatialPropagation(False)  # its result depends on the number of threads
    flow = search.calc(before, after, start)
    y, x = np.mgrid[: before.shape[0], : before.shape[1]].astype(np.float32)
    moved = cv2.remap(after, x + flow[..., 0], y + flow[..., 1], cv2.INTER_LINEAR)
    agree = (_local_correlation(before, moved) >= _MIN_CORRELATION).astype(np.float32)
    shift = cv2.remap(flow, places, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return Motion(shift, cv2.remap(agree, places, None, cv2.INTER_NEAREST, borderMode=cv2.BORDER_REPLICATE) > 0.5)


def _motion_of_features(before: Bytes, after: Bytes, places: Image, lost: Mask) -> Image | None:
    """Motion (height, width, 2) at every pixel, interpolated from features in the lost part; None with too few."""
    one, other = (detect(image, _DETECTOR, upright=False) for image in (before, after))
    found = match_features(one, other)
    source, target = one.xy[found[:, 0]].astype(float), other.xy[found[:, 1]].astype(float)
    row, col = (np.searchsorted(places[:, 0, 1], source[:, 1]) - 1, np.searchsorted(places[0, :, 0], source[:, 0]) - 1)
    inside = lost[row, col]
    source, target = source[inside], target[inside]
    keep = agreeing_matches(source, target)
    if np.count_nonzero(keep) < _MIN_NEIGHBOURS:
        return None
    coarse = places.reshape(-1, 2).astype(float)
    motion = local_motion(source[keep], target[keep], coarse).position - coarse
    size = before.shape[::-1]
    return np.asarray(cv2.resize(motion.reshape(places.shape).astype(np.float32), size, interpolation=cv2.INTER_LINEAR))


def still_background(motion: Motion, textured: Mask, stride_px: int) -> Mask | None:
    """Points of the pattern that are background, (rows, cols) bool; None where the motion is too small to tell.

    textured : (rows, cols) — points that show a pattern
    """
    speed = np.linalg.norm(motion.shift, axis=-1)
    seen = textured & motion.known
    least = max(_MIN_PART_SHARE * np.count_nonzero(textured), 1)
    if np.count_nonzero(_without_specks(seen & (speed > MIN_MOTION_PX))) < least:
        return None
    still, moving = (_without_specks(seen & part) for part in (speed < _STILL_PX, speed > _MOVING_PX))
    if np.count_nonzero(still) < least:
        return np.zeros_like(textured)
    clear = seen & (speed >= _STILL_PX) & (_distance(still) * stride_px > _BLURRED_PX)
    behind = still & _is_behind(_borders(motion.shift, still, clear, stride_px), still.shape, stride_px)
    kept = (moving | still) & ~behind
    return textured & (_distance(behind) < _distance(kept))


def _borders(shift: Image, still: Mask, clear: Mask, stride_px: int) -> _Borders:
    """The borders of the still part, from the motion of clear points beside it."""
    edge = np.argwhere(still & (cv2.erode(still.astype(np.uint8), np.ones((3, 3), np.uint8)) == 0))
    jumps, inward = np.full(len(edge), np.nan), np.zeros((len(edge), 2))
    reach = round(_REACH_PX / stride_px)
    for k, (i, j) in enumerate(edge):
        top, left = max(i - reach, 0), max(j - reach, 0)
        part = slice(top, i + reach + 1), slice(left, j + reach + 1)
        near = np.argwhere(clear[part]) + (top - i, left - j)
        if len(near) >= _MIN_NEIGHBOURS:
            jumps[k], inward[k] = _is_jump(near, shift[part][clear[part]].astype(np.float64)), near.mean(axis=0)
    known = np.isfinite(jumps)
    return _without_outliers(_Borders(edge[known], jumps[known] > 0.5, inward[known]), reach)


def _is_jump(offsets: Array, shifts: Array) -> float:
    """1 where the motion jumps, 0 where it comes down to zero, NaN where that is open.

    offsets : (n, 2) — of moving points from the border; shifts : (n, 2) [px]
    """
    at_border = float(np.linalg.norm(_extrapolated(offsets, shifts)))
    share = at_border / float(np.median(np.linalg.norm(shifts, axis=-1)))
    if at_border < _MAX_SMOOTH_PX or share < _MAX_SMOOTH_SHARE:
        return 0.0
    return 1.0 if share > _MIN_JUMP_SHARE else np.nan


def _without_outliers(borders: _Borders, reach: int) -> _Borders:
    """The borders, each point of the sort that most points around it are of; a few jumps in a long border are errors."""
    if not len(borders.places):
        return borders
    near = cKDTree(borders.places).query_ball_point(borders.places, reach)
    jumps = np.array([borders.jumps[others].mean() > 0.5 for others in near])
    return borders._replace(jumps=jumps & (jumps.mean() >= _MIN_SHARE_OF_JUMPS))


def _is_behind(borders: _Borders, shape: tuple[int, ...], stride_px: int) -> Mask:
    """Points (rows, cols) on the outer side of the nearest border with a jump, unless one without is much nearer.

    The outer side is told by the straight continuation of the border, so that the still end of a specimen is not taken
    for the wall beside it.
    """
    points = np.stack(np.meshgrid(np.arange(shape[0]), np.arange(shape[1]), indexing="ij"), axis=-1)
    jumps, smooth = borders.places[borders.jumps], borders.places[~borders.jumps]
    if not len(jumps):
        return np.full(shape, not len(smooth))
    distance, nearest = cKDTree(jumps).query(points)
    outside = (
        np.sum((points - jumps[nearest]) * _normals(jumps, borders.inward[borders.jumps])[nearest], axis=-1) <= 1.0
    )
    to_smooth = cKDTree(smooth).query(points)[0] if len(smooth) else np.inf
    return np.asarray(outside & (distance <= to_smooth + _MAX_DETOUR_PX / stride_px))


def _normals(places: Array, inward: Array) -> Array:
    """Unit normals (n, 2) of a border at its points, towards the side of ``inward`` (n, 2)."""
    near = cKDTree(places).query_ball_point(places, _NORMAL_REACH)
    spread = np.stack([np.cov(places[others].T) if len(others) > 2 else np.eye(2) for others in near])
    normal = np.linalg.eigh(spread)[1][..., 0]
    return np.asarray(normal * np.where(np.sum(normal * inward, axis=-1) < 0.0, -1.0, 1.0)[:, None])


def _extrapolated(offsets: Array, shifts: Array) -> Array:
    """Motion (2,) at the origin of an affine field fitted to shifts (n, 2) at offsets (n, 2)."""
    design = np.column_stack([np.ones(len(offsets)), offsets])
    return np.asarray(np.linalg.lstsq(design, shifts, rcond=None)[0][0])


def _distance(mask: Mask) -> Image:
    """Distance (rows, cols) of each point from the nearest one of a mask, in grid steps; infinite for an empty mask."""
    if not mask.any():
        return np.full(mask.shape, np.inf, dtype=np.float32)
    return np.asarray(cv2.distanceTransform((~mask).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE))


def _without_specks(mask: Mask) -> Mask:
    return np.asarray(cv2.morphologyEx(mask.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8)) > 0)


def _reduced(grey: Bytes, scale: float) -> Bytes:
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1.0 else grey
    return np.asarray(small, dtype=np.uint8)


def _local_correlation(one: Bytes, other: Bytes) -> Image:
    """Zero-mean normalised cross-correlation of the windows around each pixel of two images."""
    a, b = one.astype(np.float32), other.astype(np.float32)
    mean_a, mean_b, ab, aa, bb = (cv2.blur(values, (_WINDOW_PX, _WINDOW_PX)) for values in (a, b, a * b, a * a, b * b))
    size = np.sqrt(np.maximum(aa - mean_a**2, 1e-3) * np.maximum(bb - mean_b**2, 1e-3))
    return np.asarray((ab - mean_a * mean_b) / size)
