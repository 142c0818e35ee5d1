"""Photographs under the fields: the part in which the points lie, reduced, as JPEG."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from dicflow.errors import DicflowError
from dicflow.explorer.content import Keep
from dicflow.kinds.images import Images
from dicflow.pipeline.result import Result
from dicflow.views.overlay import Crop, crop_around, photo_jpeg

__all__ = ["Photographs"]

_SIZES_PX = (1600, 1280, 1000, 800, 640, 500, 400, 300, 200)


class Photographs(NamedTuple):
    """Photographs of a page.

    crops : "left" and "right" → the part that is shown
    pictures : side → step → JPEG; a step whose photograph the store does not keep is absent
    """

    crops: Mapping[str, Crop]
    pictures: Mapping[str, Mapping[str, bytes]]

    @classmethod
    def read(
        cls,
        result: Result,
        stage: str,
        steps: Sequence[str],
        boxes: Mapping[str, Sequence[float]],
        budget_bytes: float,
        keep: Keep,
    ) -> Photographs:
        """The largest photographs of all steps that fit into a budget; the last step stands for all.

        steps : names, with that of the first photograph
        boxes : side → (x0, y0, x1, y1) of its points at all steps [px]
        """
        kept = [step for step in steps if result.has(stage, step)]
        shapes = result.arrays(stage, kept[-1]) if kept else {}
        sides = {side: box for side, box in boxes.items() if side in shapes}
        for longest in _SIZES_PX:
            crops = {side: crop_around([tuple(box)], _size(shapes[side].shape), longest) for side, box in sides.items()}  # type: ignore[list-item]
            trial = sum(len(_picture(result, stage, kept[-1], side, crop, keep) or b"") for side, crop in crops.items())
            if trial * len(kept) <= budget_bytes:
                break
        else:
            return cls({}, {})
        found = {
            side: {step: made for step in kept if (made := _picture(result, stage, step, side, crop, keep))}
            for side, crop in crops.items()
        }
        return cls(
            {side: crop for side, crop in crops.items() if found[side]},
            {side: one for side, one in found.items() if one},
        )


def _size(shape: Sequence[int]) -> tuple[int, int]:
    return shape[1], shape[0]


def _picture(result: Result, stage: str, step: str, side: str, crop: Crop, keep: Keep) -> bytes | None:
    """The photograph of a step; None if the store does not keep it."""

    def make() -> bytes:
        return photo_jpeg(Images.read(result.product(stage, step))[side], crop, quality=72)

    try:
        return keep(["photograph", side, result.digest(stage, step), json.dumps(crop)], make)
    except DicflowError:
        return None
