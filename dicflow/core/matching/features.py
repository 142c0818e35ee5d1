"""Distinct points of an image and their descriptors."""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from dicflow.core.arrays import Image
from dicflow.core.matching.detectors import DETECTORS

__all__ = ["Box", "Features", "detect"]

Box = tuple[int, int, int, int]

MARGIN = 40  # px around the box that detectors see too: their largest descriptors reach about so far
CELLS = 24  # cells along the longer side between which a limited number of features is shared out


class Features(NamedTuple):
    """Features of one image, in order of y, then x.

    xy : (n, 2) float32 — positions [px]
    size : (n,) float32 — diameter of the neighbourhood that is described [px]
    angle : (n,) float32 — its orientation [deg]; 0 where features are upright
    response : (n,) float32 — the detector's measure of strength
    descriptors : (n, d) — float32 (KAZE, SIFT) or uint8, 8 bits each (AKAZE, BRISK, ORB)
    """

    xy: Image
    size: Image
    angle: Image
    response: Image
    descriptors: npt.NDArray[Any]


def detect(
    image: npt.NDArray[Any],
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
    box : (x0, y0, x1, y1) [px], ends excluded: features outside are left out and, but for a margin, not searched
    upright : describe without an orientation of their own: more matches, as long as the specimen turns by less than
        about 15° from one image to the next; BRISK always has orientations
    octaves : doublings of scale that are searched (KAZE, AKAZE, BRISK); large speckles need more
    max_features : above this number the strongest ones in each cell of a grid are kept, so that they stay spread out

    The grey levels are stretched to the full range of 8 bits first, since the detectors' thresholds are absolute.
    KAZE: Alcantarilla, Bartoli and Davison, ECCV 2012.
    """
    height, width = image.shape
    x0, y0, x1, y1 = box or (0, 0, width, height)
    left, top = max(0, x0 - MARGIN), max(0, y0 - MARGIN)
    crop = _stretched(image[top : y1 + MARGIN, left : x1 + MARGIN])
    chosen = DETECTORS[detector]
    finder = chosen.make(cv2, upright, octaves)
    keypoints, descriptors = _describe(finder, crop, recompute=upright and chosen.upright == "afterwards")
    if descriptors is None or not keypoints:
        return _none(finder)
    # cv2's corner detectors and SIFT, like KAZE, put pixel centres at integers
    table = np.array([(*k.pt, k.size, k.angle, k.response) for k in keypoints], dtype=np.float32)
    if upright and chosen.upright != "never":
        table[:, 3] = 0.0
    table[:, :2] += np.array([left, top], dtype=np.float32)
    x, y = table[:, 0], table[:, 1]
    keep = np.flatnonzero((x >= x0) & (x <= x1 - 1) & (y >= y0) & (y <= y1 - 1))
    keep = keep[_spread(table[keep], max_features)]
    order = keep[np.lexsort(table[keep].T[[4, 3, 2, 0, 1]])]
    table = table[order]
    return Features(table[:, :2], table[:, 2], table[:, 3], table[:, 4], descriptors[order])


def _describe(finder: Any, image: npt.NDArray[np.uint8], recompute: bool) -> tuple[list[Any], npt.NDArray[Any] | None]:
    """Keypoints and descriptors; ``recompute`` turns all keypoints upright before they are described."""
    if not recompute:
        keypoints, descriptors = finder.detectAndCompute(image, None)
        return list(keypoints), descriptors
    upright = {(k.pt, k.size): k for k in finder.detect(image, None)}  # SIFT repeats a place per orientation
    for keypoint in upright.values():
        keypoint.angle = 0.0
    keypoints, descriptors = finder.compute(image, list(upright.values()))
    return list(keypoints), descriptors


def _none(finder: Any) -> Features:
    """No features at all, with the detector's own kind of descriptors."""
    dtype = np.float32 if finder.descriptorType() == cv2.CV_32F else np.uint8
    empty = np.zeros(0, dtype=np.float32)
    return Features(empty.reshape(0, 2), empty, empty, empty, np.zeros((0, finder.descriptorSize()), dtype=dtype))


def _stretched(image: npt.NDArray[Any]) -> npt.NDArray[np.uint8]:
    """Grey levels between the 0.1 and 99.9 percentiles spread over 0 … 255."""
    low, high = np.percentile(image, [0.1, 99.9])
    scaled = (image.astype(np.float32) - np.float32(low)) * np.float32(255 / max(high - low, 1.0))
    return np.asarray(np.clip(np.rint(scaled), 0, 255), dtype=np.uint8)


def _spread(table: Image, limit: int) -> npt.NDArray[np.intp]:
    """Rows to keep: of each cell first the strongest, then the second strongest, … until the limit is reached.

    table : (n, 5) — x, y, size, angle, response
    """
    if len(table) <= limit:
        return np.arange(len(table))
    xy, response = table[:, :2], table[:, 4]
    cell = ((xy - xy.min(axis=0)) * ((CELLS - 1e-3) / np.ptp(xy, axis=0).max())).astype(int)
    flat = cell[:, 1] * CELLS + cell[:, 0]
    by_cell = np.lexsort((-response, flat))
    first = np.searchsorted(flat[by_cell], flat[by_cell])
    rank = np.empty(len(table), dtype=int)
    rank[by_cell] = np.arange(len(table)) - first
    return np.lexsort((-response, rank))[:limit]
