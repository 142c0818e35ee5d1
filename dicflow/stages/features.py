"""Distinct points of every photograph."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, ClassVar, Literal

from pydantic import Field

from dicflow.core.matching.detectors import DETECTORS
from dicflow.engine.node import Node, Port, Scope, parameter
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.kinds.features import FeatureSet
from dicflow.kinds.images import Images

if TYPE_CHECKING:
    import numpy as np

    DetectorName = str
else:
    DetectorName = Literal[tuple(DETECTORS)]

__all__ = ["FindFeatures", "sentence"]

Pixel = Annotated[int, Field(ge=0)]


class FindFeatures(Node):
    """Find features in the left image and describe them, once per image.

    KAZE's cost grows with the searched area, so ``area: auto`` searches the bounding box of the speckles only.
    """

    title: ClassVar = "find features"
    scope: ClassVar = Scope.STEP
    takes: ClassVar = {"images": Port("rectified", "plane", "images")}
    gives: ClassVar = "features"
    impl_version: ClassVar = 2

    stage: Literal["features"] = "features"
    detector: DetectorName = parameter("KAZE", "detector and its own descriptor")
    area: Literal["auto", "full"] | tuple[Pixel, Pixel, Pixel, Pixel] = parameter(
        "auto", "where to search: auto (bounding box of the speckles), full, or [x0, y0, x1, y1]", unit="px"
    )
    upright: bool = parameter(
        True, "describe without an orientation: more matches while the specimen turns by less than 15° between steps"
    )
    octaves: int = parameter(
        3, "doublings of scale to search (KAZE, AKAZE, BRISK); large speckles need more", ge=1, le=8
    )
    max_features: int = parameter(6000, "the strongest features, evenly spread, up to this number", ge=50)

    def run(self, images: Product) -> Product:
        from dicflow.core.matching.features import detect, no_features

        photographs = Images.read(images)
        image = photographs.left
        box = self._box(image)
        if box is None:
            warnings = (_no_speckles(image),)
            nowhere = (0, 0, 0, 0)
            return FeatureSet.write(no_features(self.detector), self.detector, nowhere, photographs.size, warnings)
        detected = detect(
            image, self.detector, box=box, upright=self.upright, octaves=self.octaves, max_features=self.max_features
        )
        return FeatureSet.write(detected, self.detector, box, photographs.size)

    def _box(self, image: np.ndarray) -> tuple[int, int, int, int] | None:
        """The area (x0, y0, x1, y1) to search; None if a photograph shows no speckles."""
        from dicflow.core.photographs.texture import textured_box

        height, width = image.shape
        if self.area == "full":
            return 0, 0, width, height
        if self.area == "auto":
            return textured_box(image)
        x0, y0, x1, y1 = self.area
        if not (x0 < x1 <= width and y0 < y1 <= height):
            raise StageError(
                f"area [{x0}, {y0}, {x1}, {y1}] is not inside the image, which has {width} × {height} px; "
                "give x0 < x1 and y0 < y1 inside it, or area: auto"
            )
        return x0, y0, x1, y1


def _no_speckles(image: np.ndarray) -> str:
    """The warning for a photograph (row, col) without speckles."""
    from dicflow.core.photographs.texture import MIN_TEXTURE, mean_intensity_gradient

    return (
        f"found no speckles in the photograph: its mean intensity gradient is {mean_intensity_gradient(image):.2f} "
        f"grey levels per px, and a pattern needs {MIN_TEXTURE} or more; check light, exposure and focus"
    )


def sentence(stage: FindFeatures, product: Product | None) -> str:
    """The stage in a methods paragraph."""
    keys = {"KAZE": "kaze2012", "AKAZE": "akaze2013", "BRISK": "brisk2011", "ORB": "orb2011", "SIFT": "lowe2004"}
    named = f"{stage.detector} features [{keys[stage.detector]}]"
    return f"Up to {stage.max_features} {named} were detected in each photograph."
