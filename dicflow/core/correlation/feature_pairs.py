"""Features of two photographs matched, one way after another, each standing stronger changes of the pattern.

Orientations of their own follow turns; without them, upright features stand more stretch. Beyond that, the reference
photograph is stretched along several directions before features are detected in it (after Morel and Yu, SIAM J. Imaging
Sciences 2, 2009), so that one of these looks much like the target.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Grey, all_finite
from dicflow.core.matching.features import Box, Features, detect
from dicflow.core.matching.pairs import agreeing_matches, guided_matches, local_motion, match_features

__all__ = ["MIN_PAIRS", "FeatureSearch", "Pairs", "feature_pairs"]


MIN_PAIRS = 6
"""With fewer pairs, the motion is unknown."""
_BORDER_PX = 64
"""Border around the points in which features are detected too [px]."""
_STRETCHES, _DIRECTIONS = (1.6, 2.5), 4
"""Stretches of the reference photograph, and along how many directions."""


class Pairs(NamedTuple):
    """Places in a reference photograph and in a target that show the same, (n, 2) each [px]."""

    source: Array
    target: Array


class _Way(NamedTuple):
    """How features are detected. stretch : (2, 2) — of the reference photograph before it"""

    detector: str = "SIFT"
    upright: bool = False
    stretch: Array = np.eye(2)


def _ways() -> Iterator[_Way]:
    """All ways, in the order of their cost."""
    yield from (_Way(), _Way(upright=True), _Way("KAZE", upright=True))
    for size in _STRETCHES:
        for angle in np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS:
            axis = np.array([np.cos(angle), np.sin(angle)])
            yield _Way(stretch=np.eye(2) + (size - 1.0) * np.outer(axis, axis))


class FeatureSearch:
    """Matches of features around points (i, j, 2) of a reference photograph, each found when first asked for.

    SIFT: Lowe, Int. J. Computer Vision 60, 2004. KAZE: Alcantarilla, Bartoli and Davison, ECCV 2012.
    """

    def __init__(self, reference: Grey, target: Grey, points: Array) -> None:
        self._reference, self._target, self._points = reference, target, points
        self._after: dict[tuple[str, bool], Features] = {}
        self._found: list[Pairs] = []

    @cached_property
    def _box(self) -> Box | None:
        return _box_around(self._points, self._reference.shape)

    def __iter__(self) -> Iterator[Pairs]:
        """Matches with false ones among them, one way of finding them after the other."""
        for number, way in enumerate(_ways() if self._box is not None else ()):
            if number == len(self._found):
                self._found.append(self._matched(way))
            yield self._found[number]

    def _matched(self, way: _Way) -> Pairs:
        before, kind = self._features(way), (way.detector, way.upright)
        if kind not in self._after:
            self._after[kind] = detect(self._target, way.detector, upright=way.upright)
        return _matched(before, self._after[kind])

    def _features(self, way: _Way) -> Features:
        """Features of the reference photograph."""
        box = self._box
        assert box is not None
        if (way.stretch == np.eye(2)).all():
            return detect(self._reference, way.detector, box=box, upright=way.upright)
        crop, corner = self._reference[box[1] : box[3], box[0] : box[2]], np.array(box[:2])
        height, width = crop.shape
        corners = np.array([[0, 0], [width, 0], [0, height], [width, height]]) @ way.stretch.T
        low, high = corners.min(axis=0), corners.max(axis=0)
        motion, size = np.column_stack([way.stretch, -low]), np.ceil(high - low).astype(int).tolist()
        found = detect(cv2.warpAffine(crop, motion, size), way.detector, upright=way.upright)
        places = (found.xy + low) @ np.linalg.inv(way.stretch).T
        inside = ((places > 0.0) & (places < [width, height])).all(axis=1)
        places = (places + corner).astype(np.float32)
        return Features._make(values[inside] for values in found._replace(xy=places))


def feature_pairs(reference: Grey, target: Grey, points: Array) -> Pairs:
    """Matches of features with orientations of their own around points (i, j, 2), with false ones among them."""
    return next(iter(FeatureSearch(reference, target, points)), Pairs(np.zeros((0, 2)), np.zeros((0, 2))))


def _box_around(points: Array, shape: tuple[int, ...]) -> Box | None:
    """The pixels (x0, y0, x1, y1) around points; None where an image of a shape has none of them."""
    known = points[all_finite(points)]
    low, high = known.min(axis=0) - _BORDER_PX, known.max(axis=0) + _BORDER_PX
    corner, end = np.maximum(low, 0).astype(int), np.minimum(high, shape[::-1]).astype(int)
    return None if (end <= corner).any() else (int(corner[0]), int(corner[1]), int(end[0]), int(end[1]))


def _matched(before: Features, after: Features) -> Pairs:
    """Pairs of features by descriptor, and again near where the consistent ones predict them."""
    found = match_features(before, after)
    source, moved = before.xy[found[:, 0]].astype(float), after.xy[found[:, 1]].astype(float)
    keep = agreeing_matches(source, moved)
    if keep.sum() >= MIN_PAIRS:
        predicted = local_motion(source[keep], moved[keep], before.xy.astype(float)).position
        found = guided_matches(before, after, predicted)
        source, moved = before.xy[found[:, 0]].astype(float), after.xy[found[:, 1]].astype(float)
    return Pairs(source, moved)
