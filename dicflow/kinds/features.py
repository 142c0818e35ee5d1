"""Distinct points of one photograph and their descriptors."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import Kind, Layout, laid_out

if TYPE_CHECKING:
    from dicflow.core.matching.features import Features

__all__ = ["FeatureSet"]

_LAYOUTS = {
    "xy": Layout(("feature", "component"), "px", "position in the left image"),
    "size": Layout(("feature",), "px", "diameter of the described area"),
    "angle": Layout(("feature",), "deg", "orientation"),
    "response": Layout(("feature",), "1", "strength"),
    "descriptors": Layout(("feature", "d"), "1", "{detector} descriptor"),
}


class FeatureSet(Kind):
    """Features of the left image."""

    KINDS: ClassVar = ("features",)

    @classmethod
    def write(
        cls,
        features: Features,
        detector: str,
        area: tuple[int, int, int, int],
        image_size: tuple[int, int],
        warnings: Sequence[str] = (),
    ) -> Product:
        """A product of features.

        detector : name of the detector, whose descriptors these are
        area : x0, y0, x1, y1 of the searched area [px]
        image_size : width and height [px]
        warnings : sentences for the user
        """
        title = _LAYOUTS["descriptors"].long_name.format(detector=detector)
        layouts = _LAYOUTS | {"descriptors": _LAYOUTS["descriptors"]._replace(long_name=title)}
        attrs = {
            "detector": detector,
            "area": list(area),
            "image_size": list(image_size),
            "summary": {"features": len(features.xy)},
        }
        said = {"warnings": list(warnings)} if warnings else {}
        return Product("features", laid_out(layouts, features._asdict()), {**attrs, **said})

    @staticmethod
    def layouts(prefix: str) -> dict[str, Layout]:
        """Layouts of the arrays of features in another product, each name with a prefix."""
        titles = {name: layout.long_name.format(detector="feature") for name, layout in _LAYOUTS.items()}
        return {f"{prefix}{name}": layout._replace(long_name=titles[name]) for name, layout in _LAYOUTS.items()}

    @property
    def features(self) -> Features:
        """The features as :mod:`dicflow.core.matching` takes them."""
        from dicflow.core.matching.features import Features

        return Features(*(self[name] for name in Features._fields))

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the image [px]."""
        width, height = self.product.attrs["image_size"]
        return width, height
