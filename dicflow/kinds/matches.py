"""Features of one step found again in the next."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import Kind, Layout, laid_out

if TYPE_CHECKING:
    import numpy as np

    from dicflow.core.correlation.seed import Pairs
    from dicflow.core.matching.steps import Matching

__all__ = ["Matches"]

_LAYOUTS = {
    "reference": Layout(("match", "component"), "px", "position at the previous step"),
    "deformed": Layout(("match", "component"), "px", "position at this step"),
    "features": Layout(("feature", "component"), "px", "all features of the previous step"),
}


class Matches(Kind):
    """Positions of matched features at the previous step and at this one."""

    KINDS: ClassVar = ("matches",)

    @classmethod
    def write(
        cls,
        reference: np.ndarray,
        deformed: np.ndarray,
        features: np.ndarray,
        image_size: tuple[int, int],
        matching: Matching,
        summary: Mapping[str, int],
    ) -> Product:
        """A product of matches.

        reference, deformed : (n, 2) — positions at the previous step and at this one [px]
        features : (m, 2) — all features of the previous step [px]
        image_size : width and height [px]
        matching : how they were matched
        """
        values = {
            "reference": reference.astype("float32"),
            "deformed": deformed.astype("float32"),
            "features": features,
        }
        attrs = {"image_size": list(image_size), "matching": matching._asdict(), "summary": dict(summary)}
        return Product("matches", laid_out(_LAYOUTS, values), attrs)

    @property
    def pairs(self) -> Pairs:
        """Positions (n, 2) at the previous step and at this one [px]."""
        from dicflow.core.correlation.seed import Pairs

        return Pairs(self["reference"].astype(float), self["deformed"].astype(float))

    @property
    def features(self) -> np.ndarray:
        """Positions (m, 2) of all features of the previous step [px]."""
        return self["features"].astype(float)

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the image [px]."""
        width, height = self.product.attrs["image_size"]
        return width, height

    @property
    def matching(self) -> Matching:
        """How they were matched."""
        from dicflow.core.matching.steps import Matching

        return Matching(**self.product.attrs["matching"])
