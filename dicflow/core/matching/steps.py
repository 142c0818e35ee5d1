"""Matches of the photographs of two steps: by descriptor, near predicted positions, and refined by grey levels."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Grey, Index, Mask
from dicflow.core.matching.features import Features
from dicflow.core.matching.pairs import Seen, consistent_matches, guided_matches, local_motion, match_features
from dicflow.core.matching.refine import refinable, refine_matches

__all__ = ["Matching", "Sight", "StepMatches", "match_steps"]


_REFINEMENT_PASSES = 2
"""The windows' shape comes from the matches; in the second pass from refined ones."""
_MIN_MATCHES = 12
"""Fewer matches do not give the motion around a point."""


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


class _Matches(NamedTuple):
    """Positions (n, 2) of matches at both steps [px], and the numbers (n,) of their features at the first."""

    source: Array
    target: Array
    number: Index

    def kept(self, keep: Mask) -> _Matches:
        return _Matches(self.source[keep], self.target[keep], self.number[keep])


def match_steps(before: Sight, after: Sight, matching: Matching, seen: Seen | None = None) -> StepMatches:
    """Match the features of two photographs. Their descriptors must be of one detector.

    seen : which features of the first photograph move together, by their numbers; all if absent
    """
    first = match_features(before.features, after.features, ratio=matching.ratio, mutual=matching.mutual)
    matches = _positions(before.features, after.features, first)
    if matching.guided:
        matches = _guided(before.features, after.features, matches, matching.radius_px, seen)
    if matching.refine:
        matches = _refined(before.image, after.image, matches, matching, seen)
    return StepMatches(matches.source, matches.target, len(first))


def _guided(before: Features, after: Features, matches: _Matches, radius_px: float, seen: Seen | None) -> _Matches:
    """Matches near the positions that the consistent matches around them predict."""
    known = matches.kept(consistent_matches(matches.source, matches.target))
    if len(known.source) < _MIN_MATCHES:
        return matches
    places = before.xy.astype(float)
    predicted = local_motion(known.source, known.target, places, _of_matches(seen, np.arange(len(places)), known))
    guided = guided_matches(before, after, predicted.position, radius_px=radius_px)
    matches = _positions(before, after, guided)
    return matches.kept(consistent_matches(matches.source, matches.target))


def _refined(before: Grey, after: Grey, matches: _Matches, matching: Matching, seen: Seen | None) -> _Matches:
    """Matches whose windows correlate, at the positions of the highest correlation."""
    matches = matches.kept(consistent_matches(matches.source, matches.target))
    if len(matches.source) < _MIN_MATCHES:
        return matches
    images = refinable(before, after)
    for _ in range(_REFINEMENT_PASSES):
        if len(matches.source) < _MIN_MATCHES:
            break
        source, target, number = matches
        gradient = local_motion(source, target, source, _of_matches(seen, number, matches)).gradient
        refined = refine_matches(images, source, target, gradient, window_px=matching.window_px)
        matches = _Matches(refined.reference, refined.deformed, number)
        matches = matches.kept(refined.correlation >= matching.min_correlation)
    return matches


def _of_matches(seen: Seen | None, number: Index, matches: _Matches) -> Seen | None:
    """Which matches count at points, by their numbers. number : (n,) — of the feature at each point"""
    if seen is None:
        return None
    return lambda points, others: seen(number[points], matches.number[others])


def _positions(before: Features, after: Features, pairs: Index) -> _Matches:
    """The matches of pairs of indices (n, 2)."""
    return _Matches(before.xy[pairs[:, 0]].astype(float), after.xy[pairs[:, 1]].astype(float), pairs[:, 0])
