"""What is known of a result before its numbers are packed."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from typing import NamedTuple, TypedDict

import numpy as np

from dicflow.core.threads import over
from dicflow.explorer.content import Keep, spread
from dicflow.explorer.fields import FieldSource, QuantityFacts, field_source
from dicflow.explorer.survey import Scales, StepSurvey, extents, scales_of, survey
from dicflow.kinds.maps import Maps, joined_range
from dicflow.kinds.quantities import REPORTED
from dicflow.pipeline.result import Result
from dicflow.views.colours import DIVERGING, Look, look
from dicflow.views.figures import maps_of

__all__ = ["Reading", "read_result", "read_source", "surveyed"]

_MOST_STEPS, _FEW_STEPS = 60, 24
"""Steps that a page shows at most, and of a longer series without maps."""


class Reading(NamedTuple):
    """A result, read once.

    steps : names of the steps that were looked at; surveys : those that were measured, with their facts
    first : rows and columns of the grid at the first step, None if its places are unknown
    quantities : that have values
    maps : of the maps stage, None without one
    """

    result: Result
    source: FieldSource
    steps: Sequence[str]
    surveys: Mapping[str, StepSurvey]
    scales: Scales
    first: tuple[int, int] | None
    quantities: Sequence[QuantityFacts]
    maps: Maps | None

    @property
    def main(self) -> tuple[str, str]:
        """Quantity and step to show first: the normal strain, or else the displacement, of largest mean."""
        for group in (("exx", "eyy"), ("U", "V", "W")):
            found = [
                (abs(one["means"][name][0]), name, step)
                for step, one in self.surveys.items()
                for name in group
                if name in one["means"]
            ]
            if found:
                _size, name, step = max(found)
                return name, step
        return self.quantities[0]["name"], list(self.surveys)[-1]

    @property
    def importance(self) -> list[str]:
        """Quantities, the most important first: the main one, those of the maps, of reports, all others."""
        known = [facts["name"] for facts in self.quantities]
        order = [self.main[0], *(self.maps.quantities if self.maps is not None else ()), *REPORTED, *known]
        return [name for name in dict.fromkeys(order) if name in known]

    def look(self, facts: QuantityFacts) -> Look:
        """Colours of a quantity: those of the maps where they draw it, of a difference about zero."""
        name = facts["name"]
        if self.maps is not None and name in self.maps.quantities:
            (low, high), choice = self.maps.quantities[name].range, self.maps.colour_map
        else:
            low, high = joined_range(one["colours"].get(name) for one in self.surveys.values())
            choice = "auto"
        if self.source.facts["form"] == "difference":
            high = max(abs(low), abs(high))
            low, choice = -high, DIVERGING
        return look(name, facts["title"], facts["unit"], low, high, choice)


def read_result(result: Result, keep: Keep, threads: int = 1) -> Reading | None:
    """One reading of all steps, or of some of a long series; None if no step has fields.

    threads : so many steps are read at once
    """
    source = field_source(result)
    return None if source is None else _read(result, source, keep, _page_steps(result, source), threads)


def read_source(result: Result, source: FieldSource, keep: Keep, most_steps: int) -> Reading | None:
    """One reading of chosen fields at so many steps, evenly from the first to the last.

    result : has the photographs
    """
    return _read(result, source, keep, spread(source.steps, most_steps))


def _page_steps(result: Result, source: FieldSource) -> Sequence[str]:
    """All steps; of a long series those of which there are maps, else evenly chosen ones."""
    steps = source.steps
    if len(steps) <= _MOST_STEPS:
        return steps
    maps = maps_of(result, source.facts["stage"])
    drawn = () if maps is None or len(maps.phases) != len(steps) else maps.drawn
    return [steps[number] for number in drawn] if 0 < len(drawn) <= _MOST_STEPS else spread(steps, _FEW_STEPS)


def _read(result: Result, source: FieldSource, keep: Keep, steps: Sequence[str], threads: int = 1) -> Reading | None:
    measured = [step for step in steps if source.has(step)]
    found = over(threads, lambda step: surveyed(source, step, keep), measured)
    surveys = dict(zip(measured, found, strict=True))
    first = _first(source, keep)
    scales = scales_of([*surveys.values()], None if first is None else first["extents"])
    quantities = [facts for facts in source.quantities() if facts["name"] in scales.values]
    if not quantities:
        return None
    grid = None if first is None else first["shape"]
    maps = None if source.facts["form"] == "difference" else maps_of(result, source.facts["stage"])
    return Reading(result, source, steps, surveys, scales, grid, quantities, maps)


def surveyed(source: FieldSource, step: str, keep: Keep) -> StepSurvey:
    """Facts of a step, also from a piece that is kept."""
    first = source.first_sources()

    def make() -> bytes:
        inside = None if first is None else np.asarray(np.isfinite(source.at_first()).all(axis=-1))
        return json.dumps(survey(source.read(step), inside)).encode()

    found: StepSurvey = json.loads(keep(["survey", *source.sources(step), *(first or ())], make))
    return found


class _First(TypedDict):
    """Rows and columns of the grid at the first step, and the extents of its places."""

    shape: tuple[int, int]
    extents: list[tuple[float, float]]


def _first(source: FieldSource, keep: Keep) -> _First | None:
    """Facts of the first step; None if places are unknown there."""
    sources = source.first_sources()
    if sources is None:
        return None

    def make() -> bytes:
        places = source.at_first()
        return json.dumps(_First(shape=places.shape[:2], extents=extents(places))).encode()

    found: _First = json.loads(keep(["first step", *sources], make))
    return found
