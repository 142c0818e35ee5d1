"""Results for the explorer of the page: read, and packed step by step, in a process of its own.

What is made is kept in a folder under a key that follows from the products, so that it is read from there afterwards.
"""

from __future__ import annotations

import hashlib
import re
import time
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from dicflow.app.kept import keep_newest
from dicflow.app.project import Project
from dicflow.errors import InputError
from dicflow.explorer.content import Keep, spread
from dicflow.explorer.differences import DifferenceFields, obstacle
from dicflow.explorer.fields import FieldSource, field_source
from dicflow.explorer.on_demand import OnDemand
from dicflow.explorer.reading import read_source, surveyed
from dicflow.io.files import write_whole
from dicflow.pipeline import Pipeline, Result
from dicflow.report.pieces import Pieces
from dicflow.views.colours import palette
from dicflow.views.source_digest import source_digest

__all__ = ["Asked", "Side", "curve", "is_photograph", "make", "opened", "place_of", "prepare", "survey"]

_KEPT = 3
"""Results that stay open, as two are seen side by side, and their difference."""
_KEPT_ON_DISK = 8
"""Results whose blobs and photographs are kept."""
_MOMENT_S = 0.06
"""Time for which steps are looked at before other questions are answered."""
_NAME = re.compile(r"[0-9a-f]{32}/(first|[0-9]{1,6}_[0-9]{1,3}|(first|[0-9]{1,6})_(left|right))")
_LAYERS = ("core", "explorer", "kinds", "views")


class Side(NamedTuple):
    """A result by the names that a page gives.

    file : a pipeline file; variant : of its sweep
    run : id of an earlier run in its store, of any pipeline; "" for what the settings of the file give now
    """

    file: str
    variant: int = 0
    run: str = ""


class Asked(NamedTuple):
    """Which fields are asked for.

    minus : what is subtracted, point by point; None for nothing
    most_steps : that are shown, evenly from the first to the last
    """

    side: Side
    minus: Side | None
    most_steps: int


def place_of(project: Project, name: str) -> Path:
    """Where a blob or photograph is kept. Raises InputError for any other name."""
    if not _NAME.fullmatch(name):
        raise InputError(name[:80], "is no part of a result", "reload the page")
    return project.own_folder / "fields" / name


def is_photograph(name: str) -> bool:
    """Whether a name is that of a photograph, rather than of a blob."""
    return name.endswith(("_left", "_right"))


def prepare() -> None:
    """Load what the first result needs beside this module: the colour maps of matplotlib."""
    palette("turbo", 2)


def opened(project: Project, asked: Asked, is_more: bool = False) -> dict[str, Any]:
    """A result for the page: the newest products of the settings, also while a run makes them, or those of a run.

    is_more : more steps of what was opened last; newer products are not looked for
    ``view``: key of what its manifest names, ``manifest``: None if there are no fields; ``variants``: values of each;
    ``steps``: how many steps have fields; ``notes``: sentences on where the products come from; ``problem``: why two
    results have no difference.
    """
    result, title = _result(project, asked.side, is_more)
    variants = [{name: str(value) for name, value in one.items()} for one in result.values]
    found: dict[str, Any] = {"view": "", "manifest": None, "variants": variants, "steps": 0, "notes": [*result.notes]}
    result = result.variant(asked.side.variant)
    source = field_source(result)
    if source is not None and asked.minus is not None:
        source, found["problem"] = _difference(project, source, asked.minus, is_more)
    view = None if source is None else _view(project, result, source, title, asked.most_steps)
    if view is None:
        return found
    key = hashlib.sha256(f"{_code()} {view.key}".encode()).hexdigest()[:32]
    _keep_last(_views, key, view)
    folder = project.own_folder / "fields" / key
    folder.mkdir(parents=True, exist_ok=True)
    keep_newest(folder, _KEPT_ON_DISK)
    return {**found, "view": key, "manifest": view.manifest(), "steps": view.measured}


def _result(project: Project, side: Side, is_known: bool) -> tuple[Result, str]:
    """All variants of a result, and the title of its pipeline. is_known : as they were found last"""
    if not is_known or side not in _results:
        _keep_last(_results, side, _found(project, side))
    return _results[side]


def _found(project: Project, side: Side) -> tuple[Result, str]:
    pipeline = Pipeline.load(project.path(side.file), data=project.data, store=project.store)  # with new photographs
    if side.run:
        return pipeline.past_result(side.run), pipeline.title
    return pipeline.result(), pipeline.title


def _difference(project: Project, source: FieldSource, minus: Side, is_known: bool) -> tuple[FieldSource | None, str]:
    """Fields minus those of another result; None and the reason where they have no difference."""
    other = field_source(_result(project, minus, is_known)[0].variant(minus.variant))
    if other is None:
        return None, "One of them has no fields."
    problem = obstacle(source, other)
    return None if problem else DifferenceFields(source, other), problem


_results: dict[Side, tuple[Result, str]] = {}
_views: dict[str, OnDemand] = {}
"""Results that are open in this process by key, the last used one last."""


def _keep_last(kept: dict[Any, Any], key: Any, value: Any) -> None:
    """Put a value at the end, and drop those before it that are too many."""
    kept.pop(key, None)
    kept[key] = value
    while len(kept) > _KEPT:
        del kept[next(iter(kept))]


def _view(project: Project, result: Result, source: FieldSource, title: str, most_steps: int) -> OnDemand | None:
    reading = read_source(result, source, _pieces(project), most_steps)
    return None if reading is None else OnDemand(reading, title, _pieces(project))


def make(project: Project, asked: Asked, name: str) -> None:
    """Make a blob or a photograph, and all that is made along with it. Raises InputError if the result has changed."""
    place = place_of(project, name)
    if place.is_file():
        return
    for one, content in _open(project, asked, place.parent.name).made(place.name).items():
        write_whole(place.parent / one, content)


def curve(project: Project, asked: Asked, key: str, quantity: str, index: int) -> dict[str, Any]:
    """Readings of a point of an open result, as :meth:`OnDemand.curve` gives them. Raises InputError as it does."""
    return _open(project, asked, key).curve(quantity, index)


def survey(project: Project, asked: Asked, key: str, most_steps: int, start: int) -> dict[str, int]:
    """Look at steps of an open result for a moment, so that it can soon be opened with more of them.

    start : number of the step to begin with, among those that are then shown
    Returns the ``next`` one, and how many there are.
    """
    source, keep = _open(project, asked, key).source, _pieces(project)
    steps = spread(source.steps, most_steps)
    end = time.monotonic() + _MOMENT_S
    while start < len(steps) and time.monotonic() < end:
        if source.has(steps[start]):
            surveyed(source, steps[start], keep)
        start += 1
    return {"next": start, "count": len(steps)}


def _pieces(project: Project) -> Keep:
    return Pieces(project.own_folder / "fields" / "surveys", _code()).get


def _open(project: Project, asked: Asked, key: str) -> OnDemand:
    """A result by its key, opened again where it was closed. Raises InputError if it has changed."""
    if key not in _views:
        opened(project, asked)
    if key not in _views:
        raise InputError(asked.side.file, "has other results by now", "open the screen again")
    return _views[key]


@cache
def _code() -> str:
    return source_digest(*_LAYERS)
