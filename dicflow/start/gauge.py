"""An extensometer along the load, over the region of the first photograph."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import cv2
import numpy as np

from dicflow.core.matching.features import detect
from dicflow.core.matching.pairs import consistent_matches, match_features
from dicflow.core.matching.transform import estimate_transform
from dicflow.core.photographs.grey import reduced, scale_for, to_8bit
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import bounding_box, contains, rasterise
from dicflow.engine.files import FilePart

__all__ = ["Gauge", "gauge_over", "in_8bit"]

Read = Callable[[Path | FilePart], np.ndarray]
Axis = Literal["x", "y"]
Place = tuple[int, int]

_MAX_PIXELS = 1_000_000
_MIN_MATCHES = 30
_MIN_DIFFERENCE = 1e-3
"""Least difference of the stretches along x and y that tells the load's axis; matches are good to about 0.0002."""
_MIN_CONSISTENT = 0.5
"""Least share of the matches that move like their neighbours."""
_MARGIN_PX = 30
_ENDS = (0.1, 0.15, 0.2, 0.25, 0.3, 0.35, 0.4)
"""Distance of the gauge points from the region's ends, over its length; the least that lies inside is used."""


class Gauge(NamedTuple):
    """An extensometer.

    axis : of the load in the photograph, x to the right or y down
    reason : what tells the axis
    ends : its two points in the first left photograph [px]
    """

    axis: Axis
    reason: str
    ends: tuple[Place, Place]


def gauge_over(polygons: Sequence[Polygon], photographs: Sequence[Path | FilePart], read: Read) -> Gauge | None:
    """An extensometer along the load through the middle of a region; None if the region is too narrow for one.

    polygons : the region in the first photograph [px]
    photographs : of the left camera, in the order of the steps
    read : gives the grey levels (row, col) of a photograph
    """
    first = read(photographs[0])
    axis, reason = _load_axis(polygons, first, photographs, read)
    ends = _ends(rasterise(polygons, first.shape), axis)
    return Gauge(axis, reason, ends) if ends else None


def in_8bit(image: np.ndarray, pixels: int) -> np.ndarray:
    """Grey levels (row, col) in 8 bits, reduced to so many pixels at most."""
    return reduced(to_8bit(image), scale_for(image, pixels))


def _load_axis(
    polygons: Sequence[Polygon], first: np.ndarray, photographs: Sequence[Path | FilePart], read: Read
) -> tuple[Axis, str]:
    """The axis along which the region stretches or shortens most until the latest step that still matches the first."""
    count = len(photographs)
    for later in sorted({count - 1, count // 2, count // 4} - {0}, reverse=True):
        stretch = _stretch(polygons, first, read(photographs[later]))
        if stretch is not None:
            along = {"x": abs(stretch[0] - 1.0), "y": abs(stretch[1] - 1.0)}
            if abs(along["x"] - along["y"]) < _MIN_DIFFERENCE:
                break
            axis: Axis = "x" if along["x"] > along["y"] else "y"
            change = "{:+.1f} % along x, {:+.1f} % along y".format(*(100.0 * (part - 1.0) for part in stretch))
            return axis, f"{change} until step {later + 1} of {count}"
    x0, y0, x1, y1 = bounding_box(polygons)
    return ("x" if x1 - x0 > y1 - y0 else "y"), "the region's longer side; no strain tells it"


def _stretch(polygons: Sequence[Polygon], before: np.ndarray, after: np.ndarray) -> tuple[float, float] | None:
    """Stretch along x and y by the affine motion of the region's features; None with few matches."""
    if before.shape != after.shape:
        return None
    small = [in_8bit(one, _MAX_PIXELS) for one in (before, after)]
    features = [detect(one, "AKAZE") for one in small]
    pairs = match_features(*features)
    source, target = (one.xy[pairs[:, k]].astype(float) for k, one in enumerate(features))
    scale = np.array(before.shape[::-1]) / small[0].shape[::-1]
    inside = contains(polygons, (source + 0.5) * scale - 0.5)
    if inside.sum() < _MIN_MATCHES:
        return None
    source, target = source[inside], target[inside]
    consistent = consistent_matches(source, target)
    if consistent.sum() < max(_MIN_MATCHES, _MIN_CONSISTENT * len(source)):
        return None
    motion = estimate_transform("affine", source[consistent], target[consistent])
    x, y = np.linalg.norm(motion[:2, :2], axis=0).tolist()
    return x, y


def _ends(mask: np.ndarray, axis: Axis) -> tuple[Place, Place] | None:
    """Two points inside the mask (row, col), on one line along the axis near the middle of the region."""
    along = np.asarray(mask if axis == "y" else mask.T, dtype=np.uint8)
    side = 2 * _MARGIN_PX + 1
    inner = cv2.erode(along, np.ones((side, side), dtype=np.uint8), borderValue=0) > 0
    rows = np.flatnonzero(inner.any(axis=1))
    for share in _ENDS if len(rows) else ():
        top, bottom = (round(rows[0] + part * (rows[-1] - rows[0])) for part in (share, 1.0 - share))
        common = np.flatnonzero(inner[top] & inner[bottom])
        if len(common):
            across = int(common[np.abs(common - np.median(common)).argmin()])
            return ((across, top), (across, bottom)) if axis == "y" else ((top, across), (bottom, across))
    return None
