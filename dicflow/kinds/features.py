"""Distinct points of one photograph and their descriptors."""

from __future__ import annotations

from typing import TYPE_CHECKING, ClassVar

from dicflow.engine.product import Product
from dicflow.kinds.kind import Kind, Layout

if TYPE_CHECKING:
    from dicflow.core.matching.features import Features

__all__ = ["FeatureSet"]


class FeatureSet(Kind):
    """Features of the left image."""

    KINDS: ClassVar = ("features",)

    @classmethod
    def write(
        cls, found: Features, detector: str, area: tuple[int, int, int, int], image_size: tuple[int, int]
    ) -> Product:
        """A product of features.

        area : x0, y0, x1, y1 of what was searched [px]
        image_size : width and height [px]
        """
        layouts = {
            "xy": Layout(("feature", "component"), "px", "position in the left image"),
            "size": Layout(("feature",), "px", "diameter of what is described"),
            "angle": Layout(("feature",), "deg", "orientation"),
            "response": Layout(("feature",), "1", "strength"),
            "descriptors": Layout(("feature", "d"), "1", f"{detector} descriptor"),
        }
        variables = {name: layout(getattr(found, name)) for name, layout in layouts.items()}
        attrs = {
            "detector": detector,
            "area": list(area),
            "image_size": list(image_size),
            "summary": {"features": len(found.xy)},
        }
        return Product("features", variables, attrs)

    @property
    def found(self) -> Features:
        """The features."""
        from dicflow.core.matching.features import Features

        return Features(*(self[name] for name in Features._fields))

    @property
    def image_size(self) -> tuple[int, int]:
        """Width and height of the image [px]."""
        width, height = self.product.attrs["image_size"]
        return width, height
