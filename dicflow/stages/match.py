"""Features of one step found again in the next."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar, Literal

from dicflow.engine.node import At, Node, Odd, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.features import FeatureSet
from dicflow.kinds.images import Images
from dicflow.kinds.matches import Matches

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.matching.features import Features

    Pairs = tuple[np.ndarray, np.ndarray]

__all__ = ["Match"]

REFINEMENT_PASSES = 2
"""The windows' shape comes from the matches; in the second pass from refined ones."""
MIN_MATCHES = 12
"""Fewer matches do not give the motion around a point."""


class Match(Node):
    """Match the features of the previous step with those of this one.

    First by descriptor over the whole image. Then ``guided``: near the positions that the motion of the first matches
    predicts, which gives several times as many matches after a large stretch. Then ``refine``: each match moves to the
    position where the grey levels around it fit best, and matches that do not fit are dropped.
    """

    title: ClassVar = "match features"
    scope: ClassVar = Scope.PAIR
    takes: ClassVar = {
        "features": Port("features"),
        "features_before": Port("features", at=At.PREVIOUS),
        "images": Port("rectified", "plane", "images"),
        "images_before": Port("rectified", "plane", "images", at=At.PREVIOUS),
    }
    gives: ClassVar = "matches"

    stage: Literal["match"] = "match"
    ratio: float = parameter(0.8, "nearest over second nearest descriptor distance, at most", gt=0, le=1)
    mutual: bool = parameter(True, "both features must be each other's nearest")
    guided: bool = parameter(True, "match again near the positions that the first matches predict")
    radius: float = parameter(4.0, "how far from a predicted position a guided match may be", unit="px", gt=0)
    refine: bool = parameter(True, "refine positions by the grey levels around them")
    window: Odd = parameter(21, "side of the window that refinement compares; odd", unit="px", ge=7)
    min_correlation: float = parameter(0.6, "correlation of the two windows, at least", ge=-1, le=1)

    def run(self, features: Product, features_before: Product, images: Product, images_before: Product) -> Product:
        from dicflow.core.matching.pairs import match_features

        source, target = FeatureSet.read(features_before), FeatureSet.read(features)
        before, after = source.features, target.features
        _check_descriptors(before, after)
        first = match_features(before, after, ratio=self.ratio, mutual=self.mutual)
        pairs = before.xy[first[:, 0]].astype(float), after.xy[first[:, 1]].astype(float)
        if self.guided:
            pairs = self._guided(before, after, pairs)
        if self.refine:
            pairs = self._refined(Images.read(images_before).left, Images.read(images).left, pairs)
        summary = {
            "features_reference": len(before.xy),
            "features_deformed": len(after.xy),
            "matches_by_descriptor": len(first),
            "matches": len(pairs[0]),
        }
        return Matches.write(*pairs, before.xy, target.image_size, summary)

    def _guided(self, before: Features, after: Features, pairs: Pairs) -> Pairs:
        """Matches near the positions that the consistent matches around them predict."""
        from dicflow.core.matching.pairs import consistent_matches, guided_matches, local_motion

        source, target = _kept(pairs, consistent_matches(*pairs))
        if len(source) < MIN_MATCHES:
            return pairs
        predicted = local_motion(source, target, before.xy.astype(float)).position
        guided = guided_matches(before, after, predicted, radius_px=self.radius)
        pairs = before.xy[guided[:, 0]].astype(float), after.xy[guided[:, 1]].astype(float)
        return _kept(pairs, consistent_matches(*pairs))

    def _refined(self, image_before: np.ndarray, image: np.ndarray, pairs: Pairs) -> Pairs:
        """Matches whose windows correlate, at the positions of the highest correlation."""
        from dicflow.core.matching.pairs import consistent_matches, local_motion
        from dicflow.core.matching.refine import refine_matches

        pairs = _kept(pairs, consistent_matches(*pairs))
        for _ in range(REFINEMENT_PASSES):
            if len(pairs[0]) < MIN_MATCHES:
                break
            gradient = local_motion(*pairs, pairs[0]).gradient
            refined = refine_matches(image_before, image, *pairs, gradient, window_px=self.window)
            pairs = _kept((refined.reference, refined.deformed), refined.correlation >= self.min_correlation)
        return pairs


def _check_descriptors(before: Features, after: Features) -> None:
    """Raise StageError if the descriptors differ in type or length, so that they cannot be compared."""
    one, other = before.descriptors, after.descriptors
    if one.dtype != other.dtype or one.shape[1:] != other.shape[1:]:
        raise StageError("the features of the two steps come from different detectors; use one detector for both")


def _kept(pairs: Pairs, keep: np.ndarray) -> Pairs:
    return pairs[0][keep], pairs[1][keep]
