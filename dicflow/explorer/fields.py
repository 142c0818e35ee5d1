"""What the explorer shows of a result: values, standard deviations, reasons and places of points, step by step."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from functools import cached_property
from typing import Any, Literal, NamedTuple, Protocol, TypedDict

import numpy as np
from numpy.typing import NDArray

from dicflow.errors import DicflowError
from dicflow.explorer.outside import status_by_photograph
from dicflow.kinds.cloud import Cloud
from dicflow.kinds.points import Points
from dicflow.kinds.quantities import ERRORS, QUANTITIES, is_signed, of_field
from dicflow.kinds.rig import CalibratedRig
from dicflow.kinds.total import Total
from dicflow.pipeline.places import Places, to_left_photograph
from dicflow.pipeline.result import Result

__all__ = [
    "ERROR_PARTS",
    "FieldFacts",
    "FieldSource",
    "QuantityFacts",
    "ShapeFields",
    "StepFields",
    "TotalFields",
    "field_source",
]

Array = NDArray[Any]
_ROUTES = ("status", "way", "way_right")
ERROR_PARTS = {"u": "u_", "sigma": "sigma_", "bias": "bias_", "share": "calibration_"}
"""What is known of the error of a value, and how names of its arrays begin in a total: combined standard uncertainty,
standard deviation by noise, that of the bias that remains, and the calibration's share beside them."""
_FROM_FIRST = frozenset(QUANTITIES) - {"angle"}
"""Displacement and what follows from it."""
_KEPT_BYTES = 30_000_000
"""Memory for steps of all results that were read last, since they are read twice, and again for a difference."""
_MOST_POINTS = 60_000
"""Of a shape; a cloud has a point per pixel, and more than these are not seen."""


class FieldFacts(TypedDict):
    """What is known of fields before their numbers.

    stage : whose fields these are
    form : "deformation", "shape" for places without displacement, "difference" of two results
    unit : of lengths
    follows : whether a point is the same material at every step
    directions : whether x and y of strains are the "material"'s or "global"; "" if x is not the photograph's
    """

    stage: str
    form: Literal["deformation", "shape", "difference"]
    unit: str
    follows: bool
    directions: Literal["material", "global", ""]


class QuantityFacts(TypedDict):
    """What a page says of a quantity.

    name : of its array
    symbol : as in a formula
    title : in words, with the gauge of a strain
    unit : of its values; "1" for a pure number
    signed : whether values of both signs mean opposite things
    positive : what a positive value means; "" if unknown
    starts : whether it is 0 at the first step, since it counts from there
    """

    name: str
    symbol: str
    title: str
    unit: str
    signed: bool
    positive: str
    starts: bool


class StepFields(NamedTuple):
    """The points of one step.

    values : quantity → (row, col); NaN if unknown
    errors : each of ``ERROR_PARTS`` → quantity → (row, col); NaN if unknown. Without a bias there is no "u", which is
        "sigma" then
    status : (row, col) — valid, filled, or why a value is unknown
    places : "left" and "right" (row, col, 2) in the photographs [px], "space" (row, col, 3)
    """

    values: Mapping[str, Array]
    errors: Mapping[str, Mapping[str, Array]]
    status: Array
    places: Mapping[str, Array]


class FieldSource(Protocol):
    """Fields of one stage of a result.

    steps : names of all its steps
    photographs : the stage of the photographs in which points are placed; None if unknown
    """

    facts: FieldFacts
    steps: Sequence[str]
    photographs: str | None

    def quantities(self) -> Sequence[QuantityFacts]:
        """All quantities."""

    def has(self, step: str) -> bool:
        """Whether the step was measured."""

    def sources(self, step: str) -> list[str]:
        """Digests of all that the fields of a step are made of."""

    def read(self, step: str) -> StepFields:
        """The fields of a step."""

    def at_point(self, step: str, quantity: str, index: int) -> tuple[float, float]:
        """Value of a quantity at a point, by its number in the grid, and its standard uncertainty; NaN if unknown."""

    def first_sources(self) -> list[str] | None:
        """Digests of all that places at the first step are made of; None if they are unknown."""

    def at_first(self) -> Array:
        """Places (row, col, 2) of the points in the first left photograph [px]."""


