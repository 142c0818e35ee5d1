"""Maps of a total over the photographs of its steps, as data that a page shows.

All that is slow is kept in pieces by whoever asks, each under the digests of the arrays that it shows; so a piece
outlives a change of the others.
"""

from __future__ import annotations

import json
from base64 import b64encode
from collections.abc import Callable, Mapping, Sequence
from functools import cache, cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

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


class StepMaps:
    """Maps of a total over the photographs in which its points lie.

    total : name of the stage whose fields are drawn
    places : of its points
    has_grid : whether points are the same at every step; else each step has a grid of its own
    keep : keeps pieces from one page to the next
    """

    def __init__(self, result: Result, total: str, places: Places, has_grid: bool, keep: Keep) -> None:
        self.result, self.total, self.places, self.has_grid, self.keep = result, total, places, has_grid, keep
        self.arrays = cache(lambda step: result.arrays(total, step))
        self.index_at_first = lru_cache(1)(self._index_at_first)
        self._tried: dict[tuple[str, ...], bytes] = {}

    @cached_property
    def grid(self) -> np.ndarray:
        """Places (row, col, 2) of the points at the first step [px]."""
        return self.places.at_first_step()

    def overview(self, steps: Sequence[str], names: Sequence[str]) -> Overview:
        """Where the points are over all steps, and between which values each quantity lies."""
        found = [_Step(self, step).extent(names) for step in steps]
        boxes = [box for box in (*(one["first_box"] for one in found[:1]), *(one["box"] for one in found)) if box]
        height, width = self.result.arrays(self.places.photographs, steps[0])["left"].shape
        return Overview(
            boxes, (width, height), {name: joined_range(one["ranges"][name] for one in found) for name in names}
        )

    def crop(self, overview: Overview, steps: Sequence[str], looks: Sequence[Look]) -> Crop:
        """The largest crop around all points for which the maps of all steps stay within a page's budget.

        The last step stands for all of them; how far a picture shrinks when it is packed depends on its noise.
        """
        last, budget = _Step(self, steps[-1]), _BUDGET_BYTES / len(steps)
        trial = StepMaps(self.result, self.total, self.places, self.has_grid, self._try)

        def fitting() -> bytes:
            density = 0.0
            for longest in _SIZES_PX:
                crop = crop_around(overview.boxes, overview.image_size, longest)
                if density * longest**2 < budget:  # a smaller picture never has fewer bytes per pixel
                    size = len(json.dumps(trial.at_step(last.name, crop, looks)))
                    if size < budget:
                        break
                    density = size / longest**2
            return json.dumps(crop).encode()

        sources = ["size", json.dumps([overview, looks, len(steps)]), *last.sources([look.quantity for look in looks])]
        smallest = crop_around(overview.boxes, overview.image_size, _SIZES_PX[-1])
        photographed = "photographed" if self._photo(last.name, smallest) else "bare"
        (width, height), scale, (x, y) = json.loads(self.keep([*sources, last.photograph, photographed], fitting))
        return Crop((width, height), scale, (x, y))

    def at_step(self, step: str, crop: Crop, looks: Sequence[Look]) -> dict[str, Any]:
        """The pictures of one step as texts: its photograph, and each quantity as it lies over it."""
        drawn = _Step(self, step).over(crop)
        fields = {look.quantity: drawn.field(look) for look in looks}
        content = {"photo": self._photo(step, crop), **drawn.reasons()}
        content["deformed"] = {name: field["deformed"] for name, field in fields.items()}
        if self.has_grid:
            content["reference"] = {name: field["reference"] for name, field in fields.items()}
            content["directions"] = drawn.directions()
        return content

    def kept(self, sources: Sequence[str], make: Callable[[], bytes]) -> bytes:
        """A piece from an earlier page, else from a trial for this one, else made now."""
        return self.keep(sources, lambda: self._tried.pop(tuple(sources), None) or make())

    def _try(self, sources: Sequence[str], make: Callable[[], bytes]) -> bytes:
        made = self._tried[tuple(sources)] = make()
        return made

    def first_photograph(self, crop: Crop) -> str | None:
        """The photograph of the first step; None if no map is drawn over it, or if the store does not keep it."""
        return (self._photo(0, crop) or None) if self.has_grid else None

    def _index_at_first(self, crop: Crop) -> NDArray[np.int32]:
        """Which cell lies at each pixel of a picture of the first step."""
        return cell_index(self.grid, crop.halved)

    def _photo(self, step: str | int, crop: Crop) -> str:
        """The photograph of a step; empty if the store does not keep it."""

        def make() -> bytes:
            return photo_jpeg(Images.read(self.result.product(self.places.photographs, step)).left, crop)

        sources = ["photograph", self.result.digest(self.places.photographs, step), json.dumps(crop)]
        try:
            return as_text(self.kept(sources, make))
        except NotKeptError:
            return ""


