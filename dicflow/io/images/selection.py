"""Which steps of a series are measured."""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise
from pathlib import Path
from typing import NamedTuple

from dicflow.discovery import nearest
from dicflow.engine.files import FilePart
from dicflow.errors import InputError
from dicflow.io.images.surveys import survey_of
from dicflow.io.text import printable

__all__ = ["Place", "Selection", "selected"]

Place = int | float
"""A step by its number from 1, or a time since the first step [s]."""
File = Path | FilePart
Steps = Mapping[str, Mapping[str, File]]


class Selection(NamedTuple):
    """Which steps are measured; each condition holds among the steps that those before it leave.

    at : these alone
    first, last : none before, none after
    without : not these, by name or number
    every : the first of so many
    moved : a step whenever a part of the picture has moved by so many pixels since the step chosen before
    sharpest : as many steps at most, sharp and as different from one another as possible
    """

    at: Sequence[Place] = ()
    first: Place | None = None
    last: Place | None = None
    without: Sequence[str | int] = ()
    every: int = 1
    moved: float | None = None
    sharpest: int | None = None


def selected(
    steps: Steps, selection: Selection, time: Callable[[File], float | None], reference: Place | None = None
) -> dict[str, Mapping[str, File]]:
    """The steps that are measured.

    time : of a photograph [s]
    reference : the step that comes first; the others follow in their order
    Raises InputError where a step does not exist, or times are asked for that nobody knows.
    """
    series = _Series(steps, time)
    left_out = {series.named(one) if isinstance(one, str) else series.index(one) for one in selection.without}
    chosen = [k for k in _at(series, selection) if k not in left_out][:: selection.every]
    if selection.moved is not None:
        chosen = [chosen[k] for k in _moved(series.left(chosen), selection.moved)]
    if selection.sharpest is not None:
        chosen = [chosen[k] for k in _sharpest(series.left(chosen), selection.sharpest)]
    if reference is not None:
        first = series.index(reference)
        chosen = [first, *(k for k in chosen if k != first)]
    return {series.names[k]: steps[series.names[k]] for k in chosen}


def _at(series: _Series, selection: Selection) -> list[int]:
    if selection.at:
        return sorted({series.index(place) for place in selection.at})
    first = 0 if selection.first is None else series.index(selection.first)
    last = len(series.names) - 1 if selection.last is None else series.index(selection.last)
    if first > last:
        raise InputError(f"select: no step lies from {selection.first} to {selection.last}; exchange them")
    return list(range(first, last + 1))


def _moved(photographs: list[File], least: float) -> list[int]:
    from dicflow.core.motion.choice import moved_steps

    return moved_steps(survey_of(photographs).cells, least)


def _sharpest(photographs: list[File], count: int) -> list[int]:
    import numpy as np

    from dicflow.core.motion.choice import most_different

    found = survey_of(photographs)
    speed = np.hypot(*np.moveaxis(np.gradient(found.cells, axis=0), -1, 0)).mean(axis=1) if len(photographs) > 1 else 0
    motion = np.broadcast_to(speed, len(photographs))
    return most_different(found.thumbs, found.sharpness, motion, count)


class _Series:
    """Steps by number and by time."""

    def __init__(self, steps: Steps, time: Callable[[File], float | None]) -> None:
        self.names = list(steps)
        self._files = [files["left"] for files in steps.values()]
        self._time = time

    def left(self, chosen: Sequence[int]) -> list[File]:
        """The left photographs of some steps."""
        return [self._files[k] for k in chosen]

    def named(self, name: str) -> int:
        """Index of the step of this name."""
        if name not in self.names:
            raise InputError(f"select: no step '{printable(name)}'{nearest(name, self.names)}")
        return self.names.index(name)

    def index(self, place: Place) -> int:
        """Index of the step of this number, or of the one that is nearest in time."""
        if isinstance(place, int):
            if not 1 <= place <= len(self.names):
                raise InputError(f"select: step {place} does not exist; the series has steps 1 to {len(self.names)}")
            return place - 1
        times = self._times()
        if not -0.5 <= place <= times[-1] + 0.5:
            raise InputError(f"select: {place:g} s lies outside the series, which takes {times[-1]:.2f} s")
        after = min(bisect_left(times, place), len(times) - 1)
        return min((max(after - 1, 0), after), key=lambda k: abs(times[k] - place))

    def _times(self) -> list[float]:
        """Times of all steps since the first [s]."""
        times = [self._time(file) for file in self._files]
        for file, one in zip(self._files, times, strict=True):
            if one is None:
                raise InputError(
                    f"select: nobody knows when {file} was taken; select by number (10 rather than 10 s), or give a "
                    "table of times"
                )
        known = [one for one in times if one is not None]
        if any(b < a for a, b in pairwise(known)):
            raise InputError("select: the photographs are not in the order of their times; select by number")
        return [one - known[0] for one in known]