def field_source(result: Result, variant: int = 0) -> FieldSource | None:
    """Fields of the total that the maps stage draws, else of the last total, else the shape; None without points."""
    result = result.of_one_test()
    drawn = [result.source(stage, "total", variant) for stage in result.stages_of("maps")]
    for stage in (*drawn, *reversed(result.stages_of("total"))):
        if any(result.has(stage, step, variant) for step in result.steps(stage, variant)):
            return TotalFields(result, stage, variant)
    for kind in ("points", "cloud"):
        for stage in reversed(result.stages_of(kind)):
            if any(result.has(stage, step, variant) for step in result.steps(stage, variant)):
                return ShapeFields(result, stage, variant)
    return None


class TotalFields:
    """Fields of displacement and strain."""

    def __init__(self, result: Result, stage: str, variant: int = 0) -> None:
        self._result, self._variant, self._stage = result, variant, stage
        self.steps: Sequence[str] = result.steps(stage, variant)
        self._places = Places(result, variant)
        self.photographs: str | None = self._places.photographs
        first = self._total(next(step for step in self.steps if self.has(step)))
        turned = bool(result.stages_of("frame")) or not first.follows_material
        self._example = first
        self.facts = FieldFacts(
            stage=stage,
            form="deformation",
            unit=first.unit,
            follows=first.follows_material,
            directions="" if turned else first.directions,
        )

    def quantities(self) -> Sequence[QuantityFacts]:
        """Those of the table in its order, then all other fields."""
        flat = () if self._example.in_space else ("W",)
        names = [name for name in self._example.fields if not name.startswith(tuple(ERRORS))]
        names = [name for name in names if name not in (*_ROUTES, *flat)]
        order = [*(name for name in QUANTITIES if name in names), *(name for name in names if name not in QUANTITIES)]
        return [self._facts(name) for name in order]

    def has(self, step: str) -> bool:
        """Whether the step was measured."""
        return self._result.has(self._stage, step, self._variant)

    def sources(self, step: str) -> list[str]:
        """Digests of the total, of the right camera's points, and of the rig that carries places into photographs."""
        found = [self._result.digest(self._stage, step, self._variant), *self._rig]
        if self._right is not None:
            found.append(self._result.digest(self._right, step, self._variant))
        return [*found, *(self._result.digest(*one, self._variant) for one in self._seen(step)[:1])]

    def read(self, step: str) -> StepFields:
        """The fields of a step."""
        return _kept(self.sources(step), lambda: self._read(step))

    def _read(self, step: str) -> StepFields:
        total = self._total(step)
        names = [quantity["name"] for quantity in self.quantities() if quantity["name"] in total]
        places = {"left": self._places.at_step(total)}
        if total.in_space:
            places["space"] = total["xyz"]
        if self._right is not None:
            right = self._result.product(self._right, step, self._variant)["xy"]
            places["right"] = np.where(np.isfinite(places["space"][..., :1]), right, np.nan)
        return StepFields(
            {name: total[name] for name in names}, _errors(total, names), self._status(total, step), places
        )

    def _status(self, total: Total, step: str) -> Array:
        """The status of each point; of one outside, which photograph it has left, where that is known."""
        found = [self._result.product(*one, self._variant)["status"] for one in self._seen(step)]
        return status_by_photograph(total["status"], self._inside, *found) if found else total["status"]

    def _seen(self, step: str) -> list[tuple[str, str | int]]:
        """Stage and step of points in the left photograph, in the right one, and there at first; none if one lacks."""
        grid = self._places.grid
        if grid is None or not self.facts["follows"] or self._result.kind(grid) != "correlation":
            return []
        right: list[tuple[str, str | int]] = [] if self._right is None else [(self._right, step), (self._right, 0)]
        needed = [(grid, step), *right]
        return needed if all(self._result.has(*one, self._variant) for one in needed) else []

    @cached_property
    def _inside(self) -> Array:
        """Points (row, col) of the region."""
        return np.asarray(np.isfinite(self.at_first()).all(axis=-1))

    def at_point(self, step: str, quantity: str, index: int) -> tuple[float, float]:
        """Value and standard uncertainty at a point; no other array is read."""
        total = self._total(step)
        error = next((p + quantity for p in ("u_", "sigma_") if p + quantity in total), "")
        return _number(total, quantity, index), _number(total, error, index)

    def first_sources(self) -> list[str] | None:
        """Digests of the grid and of the rig; None where each step has a grid of its own."""
        if not self.facts["follows"] or self._places.grid is None:
            return None
        return [self._result.digest(self._places.grid, 0, self._variant), *self._rig]

    def at_first(self) -> Array:
        """Places of the whole grid at the first step."""
        return self._places.at_first_step()

    @cached_property
    def _rig(self) -> list[str]:
        """Digest of the rig that carries places into the photographs, if one does."""
        if self._places.photographs == self._places.images:
            return []
        return [
            self._result.digest(self._result.source(self._places.images, "rig", self._variant), None, self._variant)
        ]

    @cached_property
    def _right(self) -> str | None:
        """The stage with places in the right photograph; points in space are made again when they are read."""
        try:
            points = self._result.source(self._stage, "points", self._variant)
            return self._result.source(points, "stereo", self._variant)
        except KeyError:
            return None

    def _total(self, step: str) -> Total:
        return Total.read(self._result.product(self._stage, step, self._variant))

    def _facts(self, name: str) -> QuantityFacts:
        quantity, total = of_field(name), self._example
        if quantity is None:
            symbol, signed, positive = name.upper(), False, ""
        else:
            symbol, signed, positive = quantity.symbol, is_signed(name), quantity.positive
        return QuantityFacts(
            name=name,
            symbol=symbol,
            title=total.caption(name),
            unit=total.unit_of(name),
            signed=signed,
            positive=positive,
            starts=name in _FROM_FIRST,
        )


