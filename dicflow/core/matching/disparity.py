"""Disparity maps x_left − x_right of rectified images.

Semi-global matching (Hirschmüller 2008) from left to right and from right to left. Pixels on which the two disagree
are removed; the others are refined by :func:`dicflow.core.matching.subpixel.refine_disparity`.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dicflow.core.arrays import Array, Bytes, Codes, Grey, Image, Index, Mask
from dicflow.core.matching.subpixel import refine_disparity
from dicflow.core.photographs.grey import to_8bit
from dicflow.core.status import Status

__all__ = ["Disparity", "MatchingParameters", "box_around", "disparity_range", "match_rows"]

Box = tuple[int, int, int, int]

_RANGE_STEP_PX = 16
"""Semi-global matching searches ranges of disparity whose length is a multiple of this."""
_STEPS_PER_PX = 16
"""Semi-global matching returns disparities in steps of 1/16 px."""
_MAX_FEATURES = 4000
_MAX_ROW_DIFFERENCE_PX = 2.0
_MAX_DIFFERENT_BITS = 48
_SIMILAR_DISPARITY_PX = 4.0
_MIN_MATCHES = 12
_SMOOTHNESS_PENALTIES = (8, 32)
_PREFILTER_CAP = 63


class MatchingParameters(NamedTuple):
    """Parameters of the matching and of the checks of its disparities.

    window_px : side of the matching window, odd
    uniqueness_percent : margin by which the cost of the best match must be below that of the second
    left_right_px : largest difference of the two directions of matching
    speckle_px : islands of similar disparity with fewer pixels are removed
    texture : least root mean square slope of the grey level along the row, in a window half the size of the
        refinement's, so that the map ends near the specimen's edge [grey levels of 255 per px]
    refine_px : side of the window of the sub-pixel refinement, odd
    correlation : least correlation of the windows in the refinement
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

    disparity : (rows, cols) float32 — x_left − x_right [px], NaN where the status is not VALID
    status : (rows, cols) uint8 — :class:`~dicflow.core.status.Status`
    origin : (x, y) of element [0, 0] in the rectified left image [px]
    """

    disparity: Image
    status: Codes
    origin: tuple[int, int]


def box_around(bounds: tuple[float, float, float, float], margin_px: float, shape: tuple[int, int]) -> Box | None:
    """Pixels (x0, y0, x1, y1), ends excluded, of a rectangle with a margin, clipped to an image.

    bounds : (x0, y0, x1, y1) [px]
    shape : (rows, cols) of the image
    Returns None where the rectangle lies outside the image.
    """
    low = np.maximum(np.floor(np.subtract(bounds[:2], margin_px)), 0).astype(int)
    high = np.minimum(np.ceil(np.add(bounds[2:], margin_px)) + 1, shape[::-1]).astype(int)
    return None if (high <= low).any() else (int(low[0]), int(low[1]), int(high[0]), int(high[1]))


def disparity_range(left: Grey, right: Grey, mask: Mask) -> tuple[int, int] | None:
    """Range [low, high) of the disparities of matched features, with a margin; its length is a multiple of 16.

    Features (Rublee et al. 2011, ORB) match where they lie in the same rows, are each other's nearest by descriptor,
    and other matches have a similar disparity.

    left, right : (rows, cols) uint8 or uint16, rectified
    mask : (rows, cols) — pixels of the left image to search for features
    Returns None where too few features match.
    """
    rows = np.flatnonzero(mask.any(axis=1))
    if len(rows) == 0:
        return None
    band = slice(rows[0], rows[-1] + 1)
    disparities = _feature_disparities(to_8bit(left)[band], to_8bit(right)[band], mask[band])
    ordered = np.sort(disparities)
    similar = np.searchsorted(ordered, ordered + _SIMILAR_DISPARITY_PX) - np.searchsorted(
        ordered, ordered - _SIMILAR_DISPARITY_PX
    )
    ordered = ordered[similar > max(3, 0.02 * len(ordered))]
    if len(ordered) < _MIN_MATCHES:
        return None
    margin = 4.0 + 0.15 * (ordered[-1] - ordered[0])
    low = int(np.floor(ordered[0] - margin))
    length = _RANGE_STEP_PX * int(np.ceil((ordered[-1] + margin - low) / _RANGE_STEP_PX))
    spare = int(low + length - ordered[-1] - margin) // 2
    return low - spare, low - spare + length


def match_rows(left: Grey, right: Grey, box: Box, limits: tuple[int, int], matching: MatchingParameters) -> Disparity:
    """Disparity map of a part of the rectified left image; its cost is proportional to the part's area times the range.

    left, right : (rows, cols) uint8 or uint16, rectified
    box : pixels (x0, y0, x1, y1) of the left image, ends excluded
    limits : range [low, high) of disparities, a multiple of 16 long [px]
    """
    low, length = limits[0], limits[1] - limits[0]
    around = (box[0] - length, box[1], box[2] + length, box[3])
    grey_left = _crop_with_repeated_columns(left, around)
    grey_right = _crop_with_repeated_columns(right, (around[0] - low, around[1], around[2] - low, around[3]))
    bytes_left, bytes_right = to_8bit(grey_left), to_8bit(grey_right)
    forward = _semi_global_disparity(bytes_left, bytes_right, length, matching)
    backward = _semi_global_disparity(bytes_right[:, ::-1], bytes_left[:, ::-1], length, matching)[:, ::-1]
    status = _pixel_status(forward, backward, _row_texture(bytes_left, matching.refine_px // 2 | 1), matching)
    valid = _valid_only(forward, status)
    refined = refine_disparity(grey_left.astype(np.float32), grey_right.astype(np.float32), valid, matching.refine_px)
    status[(status == Status.VALID) & ~(refined.correlation >= matching.correlation)] = Status.NO_MATCH
    inside = np.s_[:, length : length + box[2] - box[0]]
    values = _valid_only(refined.disparity + np.float32(low), status)
    return Disparity(values[inside], status[inside], (box[0], box[1]))


def _valid_only(values: Image, status: Codes) -> Image:
    return np.where(status == Status.VALID, values, np.float32(np.nan))


def _feature_disparities(left: Bytes, right: Bytes, mask: Mask) -> Array:
    """Disparities (n,) of features in the same rows that are each other's nearest by descriptor [px]."""
    detector = cv2.ORB.create(_MAX_FEATURES, fastThreshold=10)
    places_left, bits_left = _features(detector, left, mask)
    places_right, bits_right = _features(detector, right, None)
    order = np.argsort(places_right[:, 1], kind="stable")
    places_right, bits_right = places_right[order], bits_right[order]
    first = np.searchsorted(places_right[:, 1], places_left[:, 1] - _MAX_ROW_DIFFERENCE_PX)
    count = np.searchsorted(places_right[:, 1], places_left[:, 1] + _MAX_ROW_DIFFERENCE_PX) - first
    i = np.repeat(np.arange(len(places_left)), count)
    j = np.arange(len(i)) - np.repeat(np.cumsum(count) - count - first, count)
    bits = np.bitwise_count(bits_left[i] ^ bits_right[j]).sum(axis=1)
    mutual = (
        _is_nearest(i, bits, len(places_left)) & _is_nearest(j, bits, len(places_right)) & (bits <= _MAX_DIFFERENT_BITS)
    )
    return np.asarray(places_left[i[mutual], 0] - places_right[j[mutual], 0])


