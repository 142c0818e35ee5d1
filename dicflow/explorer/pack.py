"""A result as a manifest and its blobs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from dicflow.core.threads import over
from dicflow.explorer.content import Keep, Selection, first_blob, select, step_blobs
from dicflow.explorer.described import manifest_of
from dicflow.explorer.entries import Contents
from dicflow.explorer.manifest import Manifest
from dicflow.explorer.packing import blob_name
from dicflow.explorer.photographs import Photographs, Series, boxes_of
from dicflow.explorer.reading import Reading, read_result
from dicflow.pipeline.result import Result

__all__ = ["Packed", "pack", "packed_result"]

_PHOTOGRAPHS = 0.3
"""Largest share of the budget for photographs."""
_BASE64 = 4 / 3


class Packed(NamedTuple):
    """A manifest, and name → blob of all that it names."""

    manifest: Manifest
    blobs: Mapping[str, bytes]


def packed_result(result: Result, title: str, keep: Keep, budget_bytes: float = 8e6, threads: int = 1) -> Packed | None:
    """The fields of a result for a page; None if no step has any.

    title : of the pipeline
    keep : keeps pieces from one page to the next; threads may call it
    budget_bytes : of the blobs as base64
    threads : so many steps are read at once
    """
    reading = read_result(result, keep, threads)
    return None if reading is None else pack(reading, title, keep, budget_bytes, threads)


def pack(reading: Reading, title: str, keep: Keep, budget_bytes: float, threads: int = 1) -> Packed:
    """What was read as a manifest and its blobs; as :func:`packed_result`."""
    budget = budget_bytes / _BASE64
    chosen = _selection(reading, (1 - _PHOTOGRAPHS) * budget, keep)
    photographs = _photographs(reading, chosen, _PHOTOGRAPHS * budget, keep, threads)
    rest = budget - sum(len(one) for found in photographs.pictures.values() for one in found.values())
    chosen = _selection(reading, rest, keep, chosen.steps)
    blobs: dict[str, bytes] = {}
    shown = _contents(reading, chosen, photographs, blobs, keep, threads)
    return Packed(manifest_of(reading, title, shown, keep), blobs)


def _selection(reading: Reading, budget_bytes: float, keep: Keep, steps: Sequence[str] | None = None) -> Selection:
    """What fits of some steps, or of all; the main step stands for them."""
    measured = list(reading.surveys) if steps is None else steps
    everything = Selection(reading.importance, 1, measured)
    main = step_blobs(reading.source, reading.main[1], reading.scales, everything, keep)
    return select(main, reading.importance, measured, budget_bytes)


def _photographs(reading: Reading, chosen: Selection, budget_bytes: float, keep: Keep, threads: int) -> Photographs:
    stage = reading.source.photographs
    if stage is None:
        return Photographs({}, {})
    names = reading.result.steps(stage)
    first = names[:1] if reading.first is not None else ()
    steps = list(dict.fromkeys([*first, *(step for step in chosen.steps if step in names)]))
    return Series(reading.result, stage, steps, keep).fitting(boxes_of(reading.scales), budget_bytes, threads)


def _left_out(reading: Reading, chosen: Selection, photographs: Photographs) -> list[str]:
    """What a page had to leave out, in sentences."""
    dropped = [facts["symbol"] for facts in reading.quantities if facts["name"] not in chosen.quantities]
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


def _contents(
    reading: Reading,
    chosen: Selection,
    photographs: Photographs,
    blobs: dict[str, bytes],
    keep: Keep,
    threads: int,
) -> Contents:
    """What is shown. blobs : takes what it names"""

    def name(blob: bytes) -> str:
        found = blob_name(blob)
        blobs[found] = blob
        return found

    made = over(threads, lambda one: step_blobs(reading.source, one, reading.scales, chosen, keep), chosen.steps)
    first = first_blob(reading.source, reading.scales, chosen.stride, keep)
    pictures: dict[str, dict[str, str]] = {}
    for side, found in photographs.pictures.items():
        for step, picture in found.items():
            pictures.setdefault(step, {})[side] = name(picture)
    return Contents(
        steps=list(reading.steps) if len(chosen.steps) == len(reading.surveys) else list(chosen.steps),
        quantities=chosen.quantities,
        stride=chosen.stride,
        fields={
            one: {key: name(blob) for key, blob in found.items()} for one, found in zip(chosen.steps, made, strict=True)
        },
        first=None if first is None else name(first),
        photographs=pictures,
        crops=photographs.crops,
        left_out=_left_out(reading, chosen, photographs),
    )