_read_last: OrderedDict[tuple[str, ...], StepFields] = OrderedDict()
"""Fields by the digests of what they are made of, those that were used last at the end."""
_keeping = threading.Lock()


def _kept(sources: Sequence[str], make: Callable[[], StepFields]) -> StepFields:
    """Fields that were read before, or that are made now. They are shared: nobody changes them."""
    key = tuple(sources)
    with _keeping:
        found = _read_last.pop(key, None)
    if found is None:
        found = make()
    with _keeping:
        _read_last[key] = found
        while len(_read_last) > 1 and sum(map(_size, _read_last.values())) > _KEPT_BYTES:
            _read_last.popitem(last=False)
    return found


def _size(fields: StepFields) -> int:
    """Memory of the arrays of a step [bytes]."""
    numbers = (fields.values, fields.places, *fields.errors.values())
    return fields.status.nbytes + sum(array.nbytes for found in numbers for array in found.values())


class ShapeFields:
    """Places in space of a test without deformation: the depth and the coordinates of its points."""

    def __init__(self, result: Result, stage: str, variant: int = 0) -> None:
        self._result, self._variant, self._stage = result, variant, stage
        self.facts = FieldFacts(stage=stage, form="shape", unit="mm", follows=True, directions="")
        self.steps: Sequence[str] = result.steps(stage, variant)
        self.photographs: str | None = next(iter(result.stages_of("images")), None)
        with suppress(IndexError, KeyError):  # without a region
            self.photographs = Places(result, variant).photographs

    def quantities(self) -> Sequence[QuantityFacts]:
        """Depth first, then X and Y, in the left camera's frame."""
        words = {"Z": "depth Z", "X": "place X", "Y": "place Y"}
        return [
            QuantityFacts(name=name, symbol=name, title=title, unit="mm", signed=False, positive="", starts=False)
            for name, title in words.items()
        ]

    def has(self, step: str) -> bool:
        """Whether the step was measured."""
        return self._result.has(self._stage, step, self._variant)

    def sources(self, step: str) -> list[str]:
        """Digests of the points and of all rigs."""
        rigs = [stage for stage in self._result.stages_of("rig") if self._result.has(stage, None, self._variant)]
        found = [self._result.digest(stage, None, self._variant) for stage in rigs]
        return [self._result.digest(self._stage, step, self._variant), *found]

    def read(self, step: str) -> StepFields:
        """The fields of a step."""
        product = self._result.product(self._stage, step, self._variant)
        if product.kind == "cloud":
            return self._of_cloud(Cloud.read(product))
        followed = self._result.source(self._stage, "correlation", self._variant)
        return _of_points(Points.read(product), self._result.product(followed, step, self._variant)["xy"])

    def at_point(self, step: str, quantity: str, index: int) -> tuple[float, float]:
        """Value and standard uncertainty at a point."""
        fields = self.read(step)
        return _number(fields.values, quantity, index), _number(fields.errors.get("sigma", {}), quantity, index)

    def first_sources(self) -> list[str] | None:
        """None: a shape is shown at its own step."""
        return None

    def at_first(self) -> Array:
        """Places of the points in the left photograph of the first step."""
        return self.read(self.steps[0]).places["left"]

    def _of_cloud(self, cloud: Cloud) -> StepFields:
        stride = max(1, int(np.ceil(np.sqrt(cloud["status"].size / _MOST_POINTS))))
        chosen = (slice(None, None, stride),) * 2
        xyz, status = cloud["xyz"][chosen].astype(float), cloud["status"][chosen]
        rows, cols = np.indices(cloud["status"].shape)
        pixels = np.stack([cols, rows], axis=-1)[chosen] + np.array(cloud.origin, dtype=float)
        places: dict[str, Array] = {"space": xyz}
        if (carried := self._carried(pixels)) is not None:
            places["left"] = carried
        return StepFields(_coordinates(xyz), {}, status, places)

    def _carried(self, pixels: Array) -> Array | None:
        """Pixels of the rectified left image in the left photograph; None without a rig."""
        for stage in reversed(self._result.stages_of("rig")):
            try:
                rig = CalibratedRig.read(self._result.product(stage, None, self._variant)).cameras
            except DicflowError:
                continue
            mapping = to_left_photograph("rectified", rig)
            return None if mapping is None else np.asarray(mapping(pixels))
        return None


