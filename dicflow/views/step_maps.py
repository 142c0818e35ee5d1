"""Maps of a total over the photographs of its steps, as data that a page shows.

All that is slow is kept in pieces by whoever asks: one of the whole test, one of the crop, one per step.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dicflow.core.status import Status
from dicflow.errors import NotKeptError
from dicflow.kinds.images import Images
from dicflow.kinds.maps import colour_range, joined_range
from dicflow.kinds.total import Total
from dicflow.pipeline import Result
from dicflow.pipeline.places import Places
from dicflow.views.colours import Look
from dicflow.views.overlay import (
    Crop,
    carried_angle,
    cell_index,
    crop_around,
    direction_path,
    field_png,
    photo_jpeg,
    point_box,
    reason_png,
)

__all__ = ["Keep", "Overview", "StepMaps", "as_text", "worst_corner"]

_SIZES_PX = (640, 560, 480, 400, 320, 240, 160, 112, 80, 56, 40)
_BUDGET_BYTES = 7.0e6

Keep = Callable[[Sequence[str], Callable[[], bytes]], bytes]
"""Returns the bytes made from some sources, by the function unless they are kept from an earlier call."""


class Overview(NamedTuple):
    """What is known from one reading of all steps.

    boxes : (x0, y0, x1, y1) of the points, per step and of the grid at the first step [px]
    image_size : (width, height) of the photographs [px]
    ranges : quantity → values between which its colours run
    """

    boxes: Sequence[tuple[float, float, float, float]]
    image_size: tuple[int, int]
    ranges: Mapping[str, tuple[float, float]]


class StepMaps(NamedTuple):
    """Maps of a total over the photographs in which its points lie.

    total : name of the stage whose fields are drawn
    places : of its points
    has_grid : whether points are the same at every step; else each step has a grid of its own
    keep : keeps pieces from one page to the next
    """

    result: Result
    total: str
    places: Places
    has_grid: bool
    keep: Keep

    def overview(self, steps: Sequence[str], names: Sequence[str]) -> Overview:
        """Where the points are over all steps, and between which values each quantity lies."""
        sources = ["fields of a test", *names, *self._digests(steps)]
        return Overview(**json.loads(self.keep(sources, lambda: self._read_all(steps, names))))

    def crop(self, overview: Overview, steps: Sequence[str], looks: Sequence[Look]) -> Crop:
        """The largest crop around all points for which the maps of all steps stay within a page's budget.

        The last step stands for all of them; how far a picture shrinks when it is packed depends on its noise.
        """

        def fitting(bare: bool = False) -> bytes:
            for longest in _SIZES_PX:
                crop = crop_around(overview.boxes, overview.image_size, longest)
                if len(steps) * len(self._draw(steps[-1], crop, looks, bare)) < _BUDGET_BYTES:
                    break
            return json.dumps(crop).encode()

        last = self.result.digest(self.places.photographs, steps[-1])
        sources = ["size", json.dumps([overview, looks, len(steps)]), *self._digests(steps[-1:]), last]
        return Crop(*json.loads(self._over_photographs(sources, fitting)))

    def at_step(self, step: str, crop: Crop, looks: Sequence[Look]) -> dict[str, Any]:
        """The pictures of one step as texts: its photograph, and each quantity as it lies over it."""
        photograph = self.result.digest(self.places.photographs, step)
        sources = ["fields of a step", json.dumps([crop, looks]), *self._digests([step]), photograph]
        drawn = self._over_photographs(sources, partial(self._draw, step, crop, looks))
        pictures: dict[str, Any] = json.loads(drawn)
        return pictures

    def first_photograph(self, crop: Crop) -> str | None:
        """The photograph of the first step; None if no map is drawn over it, or if the store does not keep it."""
        if not self.has_grid:
            return None
        sources = ["photograph", self.result.digest(self.places.photographs, 0), json.dumps(crop)]
        try:
            return as_text(self.keep(sources, lambda: self._photograph(0, crop)))
        except NotKeptError:
            return None

    def _digests(self, steps: Sequence[str]) -> list[str]:
        """Digests of all products by which points are placed at these steps."""
        digests = [self.result.digest(self.total, step) for step in steps]
        if self.has_grid and self.places.grid is not None:
            digests.append(self.result.digest(self.places.grid, 0))
        if self.places.photographs != self.places.images:
            digests.append(self.result.digest(self.result.source(self.places.images, "rig")))
        return digests

    def _over_photographs(self, sources: Sequence[str], make: Callable[..., bytes]) -> bytes:
        """A piece with photographs in it, or if the store does not keep them that of ``make(bare=True)``."""
        try:
            return self.keep(sources, make)
        except NotKeptError:
            return self.keep(["bare", *sources], partial(make, bare=True))

    def _read_all(self, steps: Sequence[str], names: Sequence[str]) -> bytes:
        boxes = [point_box(self.places.at_first_step())] if self.has_grid else []
        ranges: dict[str, list[tuple[float, float] | None]] = {name: [] for name in names}
        for step in steps:
            total = Total.read(self.result.product(self.total, step))
            boxes.append(point_box(self.places.at_step(total)))
            for name, seen in ranges.items():
                seen.append(colour_range(total[name]))
        height, width = self.result.shape(self.places.photographs, "left", steps[0])
        joined = {name: joined_range(seen) for name, seen in ranges.items()}
        overview = Overview([box for box in boxes if box is not None], (width, height), joined)
        return json.dumps(overview._asdict()).encode()

    def _photograph(self, step: str | int, crop: Crop) -> bytes:
        return photo_jpeg(Images.read(self.result.product(self.places.photographs, step)).left, crop)

    def _draw(self, step: str, crop: Crop, looks: Sequence[Look], bare: bool = False) -> bytes:
        """The pictures of one step as JSON. bare : without the photograph"""
        total = Total.read(self.result.product(self.total, step))
        here, status = self.places.at_step(total), total["status"]
        content: dict[str, Any] = {
            "photo": as_text(b"" if bare else self._photograph(step, crop)),
            "deformed": _fields(total, cell_index(here, crop), looks),
        }
        if not self.has_grid:
            inside = status != Status.OUTSIDE
            content["reasons"] = as_text(reason_png(status))
        else:
            grid = self.places.at_first_step()
            inside = np.isfinite(grid).all(axis=-1)
            index = cell_index(grid, crop.halved)
            content["reference"] = _fields(total, index, looks)
            content["reasons"] = as_text(reason_png(worst_corner(status)[index]))
            content["directions"] = _directions(total, grid, here, crop)
        return json.dumps(content | {"counts": _counts(status[inside])}).encode()


def _fields(total: Total, index: Any, looks: Sequence[Look]) -> dict[str, str]:
    return {look.quantity: as_text(field_png(total[look.quantity], index, look)) for look in looks}


def worst_corner(status: np.ndarray) -> np.ndarray:
    """The gravest code among the corners of each cell, by the cell's number; the last is that of a measured point."""
    corners = [status[:-1, :-1], status[1:, :-1], status[:-1, 1:], status[1:, 1:]]
    return np.append(np.maximum.reduce(corners).ravel(), np.uint8(0))


def _directions(total: Total, grid: np.ndarray, here: np.ndarray, crop: Crop) -> dict[str, str]:
    """Lines along the principal direction of the larger strain, over the first step and over this one."""
    if "angle" in total:
        angle = total["angle"]
    else:
        angle = np.degrees(0.5 * np.arctan2(total["gxy"], total["exx"] - total["eyy"]))
    if total.directions == "global":  # the angle is that at this step
        at_first, at_this = carried_angle(here, grid, angle), angle
    else:
        at_first, at_this = angle, carried_angle(grid, here, angle)
    return {"reference": direction_path(grid, at_first, crop), "deformed": direction_path(here, at_this, crop)}


def _counts(status: np.ndarray) -> dict[str, int]:
    """How many points have each status, by its name."""
    codes, numbers = np.unique(status, return_counts=True)
    return {Status(code).label: number for code, number in zip(codes.tolist(), numbers.tolist(), strict=True)}


def as_text(picture: bytes) -> str:
    """A picture as base64."""
    return b64encode(picture).decode()
