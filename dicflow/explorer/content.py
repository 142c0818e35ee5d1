"""The packed fields of steps, and which of them fit into a page."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from dicflow.explorer.fields import ERROR_PARTS, FieldSource, StepFields
from dicflow.explorer.packing import LinearScale, LogScale, packed
from dicflow.explorer.survey import Scales

__all__ = ["Keep", "Selection", "first_blob", "key_of", "select", "step_blobs"]

Keep = Callable[[Sequence[str], Callable[[], bytes]], bytes]
"""Returns the bytes made from some sources, by the function unless they are kept from an earlier call."""

_CORE = 4
"""Quantities that a page keeps before points or steps are left out."""
_MARGIN = 1.1
"""Steps may need so much more than the one that stands for all."""


class Selection(NamedTuple):
    """What a page shows.

    quantities : by name, in their order
    stride : every how manieth row and column
    steps : names
    """

    quantities: Sequence[str]
    stride: int
    steps: Sequence[str]


def key_of(part: str, name: str) -> str:
    """Key of a blob of a step: part "value", "place", or one of ``ERROR_PARTS``."""
    return f"{part}/{name}"


def step_blobs(source: FieldSource, step: str, scales: Scales, chosen: Selection, keep: Keep) -> dict[str, bytes]:
    """Blobs of a step by key: each quantity's values and errors, the status, and the places."""
    names = [*chosen.quantities]
    facts = json.dumps([scales.values, scales.errors, scales.places, names, chosen.stride])
    made = keep(
        ["packed fields", facts, *source.sources(step)], lambda: _joined(_blobs(source.read(step), scales, chosen))
    )
    return _parted(made)


def first_blob(source: FieldSource, scales: Scales, stride: int, keep: Keep) -> bytes | None:
    """Places in the first left photograph; None if they are unknown."""
    sources, left = source.first_sources(), scales.places.get("left")
    if sources is None or left is None:
        return None
    facts = json.dumps([left, stride])
    return keep(["first places", facts, *sources], lambda: _packed_places(source.at_first()[::stride, ::stride], left))


def select(
    blobs: Mapping[str, bytes], importance: Sequence[str], steps: Sequence[str], budget_bytes: float
) -> Selection:
    """What fits into a budget: fewer quantities first, then every second point, then fewer steps.

    blobs : of a step that stands for all, with every quantity
    importance : quantities, the most important first
    """
    sizes = {key: len(blob) * _MARGIN for key, blob in blobs.items()}
    each = {name: sum(sizes.get(key_of(part, name), 0.0) for part in ("value", *ERROR_PARTS)) for name in importance}
    places = sum(sizes.values()) - sum(each.values())
    for stride in (1, 2):
        room = budget_bytes / max(1, len(steps)) * stride**2
        kept = _fitting(each, room - places)
        if len(kept) >= min(_CORE, len(importance)):
            return Selection(kept, stride, steps)
    core = list(importance[:_CORE])
    count = int(budget_bytes * stride**2 / (places + sum(each[name] for name in core)))
    return Selection(core, stride, spread(steps, max(2, count)))


def spread(steps: Sequence[str], most: int) -> list[str]:
    """At most so many steps, evenly from the first to the last."""
    count = min(len(steps), most)
    return [steps[round(number * (len(steps) - 1) / max(1, count - 1))] for number in range(count)]


def _fitting(each: Mapping[str, float], room: float) -> list[str]:
    """The longest beginning that fits."""
    kept: list[str] = []
    for name, size in each.items():
        room -= size
        if room < 0:
            break
        kept.append(name)
    return kept


def _blobs(fields: StepFields, scales: Scales, chosen: Selection) -> dict[str, bytes]:
    thin = (slice(None, None, chosen.stride),) * 2
    found = {"status": packed(fields.status[thin].astype(np.uint8))}
    for name, values in fields.places.items():
        if name in scales.places:
            found[key_of("place", name)] = _packed_places(values[thin], scales.places[name])
    numbers: dict[str, Mapping[str, Any]] = {"value": fields.values, **fields.errors}
    tables: dict[str, Mapping[str, LinearScale | LogScale]] = {"value": scales.values, **scales.errors}
    for name in chosen.quantities:
        for part, arrays in numbers.items():
            if name in arrays and name in tables[part]:
                found[key_of(part, name)] = packed(tables[part][name].codes(arrays[name][thin]))
    return found


def _packed_places(places: Any, scales: Sequence[LinearScale]) -> bytes:
    known = np.isfinite(places).all(axis=-1)
    codes = [scale.codes(np.where(known, places[..., k], np.nan)) for k, scale in enumerate(scales)]
    return packed(np.stack(codes, axis=-1))


def _joined(blobs: Mapping[str, bytes]) -> bytes:
    """Blobs in one piece: lengths by key as a line of JSON, then the blobs."""
    return json.dumps({key: len(blob) for key, blob in blobs.items()}).encode() + b"\n" + b"".join(blobs.values())


def _parted(piece: bytes) -> dict[str, bytes]:
    head, _, rest = piece.partition(b"\n")
    found, start = {}, 0
    for key, length in json.loads(head).items():
        found[key], start = rest[start : start + length], start + length
    return found