def _errors(total: Total, names: Sequence[str]) -> dict[str, dict[str, Array]]:
    """What is known of the errors of quantities, by part and name."""
    biased = [name for name in names if f"bias_{name}" in total]
    return {
        part: {name: total[prefix + name] for name in (biased if part == "u" else names) if prefix + name in total}
        for part, prefix in ERROR_PARTS.items()
    }


def _number(arrays: Mapping[str, Array] | Total, name: str, index: int) -> float:
    """A number of an array by its place in the flat array; NaN where it is unknown."""
    return float(arrays[name].flat[index]) if name in arrays and index < arrays[name].size else np.nan


def _of_points(points: Points, left: Array) -> StepFields:
    """Coordinates of measured points and their standard deviations. left : places (row, col, 2), also of lost ones"""
    xyz, covariance = points["xyz"], points["covariance"]
    variances = {"X": covariance[..., 0], "Y": covariance[..., 3], "Z": covariance[..., 5]}
    sigmas = {name: np.sqrt(np.maximum(variance, 0.0)) for name, variance in variances.items()}
    places = {"left": left, "right": points["xy_right"], "space": xyz}
    return StepFields(_coordinates(xyz), {"sigma": sigmas}, points["status"], places)


def _coordinates(xyz: Array) -> dict[str, Array]:
    return {"Z": xyz[..., 2], "X": xyz[..., 0], "Y": xyz[..., 1]}
