"""Features of an image: distinctive points and their descriptors."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from dicflow.core.arrays import Bytes, Grey, Image, Index
from dicflow.core.matching.detectors import DETECTORS

__all__ = ["Box", "Descriptors", "Features", "detect", "no_features"]

Box = tuple[int, int, int, int]
Descriptors = NDArray[Any]
"""Descriptors in rows: float32 (KAZE, SIFT), or uint8 with 8 bits each (AKAZE, BRISK, ORB)."""

MARGIN_PX = 40  # margin around the box that is searched too: the reach of the largest descriptors
GRID_CELLS = 24  # cells along the longer side of the grid over which a limited number of features is spread


class Features(NamedTuple):
    """Features of one image, in order of y, then x.

    xy : (n, 2) float32 — positions [px]
    size : (n,) float32 — diameter of the described neighbourhood [px]
    angle : (n,) float32 — its orientation [deg]; 0 for upright features
    response : (n,) float32 — strength by the detector's own measure
    descriptors : (n, d)
    """

    xy: Image
    size: Image
    angle: Image
    response: Image
    descriptors: Descriptors


def detect(
    image: Grey,
    detector: str = "KAZE",
    *,
    box: Box | None = None,
    upright: bool = True,
    octaves: int = 3,
    max_features: int = 6000,
) -> Features:
    """Features of an image.

    image : (rows, cols) uint8 or uint16 grey
    detector : a name in :data:`~dicflow.core.matching.detectors.DETECTORS`
    box : (x0, y0, x1, y1) [px], ends excluded: features outside are left out
    upright : describe all features without an orientation: more matches while the specimen turns by less than about
        15° from one image to the next; BRISK always uses orientations
    octaves : doublings of scale that are searched (KAZE, AKAZE, BRISK); large speckles need more
    max_features : of more features, the strongest in each cell of a grid are kept, so that they cover the image evenly

    The grey levels are first stretched to the full range of 8 bits, because the detectors' thresholds are absolute.
    KAZE: Alcantarilla, Bartoli and Davison, ECCV 2012.
    """
    height, width = image.shape
    x0, y0, x1, y1 = box or (0, 0, width, height)
    left, top = max(0, x0 - MARGIN_PX), max(0, y0 - MARGIN_PX)
    crop = _stretched_to_8bit(image[top : y1 + MARGIN_PX, left : x1 + MARGIN_PX])
    chosen = DETECTORS[detector]
    cv2_detector = chosen.make(cv2, upright, octaves)
    keypoints, descriptors = _keypoints_and_descriptors(
        cv2_detector, crop, remove_angles=upright and chosen.upright == "afterwards"
    )
    if descriptors is None or not keypoints:
        return _no_features(cv2_detector)
    # all detectors of cv2 have pixel centres at integers
    table = np.array([(*k.pt, k.size, k.angle, k.response) for k in keypoints], dtype=np.float32)
    if upright and chosen.upright != "never":
        table[:, 3] = 0.0
    table[:, :2] += np.array([left, top], dtype=np.float32)
    x, y = table[:, 0], table[:, 1]
    keep = np.flatnonzero((x >= x0) & (x <= x1 - 1) & (y >= y0) & (y <= y1 - 1))
    keep = keep[_strongest_in_cells(table[keep], max_features)]
    order = keep[np.lexsort(table[keep].T[[4, 3, 2, 0, 1]])]
    table = table[order]
    return Features(table[:, :2], table[:, 2], table[:, 3], table[:, 4], descriptors[order])


def no_features(detector: str = "KAZE") -> Features:
    """Empty arrays of features with the descriptors of a detector."""
    return _no_features(DETECTORS[detector].make(cv2, True, 1))


def _keypoints_and_descriptors(
    cv2_detector: Any, image: Bytes, remove_angles: bool
) -> tuple[list[Any], Descriptors | None]:
    """Keypoints and descriptors; ``remove_angles`` sets all angles to 0 before the description."""
    if not remove_angles:
        keypoints, descriptors = cv2_detector.detectAndCompute(image, None)
        return list(keypoints), descriptors
    upright = {(k.pt, k.size): k for k in cv2_detector.detect(image, None)}  # SIFT repeats a point for each orientation
    for keypoint in upright.values():
        keypoint.angle = 0.0
    keypoints, descriptors = cv2_detector.compute(image, list(upright.values()))
    return list(keypoints), descriptors


def _no_features(cv2_detector: Any) -> Features:
    """Empty arrays of features, with descriptors of the detector's size and type."""
    dtype = np.float32 if cv2_detector.descriptorType() == cv2.CV_32F else np.uint8
    empty = np.zeros(0, dtype=np.float32)
    return Features(empty.reshape(0, 2), empty, empty, empty, np.zeros((0, cv2_detector.descriptorSize()), dtype=dtype))


def _stretched_to_8bit(image: Grey) -> Bytes:
    """Grey levels between the 0.1 and 99.9 percentiles, stretched to 0 … 255."""
    low, high = np.percentile(image, [0.1, 99.9])
    scaled = (image.astype(np.float32) - np.float32(low)) * np.float32(255 / max(high - low, 1.0))
    return np.asarray(np.clip(np.rint(scaled), 0, 255), dtype=np.uint8)


def _strongest_in_cells(table: Image, limit: int) -> Index:
    """Rows of at most ``limit`` features: the strongest of each cell, then the second strongest of each, and so on.

    table : (n, 5) — x, y, size, angle, response
    """
    if len(table) <= limit:
        return np.arange(len(table))
    xy, response = table[:, :2], table[:, 4]
    cell = ((xy - xy.min(axis=0)) * ((GRID_CELLS - 1e-3) / np.ptp(xy, axis=0).max())).astype(int)
    flat = cell[:, 1] * GRID_CELLS + cell[:, 0]
    by_cell = np.lexsort((-response, flat))
    first = np.searchsorted(flat[by_cell], flat[by_cell])
    rank = np.empty(len(table), dtype=int)
    rank[by_cell] = np.arange(len(table)) - first
    return np.lexsort((-response, rank))[:limit]
