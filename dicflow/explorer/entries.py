"""The entries of a manifest: steps, quantities, reasons."""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Callable, Mapping, Sequence

from dicflow.core.status import Status
from dicflow.explorer.content import Keep, Selection, first_blob
from dicflow.explorer.fields import QuantityFacts
from dicflow.explorer.manifest import Crop, FirstFacts, QuantityEntry, Reason, StepEntry
from dicflow.explorer.photographs import Photographs
from dicflow.explorer.reading import Reading
from dicflow.explorer.survey import valid_share
from dicflow.views.colours import REASON_COLOURS
from dicflow.views.crops import Crop as PhotographCrop

__all__ = ["crop_entry", "first_entry", "left_out", "quantity_entry", "reasons", "step_entry"]

Name = Callable[[bytes], str]
"""Takes a blob into the page and returns its name."""


def step_entry(
    reading: Reading, step: str, stride: int, blobs: Mapping[str, bytes], photographs: Photographs, name: Name
) -> StepEntry:
    """A step; without blobs if it was not measured."""
    one = reading.surveys.get(step)
    rows, cols = (0, 0) if one is None else one["shape"]
    return StepEntry(
        name=step,
        number=reading.result.number(reading.source.stage, step),
        shape=(-(-rows // stride), -(-cols // stride)),
        blobs={key: name(blob) for key, blob in blobs.items()},
        photos=_photos(photographs, step, name),
        counts={} if one is None else one["counts"],
        valid=None if one is None else valid_share(one),
    )


def first_entry(
    reading: Reading, chosen: Selection, photographs: Photographs, name: Name, keep: Keep
) -> FirstFacts | None:
    """The first step; None if the points have no place there."""
    blob = first_blob(reading.source, reading.scales, chosen.stride, keep)
    if blob is None or reading.first is None:
        return None
    stage = reading.source.photographs
    step = "first step" if stage is None else reading.result.steps(stage)[0]
    rows, cols = (-(-side // chosen.stride) for side in reading.first)
    return FirstFacts(name=step, place=name(blob), shape=(rows, cols), photos=_photos(photographs, step, name))


def quantity_entry(reading: Reading, facts: QuantityFacts, steps: Sequence[StepEntry]) -> QuantityEntry:
    """A quantity with its scales, colours and means."""
    scales, look = reading.scales, reading.look(facts)
    sigma, share = scales.sigmas.get(facts.name), scales.shares.get(facts.name)
    value = scales.values[facts.name]
    found = [reading.surveys.get(entry["name"]) for entry in steps]
    return QuantityEntry(
        name=facts.name,
        symbol=facts.symbol,
        title=facts.title,
        unit=facts.unit,
        signed=facts.signed,
        positive=facts.positive,
        scale=(value.low, value.quantum),
        sigma=None if sigma is None else (sigma.low, sigma.ratio),
        share=None if share is None else (share.low, share.ratio),
        range=look.range,
        colours=look.table,
        means=[None if one is None else one["means"].get(facts.name) for one in found],
    )


def reasons() -> list[Reason]:
    """Each status with the sentence that documents it."""
    lines = [line.strip() for line in inspect.getsource(Status).splitlines()]
    pairs = itertools.pairwise(lines)
    sentences = {one.split(" = ")[0]: text.strip('"') for one, text in pairs if " = " in one and text.startswith('"""')}
    return [
        Reason(code=int(code), label=code.label, sentence=sentences[code.name], colour=REASON_COLOURS.get(code, ""))
        for code in Status
    ]


def crop_entry(crop: PhotographCrop) -> Crop:
    """The part of a photograph in its own pixels."""
    width, height = crop.size
    return Crop(origin=crop.origin, size=(width / crop.scale, height / crop.scale))


def left_out(reading: Reading, chosen: Selection, photographs: Photographs) -> list[str]:
    """What a page had to leave out, in sentences."""
    dropped = [facts.symbol for facts in reading.quantities if facts.name not in chosen.quantities]
    sentences = []
    if dropped:
        sentences.append(f"left out to keep this file small: {', '.join(dropped)}")
    if chosen.stride > 1:
        sentences.append("every second point of every second row is shown, to keep this file small")
    measured = sum(map(reading.source.has, reading.source.steps))
    if len(chosen.steps) < measured:
        sentences.append(f"{len(chosen.steps)} of {measured} steps are shown, to keep this file small")
    if reading.source.photographs is not None and not photographs.pictures:
        sentences.append("photographs are left out: they are neither in the store nor in their folder, or too many")
    return sentences


def _photos(photographs: Photographs, step: str, name: Name) -> dict[str, str]:
    return {side: name(found[step]) for side, found in photographs.pictures.items() if step in found}
