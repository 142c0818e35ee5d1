"""Disparity: how far to the left the partner of a rectified left pixel lies in the right image.

Semi-global matching (Hirschmüller 2008) from left to right and from right to left; what the two disagree on is taken
out, and what is left is refined by :func:`dicflow.core.matching.subpixel.refine`.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dicflow.core.arrays import Array, Image, Mask
from dicflow.core.matching.subpixel import refine
from dicflow.core.photographs.grey import to_8bit
from dicflow.core.status import Status

__all__ = ["Disparity", "Matching", "box_around", "disparity_range", "match_rows"]

Box = tuple[int, int, int, int]

_STEP = 16
_FEATURES = 4000
_ROWS_APART_PX = 2.0
_FARTHEST_BITS = 48
_NEIGHBOURS_PX = 4.0
_FEWEST_MATCHES = 12
_PENALTIES = (8, 32)
_PREFILTER = 63


class Matching(NamedTuple):
    """How disparities are matched and which are kept.

    window_px : side of the window that is compared, odd
    uniqueness_percent : margin by which the best match must beat the second
    left_right_px : how far both directions of matching may disagree
    speckle_px : islands of similar disparity of fewer pixels are taken out
    texture : least root mean square of the grey level's slope along the row, in a window of half the size of the
        refinement's, so that it ends near the specimen's edge [grey levels of 255 per px]
    refine_px : side of the window of the sub-pixel refinement, odd
    correlation : least correlation of the windows that the refinement compares
    """

    window_px: int = 5
    uniqueness_percent: int = 5
    left_right_px: float = 1.0
    speckle_px: int = 200
    texture: float = 1.5
    refine_px: int = 21
    correlation: float = 0.6


class Disparity(NamedTuple):
    """A disparity map of a part of the rectified left image.

    disparity : (rows, cols) float32 — x_left − x_right [px], NaN where there is none
    status : (rows, cols) uint8 — :class:`~dicflow.core.status.Status`
    origin : (x, y) of element [0, 0] in the rectified left image [px]
    """

    disparity: Image
    status: NDArray[np.uint8]
    origin: tuple[int, int]


def box_around(bounds: tuple[float, float, float, float], margin_px: float, shape: tuple[int, int]) -> Box | None:
    """Columns and rows (x0, y0, x1, y1), ends excluded, of a rectangle with a margin, cut to an image.

    bounds : (x0, y0, x1, y1) [px]
    shape : (rows, cols) of the image
    Returns None where nothing of it lies in the image.
    """
    low = np.maximum(np.floor(np.subtract(bounds[:2], margin_px)), 0).astype(int)
    high = np.minimum(np.ceil(np.add(bounds[2:], margin_px)) + 1, shape[::-1]).astype(int)
    return None if (high <= low).any() else (int(low[0]), int(low[1]), int(high[0]), int(high[1]))


def disparity_range(left: NDArray[Any], right: NDArray[Any], mask: Mask) -> tuple[int, int] | None:
    """Range [low, high) of disparities, from matched features, widened; its length is a multiple of 16.

    Features (Rublee et al. 2011, ORB) match where they lie in the same rows, are each other's nearest, and have company
    at a similar disparity.

    left, right : (rows, cols) uint8 or uint16, rectified
    mask : (rows, cols) — pixels of the left image that count
    Returns None where too few features match.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    if len(rows) == 0:
        return None
    band = slice(rows[0], rows[-1] + 1)
    found = _matched_disparities(to_8bit(left)[band], to_8bit(right)[band], mask[band])
    ordered = np.sort(found)
    company = np.searchsorted(ordered, ordered + _NEIGHBOURS_PX) - np.searchsorted(ordered, ordered - _NEIGHBOURS_PX)
    ordered = ordered[company > max(3, 0.02 * len(ordered))]
    if len(ordered) < _FEWEST_MATCHES:
        return None
    widening = 4.0 + 0.15 * (ordered[-1] - ordered[0])
    low = int(np.floor(ordered[0] - widening))
    length = _STEP * int(np.ceil((ordered[-1] + widening - low) / _STEP))
    spare = int(low + length - ordered[-1] - widening) // 2
    return low - spare, low - spare + length


