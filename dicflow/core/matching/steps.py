"""Matches of the photographs of two steps: by descriptor, near predicted positions, and refined by grey levels."""

from __future__ import annotations

from typing import NamedTuple

from dicflow.core.arrays import Array, Grey, Mask
from dicflow.core.matching.features import Features
from dicflow.core.matching.pairs import consistent_matches, guided_matches, local_motion, match_features
from dicflow.core.matching.refine import refinable, refine_matches

__all__ = ["Matching", "Sight", "StepMatches", "match_steps"]


_REFINEMENT_PASSES = 2
"""The windows' shape comes from the matches; in the second pass from refined ones."""
_MIN_MATCHES = 12
"""Fewer matches do not give the motion around a point."""

_Pairs = tuple[Array, Array]


class Matching(NamedTuple):
    """How features are matched.

    ratio : nearest over second nearest descriptor distance, at most
    mutual : both features must be each other's nearest
    guided : match again near the positions that the first matches predict
    radius_px : how far from a predicted position a guided match may be
    refine : move each match to where the grey levels around it fit best
    window_px : side of the window that refinement compares, odd
    min_correlation : of the two windows
    """

    ratio: float = 0.8
    mutual: bool = True
    guided: bool = True
    radius_px: float = 4.0
    refine: bool = True
    window_px: int = 21
    min_correlation: float = 0.6


class Sight(NamedTuple):
    """The photograph (rows, cols) of a step and its features."""

    image: Grey
    features: Features


class StepMatches(NamedTuple):
    """Matches from one step to another.

    source, target : (n, 2) — positions at both [px]
    by_descriptor : number of matches before they were guided and refined
    """

    source: Array
    target: Array
    by_descriptor: int


def match_steps(before: Sight, after: Sight, matching: Matching) -> StepMatches:
    """Match the features of two photographs. Their descriptors must be of one detector."""
    first = match_features(before.features, after.features, ratio=matching.ratio, mutual=matching.mutual)
    pairs = _positions(before.features, after.features, first)
    if matching.guided:
        pairs = _guided(before.features, after.features, pairs, matching.radius_px)
    if matching.refine:
        pairs = _refined(before.image, after.image, pairs, matching)
    return StepMatches(*pairs, len(first))


def _guided(before: Features, after: Features, pairs: _Pairs, radius_px: float) -> _Pairs:
    """Matches near the positions that the consistent matches around them predict."""
    source, target = _kept(pairs, consistent_matches(*pairs))
    if len(source) < _MIN_MATCHES:
        return pairs
    predicted = local_motion(source, target, before.xy.astype(float)).position
    pairs = _positions(before, after, guided_matches(before, after, predicted, radius_px=radius_px))
    return _kept(pairs, consistent_matches(*pairs))


def _refined(image_before: Grey, image: Grey, pairs: _Pairs, matching: Matching) -> _Pairs:
    """Matches whose windows correlate, at the positions of the highest correlation."""
    pairs = _kept(pairs, consistent_matches(*pairs))
    if len(pairs[0]) < _MIN_MATCHES:
        return pairs
    images = refinable(image_before, image)
    for _ in range(_REFINEMENT_PASSES):
        if len(pairs[0]) < _MIN_MATCHES:
            break
        gradient = local_motion(*pairs, pairs[0]).gradient
        refined = refine_matches(images, *pairs, gradient, window_px=matching.window_px)
        pairs = _kept((refined.reference, refined.deformed), refined.correlation >= matching.min_correlation)
    return pairs


def _positions(before: Features, after: Features, pairs: Array) -> _Pairs:
    """Positions (n, 2) of pairs of indices (n, 2) [px]."""
    return before.xy[pairs[:, 0]].astype(float), after.xy[pairs[:, 1]].astype(float)


def _kept(pairs: _Pairs, keep: Mask) -> _Pairs:
    return pairs[0][keep], pairs[1][keep]
