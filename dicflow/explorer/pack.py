"""A result as a manifest and its blobs."""

from __future__ import annotations

import inspect
import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.core.status import Status
from dicflow.errors import DicflowError
from dicflow.explorer.cameras import camera_facts
from dicflow.explorer.content import Keep, Selection, first_blob, select, spread, step_blobs
from dicflow.explorer.curves import loads, probe_curves
from dicflow.explorer.fields import FieldSource, QuantityFacts, field_source
from dicflow.explorer.manifest import Crop, FirstFacts, Manifest, QuantityEntry, Reason, StepEntry
from dicflow.explorer.packing import blob_name
from dicflow.explorer.photographs import Photographs
from dicflow.explorer.survey import Scales, StepSurvey, scales_of, survey, valid_share
from dicflow.kinds.maps import joined_range
from dicflow.kinds.quantities import REPORTED
from dicflow.pipeline.result import Result
from dicflow.views.colours import REASON_COLOURS, look, palette
from dicflow.views.figures import maps_of

__all__ = ["Packed", "packed_result"]

PALETTES = ("viridis", "RdBu_r", "cividis", "magma", "turbo", "Greys_r")
_PHOTOGRAPHS = 0.3
"""Share of the budget for photographs."""
_BASE64 = 4 / 3
_MOST_STEPS = 400


class Packed(NamedTuple):
    """A manifest, and name → blob of all that it names."""

    manifest: Manifest
    blobs: Mapping[str, bytes]


class _Read(NamedTuple):
    """What is known before anything is packed."""

    result: Result
    source: FieldSource
    steps: Sequence[str]
    surveys: Mapping[str, StepSurvey]
    scales: Scales
    first: NDArray[Any] | None
    quantities: Sequence[QuantityFacts]

    @property
    def measured(self) -> list[str]:
        """Steps that have fields."""
        return [step for step in self.steps if step in self.surveys]


def packed_result(result: Result, title: str, keep: Keep, budget_bytes: float = 7e6) -> Packed | None:
    """The fields of a result for a page; None if no step has any.

    keep : keeps pieces from one page to the next
    budget_bytes : of the blobs as base64
    """
    source = field_source(result)
    if source is None:
        return None
    read = _read(result, source, keep)
    main = _main(read)
    importance = _importance(read, main[0])
    allowed = (1 - _PHOTOGRAPHS) * budget_bytes / _BASE64
    everything = Selection(importance, 1, read.measured)
    chosen = select(step_blobs(source, main[1], read.scales, everything, keep), importance, read.measured, allowed)
    photographs = _photographs(read, chosen, _PHOTOGRAPHS * budget_bytes / _BASE64, keep)
    blobs: dict[str, bytes] = {}

    def name(blob: bytes) -> str:
        return blobs.setdefault(blob_name(blob), blob) and blob_name(blob)

    kept = {step: step_blobs(source, step, read.scales, chosen, keep) for step in chosen.steps}
    steps = [_step(read, step, chosen.stride, {key: name(blob) for key, blob in kept.get(step, {}).items()}) for step in _listed(read, chosen)]
    for entry in steps:
        entry["photos"] = {side: name(found[entry["name"]]) for side, found in photographs.pictures.items() if entry["name"] in found}
    manifest = Manifest(
        title=title,
        stage=source.stage,
        form="shape" if type(source).__name__ == "ShapeFields" else "deformation",
        unit=source.unit,
        follows=source.follows,
        main=(main[0], max(0, next((k for k, entry in enumerate(steps) if entry["name"] == main[1]), 0))),
        steps=steps,
        first=_first(read, chosen, photographs, name),
        quantities=[_quantity(read, facts, steps) for facts in read.quantities if facts.name in chosen.quantities],
        reasons=_reasons(),
        places={place: [tuple(scale) for scale in found] for place, found in read.scales.places.items()},
        crops={side: _crop(crop) for side, crop in photographs.crops.items()},
        cameras=camera_facts(result, source, main[1]),
        palettes={},
        curves=[dict(curve) for curve in probe_curves(result, main[0])],
        load=loads(result, [entry["number"] for entry in steps]),
        left_out=_left_out(read, chosen, photographs),
    )
    used = dict.fromkeys([*(entry["colours"] for entry in manifest["quantities"]), *PALETTES])
    manifest["palettes"] = {table: palette(table, 256).tobytes().hex() for table in used}
    return Packed(manifest, blobs)


def _read(result: Result, source: FieldSource, keep: Keep) -> _Read:
    """One reading of all steps, or of as many as a page can hold."""
    first = source.at_first()
    inside = None if first is None else np.isfinite(first).all(axis=-1)
    steps = spread(source.steps, _MOST_STEPS)
    surveys: dict[str, StepSurvey] = {}
    for step in steps:
        if source.has(step):
            made = keep(["survey", *source.sources(step)], lambda: json.dumps(survey(source.read(step), inside)).encode())  # noqa: B023
            surveys[step] = json.loads(made)
    return _Read(result, source, steps, surveys, scales_of([*surveys.values()], first), first, source.quantities())


def _main(read: _Read) -> tuple[str, str]:
    """The quantity and the step to show first: the normal strain, or else the displacement, of largest mean."""
    for group in (("exx", "eyy"), ("U", "V", "W")):
        means = {(name, step): abs(one["means"][name][0]) for step, one in read.surveys.items() for name in group if name in one["means"]}
        if means:
            return max(means, key=lambda pair: means[pair])
    return read.quantities[0].name, read.measured[-1]


