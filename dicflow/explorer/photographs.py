"""Photographs under the fields: the part in which the points lie, reduced, as JPEG."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import NamedTuple

from dicflow.core.threads import over
from dicflow.engine.product import Product
from dicflow.errors import DicflowError
from dicflow.explorer.content import Keep
from dicflow.explorer.packing import LINEAR_CODES, LinearScale
from dicflow.explorer.survey import Scales
from dicflow.kinds.images import Images
from dicflow.pipeline.result import Result
from dicflow.views.crops import Box, Crop, crop_around, photo_jpeg

__all__ = ["Photographs", "Series", "boxes_of"]

_SIZES_PX = (1600, 1280, 1000, 800, 640, 500, 400, 300, 200)


class Photographs(NamedTuple):
    """Photographs of a page.

    crops : "left" and "right" → the part that is shown
    pictures : side → step → JPEG; a step whose photograph the store does not keep is absent
    """

    crops: Mapping[str, Crop]
    pictures: Mapping[str, Mapping[str, bytes]]


def boxes_of(scales: Scales) -> dict[str, Box]:
    """The part of each photograph in which all places lie."""
    return {side: _box(found) for side, found in scales.places.items() if side != "space"}


def _box(scales: Sequence[LinearScale]) -> Box:
    (x0, x1), (y0, y1) = ((one.low, one.low + one.quantum * (LINEAR_CODES - 1)) for one in scales)
    return Box(x0, y0, x1, y1)


class Series:
    """The photographs of some steps.

    stage : of the photographs; steps : names
    """

    def __init__(self, result: Result, stage: str, steps: Sequence[str], keep: Keep) -> None:
        self._result, self._stage, self._keep = result, stage, keep
        self._steps = list(steps)

    def fitting(self, boxes: Mapping[str, Box], budget_bytes: float, threads: int = 1) -> Photographs:
        """The largest photographs that fit into a budget; the last step stands for all.

        boxes : side → part of the photograph in which its points lie at all steps [px]
        threads : so many photographs are reduced at once
        """
        for longest in _SIZES_PX:
            crops = self.crops(boxes, longest)
            trial = sum(map(len, self.pictures(self._steps[-1], crops).values())) if crops else 0
            if trial * len(self._steps) <= budget_bytes:
                break
        else:
            return Photographs({}, {})
        found = over(threads, lambda step: self.pictures(step, crops), self._steps)
        made = dict(zip(self._steps, found, strict=True))
        pictures = {side: {step: one[side] for step, one in made.items() if side in one} for side in crops}
        return Photographs(
            {side: crop for side, crop in crops.items() if pictures[side]},
            {side: shown for side, shown in pictures.items() if shown},
        )

    def crops(self, boxes: Mapping[str, Box], longest: int = _SIZES_PX[0]) -> dict[str, Crop]:
        """The parts around boxes, whose longer side is at most so many pixels; empty if the photographs are unknown."""
        shapes = self._shapes(boxes)
        return {side: crop_around([boxes[side]], shape[::-1], longest) for side, shape in shapes.items()}  # type: ignore[arg-type]

    def _shapes(self, sides: Iterable[str]) -> dict[str, tuple[int, ...]]:
        """Rows and columns of the photographs by side; empty if they are unknown."""
        try:
            arrays = self._result.arrays(self._stage, self._steps[-1]) if self._steps else {}
        except DicflowError:
            return {}
        return {side: arrays[side].shape for side in sides if side in arrays}

    @property
    def can_be_read(self) -> bool:
        """Whether the store or the folder has the photographs of the last step."""
        return bool(self._steps) and self._result.can_be_read(self._stage, self._steps[-1])

    def pictures(self, step: str, crops: Mapping[str, Crop]) -> dict[str, bytes]:
        """Photographs of a step by side, none where neither store nor folder has them; read at most once."""

        @cache
        def product() -> Product:
            return self._result.product(self._stage, step)

        try:
            digest = self._result.digest(self._stage, step)
            return {
                side: self._keep(
                    ["photograph", side, digest, json.dumps(crop)],
                    lambda: photo_jpeg(Images.read(product())[side], crop, quality=72),  # noqa: B023
                )
                for side, crop in crops.items()
            }
        except DicflowError:
            return {}