def _features(detector: cv2.ORB, image: Bytes, mask: Mask | None) -> tuple[Array, Bytes]:
    """Places (n, 2) [px] and binary descriptors (n, 32) uint8."""
    points, bits = detector.detectAndCompute(image, None if mask is None else mask.astype(np.uint8))
    places = np.array([point.pt for point in points], dtype=float).reshape(-1, 2)
    return places, np.empty((0, 32), np.uint8) if bits is None else bits


def _is_nearest(group: Index, distance: NDArray[np.unsignedinteger], groups: int) -> Mask:
    """Which pairs (n,) have the least distance of all pairs with the same group number."""
    least = np.full(groups, np.iinfo(distance.dtype).max, dtype=distance.dtype)
    np.minimum.at(least, group, distance)
    return np.asarray(distance == least[group])


def _crop_with_repeated_columns(image: Grey, box: Box) -> Grey:
    """Part (x0, y0, x1, y1) of an image; beyond its left and right border the outermost column is repeated."""
    columns = np.clip(np.arange(box[0], box[2]), 0, image.shape[1] - 1)
    return np.ascontiguousarray(image[box[1] : box[3]][:, columns])


def _semi_global_disparity(left: Bytes, right: Bytes, length: int, matching: MatchingParameters) -> Image:
    """Disparities in [0, length) by semi-global matching, in steps of 1/16 px; NaN without a unique best match."""
    area = matching.window_px**2
    matcher = cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=length,
        blockSize=matching.window_px,
        P1=_SMOOTHNESS_PENALTIES[0] * area,
        P2=_SMOOTHNESS_PENALTIES[1] * area,
        preFilterCap=_PREFILTER_CAP,
        uniquenessRatio=matching.uniqueness_percent,
        mode=cv2.STEREO_SGBM_MODE_SGBM,
    )
    found = matcher.compute(np.ascontiguousarray(left), np.ascontiguousarray(right))
    return np.where(found >= 0, found / np.float32(_STEPS_PER_PX), np.float32(np.nan)).astype(np.float32)


def _pixel_status(forward: Image, backward: Image, texture: Image, matching: MatchingParameters) -> Codes:
    """Status of each pixel: the first check that it fails, texture first, or VALID."""
    status = np.full(forward.shape, Status.VALID, np.uint8)
    consistent = _is_consistent(forward, backward, matching.left_right_px)
    status[_is_small_island(np.where(consistent, forward, np.nan), matching.speckle_px)] = Status.SPECKLE
    status[~consistent] = Status.LEFT_RIGHT
    status[np.isnan(forward)] = Status.NO_MATCH
    status[texture < matching.texture] = Status.LOW_TEXTURE
    return status


def _is_consistent(forward: Image, backward: Image, tolerance_px: float) -> Mask:
    """Where forward and backward disparity agree within a tolerance."""
    known = np.isfinite(forward)
    partner = np.arange(forward.shape[1]) - np.round(np.where(known, forward, 0.0)).astype(int)
    back = np.take_along_axis(backward, np.clip(partner, 0, forward.shape[1] - 1), axis=1)
    with np.errstate(invalid="ignore"):
        return np.asarray(known & (np.abs(forward - back) <= tolerance_px))


def _is_small_island(disparity: Image, min_px: int) -> Mask:
    """Pixels of islands, within 1 px of disparity from neighbour to neighbour, with fewer pixels than ``min_px``."""
    coded = np.where(np.isnan(disparity), -_STEPS_PER_PX, np.round(disparity * _STEPS_PER_PX)).astype(np.int16)
    cleaned = coded.copy()
    cv2.filterSpeckles(cleaned, -_STEPS_PER_PX, min_px, _STEPS_PER_PX)
    return np.asarray(cleaned != coded)


def _row_texture(image: Bytes, window_px: int) -> Image:
    """Root mean square slope along the row in a window around every pixel [grey levels per px]."""
    slope = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
    return np.asarray(np.sqrt(cv2.blur(slope * slope, (window_px, window_px))))