def _importance(read: _Read, main: str) -> list[str]:
    """The main quantity, those of the maps, those of reports, then all others."""
    known = [facts.name for facts in read.quantities if facts.name in read.scales.values]
    maps = maps_of(read.result, read.source.stage)
    order = [main, *(maps.quantities if maps is not None else ()), *REPORTED, *known]
    return [name for name in dict.fromkeys(order) if name in known]


def _photographs(read: _Read, chosen: Selection, budget_bytes: float, keep: Keep) -> Photographs:
    stage = read.source.photographs
    if stage is None:
        return Photographs({}, {})
    names = list(read.result.steps(stage))
    steps = list(dict.fromkeys([*(names[:1] if read.first is not None else ()), *(step for step in chosen.steps if step in names)]))
    boxes = {side: _box(scales) for side, scales in read.scales.places.items() if side != "space"}
    return Photographs.read(read.result, stage, steps, boxes, budget_bytes, keep)


def _box(scales: Sequence[Any]) -> list[float]:
    """x0, y0, x1, y1 of all places."""
    return [scale.low for scale in scales] + [scale.low + scale.quantum * 65534 for scale in scales]


def _listed(read: _Read, chosen: Selection) -> list[str]:
    """The chosen steps, and those that were not measured where none is left out."""
    return list(read.steps) if len(chosen.steps) == len(read.measured) else list(chosen.steps)


def _step(read: _Read, step: str, stride: int, blobs: dict[str, str]) -> StepEntry:
    one = read.surveys.get(step)
    rows, cols = (0, 0) if one is None else one["shape"]
    return StepEntry(
        name=step,
        number=read.result.number(read.source.stage, step),
        shape=(-(-rows // stride), -(-cols // stride)),
        blobs=blobs,
        photos={},
        counts={} if one is None else one["counts"],
        valid=None if one is None else valid_share(one),
    )


def _first(read: _Read, chosen: Selection, photographs: Photographs, name: Any) -> FirstFacts | None:
    if read.first is None or read.source.photographs is None:
        return None
    step = read.result.steps(read.source.photographs)[0]
    blob = first_blob(read.source, read.scales, chosen.stride)
    rows, cols = (-(-side // chosen.stride) for side in read.first.shape[:2])
    photos = {side: name(found[step]) for side, found in photographs.pictures.items() if step in found}
    return FirstFacts(name=step, place=None if blob is None else name(blob), shape=(rows, cols), photos=photos)


def _quantity(read: _Read, facts: QuantityFacts, steps: Sequence[StepEntry]) -> QuantityEntry:
    scales, name = read.scales, facts.name
    low, high, table = _look(read, facts)
    found = [read.surveys.get(entry["name"]) for entry in steps]
    return QuantityEntry(
        **facts._asdict(),
        scale=tuple(scales.values[name]),
        sigma=tuple(scales.sigmas[name]) if name in scales.sigmas else None,
        share=tuple(scales.shares[name]) if name in scales.shares else None,
        range=(low, high),
        colours=table,
        means=[None if one is None else one["means"].get(name) for one in found],
    )


def _look(read: _Read, facts: QuantityFacts) -> tuple[float, float, str]:
    """Ends of the colours and their table: those of the maps where they draw the quantity."""
    maps = maps_of(read.result, read.source.stage)
    mapped = {} if maps is None else maps.quantities
    low, high = joined_range(one["colours"].get(facts.name) for one in read.surveys.values())
    choice = "auto"
    if facts.name in mapped and maps is not None:
        (low, high), choice = mapped[facts.name].range, maps.colour_map
    found = look(facts.name, facts.title, facts.unit, low, high, choice)
    return (*found.range, found.table)


def _reasons() -> list[Reason]:
    """Each status with the sentence that defines it, from its documentation."""
    sentences = _status_sentences()
    return [Reason(code=int(code), label=code.label, sentence=sentences[code.name], colour=REASON_COLOURS.get(code, "")) for code in Status]


def _status_sentences() -> dict[str, str]:
    """Name → the sentence below each member of the table of status codes."""
    lines = [line.strip() for line in inspect.getsource(Status).splitlines()]
    pairs = zip(lines, lines[1:], strict=False)
    return {one.split(" = ")[0]: after.strip('"') for one, after in pairs if " = " in one and after.startswith('"""')}


def _crop(crop: Any) -> Crop:
    width, height = crop.size
    return Crop(origin=crop.origin, size=(width / crop.scale, height / crop.scale))


def _left_out(read: _Read, chosen: Selection, photographs: Photographs) -> list[str]:
    """What a page had to leave out, in sentences."""
    dropped = [facts.symbol for facts in read.quantities if facts.name in read.scales.values and facts.name not in chosen.quantities]
    sentences = []
    if dropped:
        sentences.append(f"left out to keep this file small: {', '.join(dropped)}")
    if chosen.stride > 1:
        sentences.append("every second point of every second row is shown, to keep this file small")
    if len(chosen.steps) < len(read.source.steps) and len(chosen.steps) < sum(map(read.source.has, read.source.steps)):
        sentences.append(f"{len(chosen.steps)} of {len(read.source.steps)} steps are shown, to keep this file small")
    if read.source.photographs is not None and not photographs.pictures:
        sentences.append("photographs are not shown: the store does not keep them, or they are too many for one file")
    return sentences
