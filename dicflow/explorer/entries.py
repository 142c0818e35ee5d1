"""The entries of a manifest: steps, quantities, reasons."""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Mapping, Sequence
from functools import cache
from typing import NamedTuple

from dicflow.core.status import Status
from dicflow.explorer.fields import QuantityFacts
from dicflow.explorer.manifest import Crop, FirstFacts, QuantityEntry, Reason, StepEntry
from dicflow.explorer.outside import Outside
from dicflow.explorer.reading import Reading
from dicflow.explorer.survey import valid_share
from dicflow.views.colours import REASON_COLOURS
from dicflow.views.crops import Crop as PhotographCrop

__all__ = ["Contents", "crop_entry", "first_entry", "quantity_entry", "reasons", "step_entry"]


class Contents(NamedTuple):
    """What a page shows of a reading, by the names under which it gets the numbers and photographs.

    steps, quantities : names
    stride : every how manieth row and column
    fields : step → key → name of a blob; a step that was not measured is absent
    first : name of the places at the first step, None if they are unknown
    photographs : step → side → name of a JPEG
    crops : side → part of the photographs
    left_out : sentences on what had to be left out
    """

    steps: Sequence[str]
    quantities: Sequence[str]
    stride: int
    fields: Mapping[str, Mapping[str, str]]
    first: str | None
    photographs: Mapping[str, Mapping[str, str]]
    crops: Mapping[str, PhotographCrop]
    left_out: Sequence[str]


def step_entry(reading: Reading, step: str, shown: Contents) -> StepEntry:
    """A step; without blobs if it was not measured."""
    one = reading.surveys.get(step)
    rows, cols = (0, 0) if one is None else one["shape"]
    return StepEntry(
        name=step,
        number=reading.result.number(reading.source.facts["stage"], step),
        shape=(-(-rows // shown.stride), -(-cols // shown.stride)),
        blobs=dict(shown.fields.get(step, {})),
        photos=dict(shown.photographs.get(step, {})),
        counts={} if one is None else one["counts"],
        valid=None if one is None else valid_share(one),
    )


def first_entry(reading: Reading, shown: Contents) -> FirstFacts | None:
    """The first step; None if the points have no place there."""
    if shown.first is None or reading.first is None:
        return None
    stage = reading.source.photographs
    step = "first step" if stage is None else reading.result.steps(stage)[0]
    rows, cols = (-(-side // shown.stride) for side in reading.first)
    photographs = dict(shown.photographs.get(step, {}))
    return FirstFacts(name=step, place=shown.first, shape=(rows, cols), photos=photographs)


def quantity_entry(reading: Reading, facts: QuantityFacts, steps: Sequence[StepEntry]) -> QuantityEntry:
    """A quantity with its scales, colours and means."""
    scales, look = reading.scales, reading.look(facts)
    value = scales.values[facts["name"]]
    errors = {part: found[facts["name"]] for part, found in scales.errors.items() if facts["name"] in found}
    found = [reading.surveys.get(entry["name"]) for entry in steps]
    return QuantityEntry(
        **facts,
        scale=(value.low, value.quantum),
        errors={part: (one.low, one.ratio) for part, one in errors.items()},
        range=look.range,
        colours=look.table,
        means=[None if one is None else one["means"].get(facts["name"]) for one in found],
    )


def reasons() -> list[Reason]:
    """Each status with the sentence that documents it; "outside" by what the point is outside of."""
    found = [_reason(code, code.label, REASON_COLOURS.get(code, "")) for code in Status]
    found[Status.OUTSIDE] = Reason(
        code=int(Status.OUTSIDE),
        label="outside the region",
        sentence="Outside of the region of interest, or of the photograph.",
        colour=REASON_COLOURS[Status.OUTSIDE],
    )
    return [*found, *(_reason(code, code.label, code.colour) for code in Outside)]


def _reason(code: Status | Outside, label: str, colour: str) -> Reason:
    return Reason(code=int(code), label=label, sentence=_sentences(type(code))[code.name], colour=colour)


@cache
def _sentences(codes: type[Status | Outside]) -> dict[str, str]:
    """Name of a code → the sentence below it in the source."""
    lines = [line.strip() for line in inspect.getsource(codes).splitlines()]
    pairs = itertools.pairwise(lines)
    return {one.split(" = ")[0]: text.strip('"') for one, text in pairs if " = " in one and text.startswith('"""')}


def crop_entry(crop: PhotographCrop) -> Crop:
    """The part of a photograph in its own pixels."""
    width, height = crop.size
    return Crop(origin=crop.origin, size=(width / crop.scale, height / crop.scale))