class _Step:
    """What is known of one step; its arrays are read when something must be made of them."""

    def __init__(self, maps: StepMaps, name: str) -> None:
        self.maps, self.name = maps, name
        self._arrays = maps.arrays(name)

    @property
    def photograph(self) -> str:
        """Digest of the photographs of the step."""
        return self.maps.result.digest(self.maps.places.photographs, self.name)

    def sources(self, arrays: Sequence[str]) -> list[str]:
        """Digests of some arrays, and of all by which the points are placed."""
        result, places = self.maps.result, self.maps.places
        found = [self._arrays[name].digest for name in ("xy", *arrays)]
        if self.maps.has_grid and places.grid is not None:
            found.append(result.digest(places.grid, 0))
        if places.photographs != places.images:
            found.append(result.digest(result.source(places.images, "rig")))
        return found

    @cached_property
    def total(self) -> Total:
        """The product."""
        return Total.read(self.maps.result.product(self.maps.total, self.name))

    @cached_property
    def here(self) -> np.ndarray:
        """Places (row, col, 2) of the points at this step [px]."""
        return self.maps.places.at_step(self.total)

    def extent(self, names: Sequence[str]) -> dict[str, Any]:
        """``box`` of the points, ``first_box`` at the first step, and ``ranges`` of the quantities; None if unknown."""

        def make() -> bytes:
            ranges = {name: colour_range(self.total[name]) for name in names}
            first = point_box(self.maps.grid) if self.maps.has_grid else None
            return json.dumps({"box": point_box(self.here), "first_box": first, "ranges": ranges}).encode()

        found: dict[str, Any] = json.loads(self.maps.keep(["extent", *names, *self.sources(names)], make))
        return found

    def over(self, crop: Crop) -> _Drawn:
        """Its pictures over a crop of the photograph."""
        return _Drawn(self, crop)


class _Drawn:
    """The pictures of one step, each kept on its own."""

    def __init__(self, step: _Step, crop: Crop) -> None:
        self._step, self._crop = step, crop

    def field(self, look: Look) -> dict[str, str]:
        """A quantity over this step, and over the first if it has the same points."""

        def make() -> dict[str, Any]:
            values = self._step.total[look.quantity]
            return {over: as_text(field_png(values, index, look)) for over, index in self._indices.items()}

        return self._kept(["field", json.dumps(look)], [look.quantity], make)

    def reasons(self) -> dict[str, Any]:
        """Why points have no value: ``reasons`` as a picture, and ``counts`` by the name of their status."""

        def make() -> dict[str, Any]:
            status = self._step.total["status"]
            if not self._step.maps.has_grid:
                return {"reasons": as_text(reason_png(status)), "counts": _counts(status[status != Status.OUTSIDE])}
            shown = worst_corner(status)[self._indices["reference"]]
            inside = np.isfinite(self._step.maps.grid).all(axis=-1)
            return {"reasons": as_text(reason_png(shown)), "counts": _counts(status[inside])}

        return self._kept(["reasons"], ["status"], make)

    def directions(self) -> dict[str, str]:
        """Lines along the principal direction of the larger strain, over the first step and over this one."""

        def make() -> dict[str, Any]:
            return _directions(self._step.total, self._step.maps.grid, self._step.here, self._crop)

        total = self._step.total
        arrays = ["angle"] if "angle" in total else ["gxy", "exx", "eyy"]
        return self._kept(["directions", total.directions], arrays, make)

    @cached_property
    def _indices(self) -> dict[str, NDArray[np.int32]]:
        """Which cell lies at each pixel of the pictures, over this step and over the first."""
        found = {"deformed": cell_index(self._step.here, self._crop)}
        if self._step.maps.has_grid:
            found["reference"] = self._step.maps.index_at_first(self._crop)
        return found

    def _kept(self, what: Sequence[str], arrays: Sequence[str], make: Callable[[], dict[str, Any]]) -> dict[str, Any]:
        """A piece, which is made of some arrays."""
        sources = [*what, json.dumps(self._crop), *self._step.sources(arrays)]
        found: dict[str, Any] = json.loads(self._step.maps.kept(sources, lambda: json.dumps(make()).encode()))
        return found


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
