"""A result for a page with a server behind it: the steps and photographs are packed when they are asked for."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cached_property

from dicflow.errors import InputError
from dicflow.explorer.content import Keep, Selection, first_blob, key_of, step_blobs
from dicflow.explorer.described import manifest_of
from dicflow.explorer.entries import Contents
from dicflow.explorer.manifest import Manifest
from dicflow.explorer.photographs import Series, boxes_of
from dicflow.explorer.reading import Reading
from dicflow.explorer.survey import StepSurvey
from dicflow.views.crops import Crop

__all__ = ["OnDemand"]

_FIRST = "first"
_SIDES = ("left", "right")


class OnDemand:
    """What was read of a result, and the blobs and photographs that its manifest names.

    A blob is named STEP_KEY by numbers, the places at the first step "first"; a photograph STEP_SIDE or first_SIDE.
    """

    def __init__(self, reading: Reading, title: str, keep: Keep) -> None:
        """keep : of the parts of the manifest; blobs and photographs are kept by those who ask for them"""
        self._reading, self._title, self._keep = reading, title, keep
        self.source = reading.source
        self._steps = list(reading.steps)
        self._selection = Selection([facts["name"] for facts in reading.quantities], 1, self._steps)

    @cached_property
    def key(self) -> str:
        """Digest of all that blobs and photographs are made of but the code."""
        reading, source = self._reading, self._reading.source
        sources = [source.sources(step) for step in reading.surveys]
        facts = [self._steps, reading.scales, self._crops, self._photographed, sources, source.first_sources()]
        return hashlib.sha256(json.dumps(facts).encode()).hexdigest()[:32]

    @cached_property
    def measured(self) -> int:
        """Number of steps that have fields, also of those that are not shown."""
        return sum(map(self._reading.source.has, self._reading.source.steps))

    def manifest(self) -> Manifest:
        """What the page reads first."""
        reading = self._reading
        first = None if reading.first is None or "left" not in reading.scales.places else _FIRST
        shown = Contents(
            steps=self._steps,
            quantities=self._selection.quantities,
            stride=1,
            fields={step: self._names(step) for step in reading.surveys},
            first=first,
            photographs=self._photographs(),
            crops=self._crops,
            left_out=self._left_out(),
        )
        return manifest_of(reading, self._title, shown, self._keep)

    def made(self, name: str) -> Mapping[str, bytes]:
        """A blob or photograph by its name, with all others that were made along with it.

        Raises InputError for a name that the manifest does not have, or a photograph that cannot be read.
        """
        head, _, tail = name.partition("_")
        found = self._made_photographs(head) if tail in _SIDES else self._made_blobs(head)
        if name not in found:
            raise InputError(name[:40], "is not there", "its photograph may have been moved; read the result again")
        return found

    def curve(self, quantity: str, index: int) -> dict[str, list[float | None]]:
        """Readings of a point at all steps that are shown, ``values`` and ``errors``; None if unknown.

        index : of the point in the grid, row by row
        Raises InputError for a quantity or a point that is not there.
        """
        source = self._reading.source
        if quantity not in self._reading.scales.values or index < 0:
            raise InputError(quantity[:40], "is not there", "read the result again")
        there = [
            source.at_point(s, quantity, index) if s in self._reading.surveys else (math.nan,) * 2 for s in self._steps
        ]
        values, errors = zip(*there, strict=True)
        return {"values": [_known_number(one) for one in values], "errors": [_known_number(one) for one in errors]}

    @cached_property
    def _keys(self) -> list[str]:
        """Keys of the blobs that a step may have."""
        scales = self._reading.scales
        tables: dict[str, Iterable[str]] = {"value": scales.values, **scales.errors, "place": scales.places}
        return ["status", *(key_of(part, name) for part, table in tables.items() for name in table)]

    def _names(self, step: str) -> dict[str, str]:
        """Key → name of the blobs that a step has."""
        known = _known(self._reading.surveys[step])
        number = self._steps.index(step)
        return {key: f"{number}_{k}" for k, key in enumerate(self._keys) if key in known}

    def _made_blobs(self, head: str) -> dict[str, bytes]:
        reading = self._reading
        if head == _FIRST:
            blob = first_blob(reading.source, reading.scales, 1, _made)
            return {} if blob is None else {_FIRST: blob}
        step = self._step(head)
        if step not in reading.surveys:
            return {}
        blobs = step_blobs(reading.source, step, reading.scales, self._selection, _made)
        return {name: blobs[key] for key, name in self._names(step).items()}

    def _step(self, head: str) -> str:
        if not head.isdecimal() or int(head) >= len(self._steps):
            raise InputError(head[:40], "is no step of this result", "read the result again")
        return self._steps[int(head)]

    @cached_property
    def _series(self) -> Series | None:
        """Photographs from the first to the last step that has fields; None where they are unknown."""
        reading, stage = self._reading, self._reading.source.photographs
        if stage is None:
            return None
        last = [step for step in reading.surveys if step in reading.result.steps(stage)][-1:]
        return Series(reading.result, stage, last, _made)

    @cached_property
    def _crops(self) -> Mapping[str, Crop]:
        """Parts of the photographs; empty where the last step has none."""
        return {} if self._series is None else self._series.crops(boxes_of(self._reading.scales))

    @cached_property
    def _photographed(self) -> bool:
        """Whether the last photographs can be read."""
        return self._series is not None and bool(self._crops) and self._series.can_be_read

    def _pictures(self, step: str) -> Mapping[str, bytes]:
        return {} if self._series is None else self._series.pictures(step, self._crops)

    def _photographs(self) -> dict[str, dict[str, str]]:
        """Step → side → name."""
        stage = self._reading.source.photographs
        if stage is None or not self._photographed:
            return {}
        names = self._reading.result.steps(stage)
        heads = {names[0]: _FIRST, **{step: str(k) for k, step in enumerate(self._steps) if step in names}}
        return {step: {side: f"{head}_{side}" for side in self._crops} for step, head in heads.items()}

    def _made_photographs(self, head: str) -> dict[str, bytes]:
        stage = self._reading.source.photographs
        if stage is None:
            return {}
        step = self._reading.result.steps(stage)[0] if head == _FIRST else self._step(head)
        return {f"{head}_{side}": picture for side, picture in self._pictures(step).items()}

    def _left_out(self) -> list[str]:
        sentences = []
        if len(self._reading.surveys) < self.measured:
            sentences.append(f"{len(self._reading.surveys)} of {self.measured} steps are shown")
        if self._reading.source.photographs is not None and not self._photographed:
            sentences.append("photographs are missing: they are neither in the store nor in their folder")
        return sentences


def _made(_sources: Sequence[str], make: Callable[[], bytes]) -> bytes:
    return make()


def _known_number(value: float) -> float | None:
    return value if math.isfinite(value) else None


def _known(one: StepSurvey) -> set[str]:
    """Keys of the blobs with any number in them."""
    parts: dict[str, Iterable[str]] = {"value": one["values"], **one["errors"], "place": one["places"]}
    return {"status", *(key_of(part, name) for part, found in parts.items() for name in found)}
