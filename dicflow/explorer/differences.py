"""Differences of two results, point by point, as fields that the explorer shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dicflow.core.status import Status
from dicflow.explorer.fields import FieldFacts, FieldSource, QuantityFacts, StepFields

__all__ = ["DifferenceFields", "obstacle"]

Array = NDArray[Any]
_SAME_PLACE_PX = 1e-6


def obstacle(one: FieldSource, other: FieldSource) -> str:
    """Why two results have no difference point by point, as a sentence; empty if they have one."""
    if not any(one.has(step) and other.has(step) for step in one.steps if step in other.steps):
        return "No step has the same name and fields in both."
    if not _common(one.quantities(), other.quantities()):
        return "No quantity has the same name and unit in both."
    if one.first_sources() is None or other.first_sources() is None:
        return "The points of one of them are not the same material at every step."
    if not _is_same_grid(one.at_first(), other.at_first()):
        return "Their grids differ, so no point is in both; 'dicflow compare' interpolates."
    return ""


class DifferenceFields:
    """One result minus another whose points are the same ones. Places and photographs are those of the first.

    There is no uncertainty: two results of the same photographs share most of the noise.
    """

    def __init__(self, one: FieldSource, other: FieldSource) -> None:
        self._one, self._other = one, other
        self.facts: FieldFacts = {**one.facts, "form": "difference", "directions": ""}
        self.steps: Sequence[str] = [step for step in one.steps if step in other.steps]
        self.photographs = one.photographs
        self._common = _common(one.quantities(), other.quantities())

    def quantities(self) -> Sequence[QuantityFacts]:
        """Those of both in the same unit, but for angles."""
        return list(self._common.values())

    def has(self, step: str) -> bool:
        """Whether the step was measured in both."""
        return self._one.has(step) and self._other.has(step)

    def sources(self, step: str) -> list[str]:
        """Digests of all that the fields of a step are made of."""
        return ["difference", *self._one.sources(step), "minus", *self._other.sources(step)]

    def read(self, step: str) -> StepFields:
        """The fields of a step. A point without a value in one of them has the status of that one."""
        one, other = self._one.read(step), self._other.read(step)
        names = [name for name in self._common if name in one.values and name in other.values]
        values = {name: one.values[name].astype(float) - other.values[name] for name in names}
        status = np.where(one.status <= Status.FILLED, other.status, one.status)
        return StepFields(values, {}, status, one.places)

    def at_point(self, step: str, quantity: str, index: int) -> tuple[float, float]:
        """Difference at a point; its uncertainty is unknown."""
        one, other = (source.at_point(step, quantity, index)[0] for source in (self._one, self._other))
        return one - other, np.nan

    def first_sources(self) -> list[str] | None:
        """Digests of all that places at the first step are made of."""
        return self._one.first_sources()

    def at_first(self) -> Array:
        """Places of the points in the first left photograph [px]."""
        return self._one.at_first()


def _common(ones: Sequence[QuantityFacts], others: Sequence[QuantityFacts]) -> Mapping[str, QuantityFacts]:
    """What a page says of the differences. That of an angle jumps by half a turn, so it is left out."""
    known = {facts["name"]: facts for facts in others}
    found = [facts for facts in ones if facts["name"] in known]
    return {
        facts["name"]: _difference(facts, known[facts["name"]])
        for facts in found
        if facts["unit"] == known[facts["name"]]["unit"] != "deg"
    }


def _difference(one: QuantityFacts, other: QuantityFacts) -> QuantityFacts:
    return {**one, "symbol": f"Δ{one['symbol']}", "title": _title(one, other), "signed": True, "positive": ""}


def _title(one: QuantityFacts, other: QuantityFacts) -> str:
    if one["title"] == other["title"]:
        return f"difference of {one['title']}"
    return f"difference of {one['title']} and {other['title']}"


def _is_same_grid(one: Array, other: Array) -> bool:
    if one.shape != other.shape:
        return False
    apart = np.abs(one - other)
    return bool(np.isfinite(apart).any()) and float(np.nanmax(apart)) < _SAME_PLACE_PX
