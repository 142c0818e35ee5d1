"""A simple outline for a person to edit: smooth, with few corners, inside of a region."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from dicflow.core.arrays import Bytes, Mask
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import area, carry, mask_polygons, rasterise

__all__ = ["simple_outline"]

_MOST_SIDE = 1000
"""Side of the mask in which the outline is found [px]."""
_TOLERANCES = (1, 2, 3, 4, 6, 8)
"""Deviations of the outline that are tried [px of that mask]."""
_MOST_CORNERS = 12
_LEAST_AREA = 0.9
"""Of the smooth region; an outline with fewer corners that covers less is not taken."""


def simple_outline(polygons: Sequence[Polygon], shape: tuple[int, int], smoothing_px: float) -> list[Polygon]:
    """The largest part of a region without what is narrower than a length, with few corners, inside of the region.

    shape : rows and columns of the photograph
    smoothing_px : spikes, necks and bays that are narrower are cut off

    The region is moved inwards by as much as its simplified outline may deviate. Returns the region itself where no
    part of it is as wide.
    """
    scale = max(1, -(-max(shape) // _MOST_SIDE))
    inside = _reduced(rasterise(polygons, shape), scale)
    smooth = _opened(inside, max(1, round(0.5 * smoothing_px / scale)))
    best: list[Polygon] = []
    for tolerance in _TOLERANCES:
        found = _simplified(smooth, tolerance)
        if not found or (best and area(found) < _LEAST_AREA * float(smooth.sum())):
            break
        best = found
        if sum(len(ring) for ring in found[0].rings) <= _MOST_CORNERS * len(found[0].rings):
            break
    return carry(best, lambda ring: ring * scale + 0.5 * (scale - 1)) if best else list(polygons)


def _reduced(mask: Mask, scale: int) -> Mask:
    """Blocks of a mask that lie inside as a whole."""
    rows, cols = (side // scale for side in mask.shape)
    blocks = mask[: rows * scale, : cols * scale].reshape(rows, scale, cols, scale)
    return np.asarray(blocks.all(axis=(1, 3)))


def _opened(mask: Mask, radius: int) -> Mask:
    """The largest part of a mask without what a disc does not fit into."""
    opened = cv2.morphologyEx(np.pad(mask.astype(np.uint8), 1), cv2.MORPH_OPEN, _disc(radius))[1:-1, 1:-1]
    count, labels, stats, _ = cv2.connectedComponentsWithStats(opened, connectivity=4)
    if count < 2:
        return np.zeros(mask.shape, dtype=np.bool_)
    return np.asarray(labels == 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax()))


def _simplified(mask: Mask, tolerance: int) -> list[Polygon]:
    """The outline of a mask, moved inwards and simplified by a tolerance [px]."""
    within = cv2.erode(np.pad(mask.astype(np.uint8), 1), _disc(tolerance))[1:-1, 1:-1]
    return mask_polygons(within > 0, tolerance_px=float(tolerance), least_area_px=16.0 * tolerance**2)[:1]


def _disc(radius: int) -> Bytes:
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)), dtype=np.uint8)
