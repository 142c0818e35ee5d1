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
    from dicflow.core.matching.features import Features
    from dicflow.core.matching.steps import Matching

__all__ = ["Match", "sentence"]


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

    @property
    def kernels(self) -> list[str]:
        """Names of the kernels that it uses, for compiling them ahead."""
        return [*(["motion"] if self.guided or self.refine else []), *(["refinement"] if self.refine else [])]

    def run(self, features: Product, features_before: Product, images: Product, images_before: Product) -> Product:
        from dicflow.core.matching.steps import Sight, match_steps

        source, target = FeatureSet.read(features_before), FeatureSet.read(features)
        before = Sight(Images.read(images_before).left, source.features)
        after = Sight(Images.read(images).left, target.features)
        _check_descriptors(before.features, after.features)
        found = match_steps(before, after, self._matching())
        summary = {
            "features_reference": len(before.features.xy),
            "features_deformed": len(after.features.xy),
            "matches_by_descriptor": found.by_descriptor,
            "matches": len(found.source),
        }
        positions = found.source, found.target, before.features.xy
        return Matches.write(*positions, target.image_size, self._matching(), summary)

    def _matching(self) -> Matching:
        from dicflow.core.matching.steps import Matching

        return Matching(
            self.ratio, self.mutual, self.guided, self.radius, self.refine, self.window, self.min_correlation
        )


def _check_descriptors(before: Features, after: Features) -> None:
    """Raise StageError if the descriptors differ in type or length, so that they cannot be compared."""
    one, other = before.descriptors, after.descriptors
    if one.dtype != other.dtype or one.shape[1:] != other.shape[1:]:
        raise StageError("the features of the two steps come from different detectors; use one detector for both")


def sentence(stage: Match, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    text = (
        f"Features of successive steps were matched by their descriptors, at a ratio of at most {stage.ratio:g} of the "
    )
    text += "nearest to the second nearest distance [lowe2004]"
    refined = f", and refined by the grey levels in windows of {stage.window} px [baker2004]" if stage.refine else ""
    return f"{text}{refined}."
