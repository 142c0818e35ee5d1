"""A result as a manifest and its blobs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

from dicflow.explorer.cameras import camera_facts
from dicflow.explorer.content import Keep, Selection, select, step_blobs
from dicflow.explorer.curves import loads, probe_curves
from dicflow.explorer.entries import crop_entry, first_entry, left_out, quantity_entry, reasons, step_entry
from dicflow.explorer.manifest import Manifest, QuantityEntry
from dicflow.explorer.packing import LINEAR_CODES, LinearScale, blob_name
from dicflow.explorer.photographs import Photographs, Series
from dicflow.explorer.reading import Reading, read_result
from dicflow.pipeline.result import Result
from dicflow.views.colours import palette
from dicflow.views.crops import Box

__all__ = ["Packed", "pack", "packed_result"]

_PALETTES = ("viridis", "RdBu_r", "cividis", "magma", "turbo", "Greys_r")
_PHOTOGRAPHS = 0.3
"""Largest share of the budget for photographs."""
_BASE64 = 4 / 3


class Packed(NamedTuple):
    """A manifest, and name → blob of all that it names."""

    manifest: Manifest
    blobs: Mapping[str, bytes]


def packed_result(result: Result, title: str, keep: Keep, budget_bytes: float = 8e6) -> Packed | None:
    """The fields of a result for a page; None if no step has any.

    title : of the pipeline
    keep : keeps pieces from one page to the next
    budget_bytes : of the blobs as base64
    """
    reading = read_result(result, keep)
    return None if reading is None else pack(reading, title, keep, budget_bytes)


def pack(reading: Reading, title: str, keep: Keep, budget_bytes: float) -> Packed:
    """What was read as a manifest and its blobs; as :func:`packed_result`."""
    budget = budget_bytes / _BASE64
    chosen = _selection(reading, (1 - _PHOTOGRAPHS) * budget, keep)
    photographs = _photographs(reading, chosen, _PHOTOGRAPHS * budget, keep)
    rest = budget - sum(len(one) for found in photographs.pictures.values() for one in found.values())
    chosen = _selection(reading, rest, keep, chosen.steps)
    blobs: dict[str, bytes] = {}
    return Packed(_manifest(reading, title, chosen, photographs, blobs, keep), blobs)


def _selection(reading: Reading, budget_bytes: float, keep: Keep, steps: Sequence[str] | None = None) -> Selection:
    """What fits of some steps, or of all; the main step stands for them."""
    measured = list(reading.surveys) if steps is None else steps
    everything = Selection(reading.importance, 1, measured)
    main = step_blobs(reading.source, reading.main[1], reading.scales, everything, keep)
    return select(main, reading.importance, measured, budget_bytes)


def _photographs(reading: Reading, chosen: Selection, budget_bytes: float, keep: Keep) -> Photographs:
    stage = reading.source.photographs
    if stage is None:
        return Photographs({}, {})
    names = reading.result.steps(stage)
    first = names[:1] if reading.first is not None else ()
    steps = list(dict.fromkeys([*first, *(step for step in chosen.steps if step in names)]))
    boxes = {side: _box(scales) for side, scales in reading.scales.places.items() if side != "space"}
    return Series(reading.result, stage, steps, keep).fitting(boxes, budget_bytes)


def _box(scales: Sequence[LinearScale]) -> Box:
    """The part of a photograph in which all places lie."""
    (x0, x1), (y0, y1) = ((one.low, one.low + one.quantum * (LINEAR_CODES - 1)) for one in scales)
    return Box(x0, y0, x1, y1)


def _manifest(
    reading: Reading,
    title: str,
    chosen: Selection,
    photographs: Photographs,
    blobs: dict[str, bytes],
    keep: Keep,
) -> Manifest:
    """The manifest. blobs : takes what it names"""

    def name(blob: bytes) -> str:
        found = blob_name(blob)
        blobs[found] = blob
        return found

    source, (quantity, step) = reading.source, reading.main
    shown = list(reading.steps) if len(chosen.steps) == len(reading.surveys) else list(chosen.steps)
    made = {one: step_blobs(source, one, reading.scales, chosen, keep) for one in chosen.steps}
    steps = [step_entry(reading, one, chosen.stride, made.get(one, {}), photographs, name) for one in shown]
    quantities = [quantity_entry(reading, one, steps) for one in reading.quantities if one.name in chosen.quantities]
    return Manifest(
        title=title,
        stage=source.stage,
        form=source.form,
        unit=source.unit,
        follows=source.follows,
        directions=source.directions,
        main=(quantity, shown.index(step) if step in shown else len(shown) - 1),
        steps=steps,
        first=first_entry(reading, chosen, photographs, name, keep),
        quantities=quantities,
        reasons=reasons(),
        places={place: [(one.low, one.quantum) for one in found] for place, found in reading.scales.places.items()},
        crops={side: crop_entry(crop) for side, crop in photographs.crops.items()},
        cameras=camera_facts(reading.result, source, step, keep),
        palettes=_palettes(quantities, keep),
        curves=probe_curves(reading.result, quantity, keep),
        load=loads(reading.result, [entry["number"] for entry in steps]),
        left_out=left_out(reading, chosen, photographs),
    )


def _palettes(quantities: Sequence[QuantityEntry], keep: Keep) -> dict[str, str]:
    """The colour maps of the quantities, and a few more to choose from."""
    names = dict.fromkeys([*(one["colours"] for one in quantities), *_PALETTES])
    return {name: keep(["palette", name], lambda: palette(name, 256).tobytes()).hex() for name in names}  # noqa: B023