def match_rows(
    left: NDArray[Any], right: NDArray[Any], box: Box, limits: tuple[int, int], matching: Matching
) -> Disparity:
    """Match a part of the rectified left image. The time it takes follows the part's area times the range.

    left, right : (rows, cols) uint8 or uint16, rectified
    box : columns and rows (x0, y0, x1, y1) of the left image, ends excluded
    limits : range [low, high) of disparities, a multiple of 16 long [px]
    """
    low, length = limits[0], limits[1] - limits[0]
    around = (box[0] - length, box[1], box[2] + length, box[3])
    grey_left = _part(left, around)
    grey_right = _part(right, (around[0] - low, around[1], around[2] - low, around[3]))
    bytes_left, bytes_right = to_8bit(grey_left), to_8bit(grey_right)
    found = _semi_global(bytes_left, bytes_right, length, matching)
    backward = _semi_global(bytes_right[:, ::-1], bytes_left[:, ::-1], length, matching)[:, ::-1]
    status = _judge(found, backward, _texture(bytes_left, matching.refine_px // 2 | 1), matching)
    kept = _where_valid(found, status)
    refined = refine(grey_left.astype(np.float32), grey_right.astype(np.float32), kept, matching.refine_px)
    status[(status == Status.VALID) & ~(refined.correlation >= matching.correlation)] = Status.NO_MATCH
    inside = np.s_[:, length : length + box[2] - box[0]]
    values = _where_valid(refined.disparity + np.float32(low), status)
    return Disparity(values[inside], status[inside], (box[0], box[1]))


def _where_valid(values: Image, status: NDArray[np.uint8]) -> Image:
    return np.where(status == Status.VALID, values, np.float32(np.nan))


def _matched_disparities(left: NDArray[np.uint8], right: NDArray[np.uint8], mask: Mask) -> Array:
    """Disparities (n,) of features in the same rows that are each other's nearest by descriptor [px]."""
    detector = cv2.ORB.create(_FEATURES, fastThreshold=10)
    places_left, bits_left = _features(detector, left, mask)
    places_right, bits_right = _features(detector, right, None)
    order = np.argsort(places_right[:, 1], kind="stable")
    places_right, bits_right = places_right[order], bits_right[order]
    first = np.searchsorted(places_right[:, 1], places_left[:, 1] - _ROWS_APART_PX)
    count = np.searchsorted(places_right[:, 1], places_left[:, 1] + _ROWS_APART_PX) - first
    i = np.repeat(np.arange(len(places_left)), count)
    j = np.arange(len(i)) - np.repeat(np.cumsum(count) - count - first, count)
    bits = np.bitwise_count(bits_left[i] ^ bits_right[j]).sum(axis=1)
    mutual = _nearest(i, bits, len(places_left)) & _nearest(j, bits, len(places_right)) & (bits <= _FARTHEST_BITS)
    return np.asarray(places_left[i[mutual], 0] - places_right[j[mutual], 0])


def _features(detector: Any, image: NDArray[np.uint8], mask: Mask | None) -> tuple[Array, Any]:
    """Places (n, 2) [px] and binary descriptors (n, 32) uint8."""
    points, bits = detector.detectAndCompute(image, None if mask is None else mask.astype(np.uint8))
    places = np.array([point.pt for point in points], dtype=float).reshape(-1, 2)
    return places, np.empty((0, 32), np.uint8) if bits is None else bits


def _nearest(group: NDArray[np.intp], distance: NDArray[Any], groups: int) -> Mask:
    """Which pairs have the least distance of their group."""
    least = np.full(groups, np.iinfo(distance.dtype).max, dtype=distance.dtype)
    np.minimum.at(least, group, distance)
    return np.asarray(distance == least[group])


def _part(image: NDArray[Any], box: Box) -> NDArray[Any]:
    """Part (x0, y0, x1, y1) of an image; where it leaves the image at the sides the outermost column is repeated."""
    columns = np.clip(np.arange(box[0], box[2]), 0, image.shape[1] - 1)
    return np.ascontiguousarray(image[box[1] : box[3]][:, columns])


def _semi_global(left: NDArray[np.uint8], right: NDArray[np.uint8], length: int, matching: Matching) -> Image:
    """Disparities in [0, length) by semi-global matching, in steps of 1/16 px; NaN where none stands out."""
    area = matching.window_px**2
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=length,
        blockSize=matching.window_px,
        P1=_PENALTIES[0] * area,
        P2=_PENALTIES[1] * area,
        preFilterCap=_PREFILTER,
        uniquenessRatio=matching.uniqueness_percent,
        mode=cv2.STEREO_SGBM_MODE_SGBM,
    )
    found = matcher.compute(np.ascontiguousarray(left), np.ascontiguousarray(right))
    return np.where(found >= 0, found / np.float32(_STEP), np.float32(np.nan)).astype(np.float32)


def _judge(found: Image, backward: Image, texture: Image, matching: Matching) -> NDArray[np.uint8]:
    """Status of each pixel: the first reason against it."""
    status = np.full(found.shape, Status.VALID, np.uint8)
    agree = _agree(found, backward, matching.left_right_px)
    status[_islands(np.where(agree, found, np.nan), matching.speckle_px)] = Status.SPECKLE
    status[~agree] = Status.LEFT_RIGHT
    status[np.isnan(found)] = Status.NO_MATCH
    status[texture < matching.texture] = Status.LOW_TEXTURE
    return status


def _agree(found: Image, backward: Image, tolerance_px: float) -> Mask:
    """Where the partner's own partner is the pixel itself, to the tolerance."""
    known = np.isfinite(found)
    partner = np.arange(found.shape[1]) - np.round(np.where(known, found, 0.0)).astype(int)
    back = np.take_along_axis(backward, np.clip(partner, 0, found.shape[1] - 1), axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(known & (np.abs(found - back) <= tolerance_px))


def _islands(found: Image, least_px: int) -> Mask:
    """Pixels of connected parts, within 1 px of disparity from neighbour to neighbour, that are too small."""
    coded = np.where(np.isnan(found), -_STEP, np.round(found * _STEP)).astype(np.int16)
    cleaned = coded.copy()
    cv2.filterSpeckles(cleaned, -_STEP, least_px, _STEP)
    return np.asarray(cleaned != coded)


def _texture(image: NDArray[np.uint8], window_px: int) -> Image:
    """Root mean square slope along the row around every pixel [grey levels per px]."""
    slope = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    return np.asarray(np.sqrt(cv2.blur(slope * slope, (window_px, window_px))))
