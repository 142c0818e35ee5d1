"""Products, and whole tests, as files in a chosen format."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

from dicflow.discovery import nearest
from dicflow.errors import ConfigurationError
from dicflow.io.exports import FORMATS, beside, has_one_step, kinds_of
from dicflow.io.exports.items import Item
from dicflow.io.files import staged
from dicflow.io.table import TableStyle
from dicflow.kinds.total import Total
from dicflow.pipeline.places import Places
from dicflow.pipeline.result import Result
from dicflow.views.exported_pictures import PICTURES, Drawn, check_quantities
from dicflow.views.workbooks import Steps, megabytes, of_one_step, shown_steps

__all__ = ["export", "format_names"]

_MOST_ROWS = 1_048_576
"""Rows of a table that spreadsheets open."""
_LARGE_MB = 30.0
"""Size of a workbook from which it is named before it is written."""


def format_names() -> tuple[str, ...]:
    """All formats: of numbers, then of pictures and movies."""
    return (*FORMATS.names(), *PICTURES)


class Selection(NamedTuple):
    """What is exported.

    stage, step : names. Without a stage the whole test: every total, and for formats of numbers the tables, the region
        and the rig beside them; without a step every step that is in the store
    quantities : names of arrays; without any all of them, and of a whole test's pictures those of its maps
    variant : number of the sweep's variant
    style : of the numbers in tables
    """

    stage: str | None = None
    step: str | None = None
    quantities: tuple[str, ...] = ()
    variant: int = 0
    style: TableStyle = TableStyle()


def export(
    result: Result,
    output: Path,
    selection: Selection = Selection(),  # noqa: B008  never changed
    *,
    to: str = "csv",
    force: bool = False,
    name: str = "test",
    note: Callable[[str], None] = lambda text: None,
) -> list[Path]:
    """Write products into a folder, all of them or none, and return the paths.

    to : one of :func:`format_names`
    force : overwrite files that exist
    name : of a file that holds a whole test
    note : receives a sentence on what is left out
    Raises ConfigurationError for a name or a format that does not exist, and for a file that does.
    """
    stage, step, quantities, variant, style = selection
    _check_format(to)
    chosen = tuple(dict.fromkeys(quantities))
    with staged(output, force) as folder:
        for job in _jobs(result, stage, to, variant, note):
            one_step = stage is None and has_one_step(job.form)
            steps = {name: _steps(result, name, None if one_step else step, variant, note) for name in job.stages}
            selected = chosen if job.main else ()
            for which, there in steps.items() if not one_step else ():
                _note_surprises(result, which, there, job.form, variant, note)
            if job.form in PICTURES:
                PICTURES[job.form].write(Drawn(result, steps, selected, variant), job.form, folder, stage is None)
            else:
                items = (item for name in job.stages for item in _items(result, name, steps[name], selected, variant))
                if one_step:
                    shown = shown_steps(result, steps, step, variant)
                    _note_one_step(result, steps, shown, variant, note)
                    items = (of_one_step(item, shown) for item in items)
                styled = (item._replace(style=style) for item in items)
                FORMATS.load(job.form).write(styled, folder, name if stage is None else stage)
        files = sorted(path.name for path in folder.iterdir())
    return [output / file for file in files]


def _check_format(name: str) -> None:
    """Raise ConfigurationError for an unknown format, and for a plug-in with the name of a format of pictures."""
    names = format_names()
    if name not in names:
        raise ConfigurationError(f"no format '{name}'{nearest(name, names)}; there are {', '.join(names)}")
    if name in PICTURES and name in FORMATS.names():
        raise ConfigurationError(
            f"two export formats have the name '{name}': dicflow's own and {FORMATS.find(name).place}; "
            "uninstall or rename one"
        )


class _Job(NamedTuple):
    """Stages that are written in one format; not ``main``: beside what was asked for."""

    stages: list[str]
    form: str
    main: bool = True


def _jobs(result: Result, stage: str | None, to: str, variant: int, note: Callable[[str], None]) -> Iterator[_Job]:
    """The files to write. Raises ConfigurationError if a stage does not fit the format."""
    kinds = PICTURES[to].kinds if to in PICTURES else kinds_of(to)
    if stage is not None:
        if kinds and result.kind(stage) not in kinds:
            raise ConfigurationError(
                f"{stage}: a product of kind {result.kind(stage)} is no {' or '.join(kinds)}, which {to} is for; "
                "choose another format or stage"
            )
        yield _Job([stage], to)
        return
    kinds = kinds or ("total",)
    stages = _stages(result, kinds)
    if not stages:
        raise ConfigurationError(
            f"no stage gives a product of kind {', '.join(kinds)}; stages: {', '.join(result.stages)}"
        )
    whole = to not in PICTURES and "total" in kinds
    yield _Job([name for name in stages if not whole or _is_there(result, name, variant, note)], to)
    if whole:
        yield from _jobs_beside(result, kinds, variant, note)


def _jobs_beside(result: Result, held: Sequence[str], variant: int, note: Callable[[str], None]) -> Iterator[_Job]:
    """What the export of a whole test adds to its totals. held : kinds that the format itself holds"""
    for form, kinds in beside().items():
        try:
            FORMATS.load(form)
        except ConfigurationError as error:
            note(f"left out: {error}")
            continue
        others = _stages(result, [kind for kind in kinds if kind not in held])
        yield _Job([name for name in others if _is_there(result, name, variant, note)], form, main=False)


def _is_there(result: Result, stage: str, variant: int, note: Callable[[str], None]) -> bool:
    there = bool(result.steps(stage, variant)) or result.has(stage, None, variant)
    if not there:
        note(f"{stage} is not in the store and was left out")
    return there


def _stages(result: Result, kinds: Sequence[str]) -> list[str]:
    return [stage for kind in kinds for stage in result.stages_of(kind)]


def _steps(
    result: Result, stage: str, step: str | None, variant: int, note: Callable[[str], None]
) -> tuple[str | None, ...]:
    """The selected steps of a stage that the store holds; if it holds none of them, all."""
    known = result.steps(stage)
    if not known or step is not None:
        return (step,) if known else (None,)
    there = tuple(name for name in known if result.has(stage, name, variant))
    if there and len(there) < len(known):
        lost = [name for name in known if name not in there]
        note(f"{stage}: {len(lost)} of {len(known)} steps are not in the store and were left out: {', '.join(lost)}")
    return there or known


def _note_surprises(
    result: Result, stage: str, steps: Sequence[str | None], form: str, variant: int, note: Callable[[str], None]
) -> None:
    """Note surprising files: a movie of one step, tables too long for a spreadsheet, a large workbook."""
    if form in PICTURES and PICTURES[form].moves and len(steps) == 1:
        note(f"{stage}: the movie has only one step; the format png gives its picture")
    if has_one_step(form) and (size := megabytes(result, stage, steps, variant)) > _LARGE_MB:
        note(f"{stage}: about {size:.0f} MB for the points of {len(steps)} steps; --step writes those of one")
    if form == "csv" and (rows := _rows(result, stage, steps[0], variant)) > _MOST_ROWS:
        tables = "a table" if len(steps) == 1 else f"{len(steps)} tables"
        note(
            f"{stage}: {tables} of {rows:,} rows, more than a spreadsheet opens; "
            "the formats npz and hdf5 take far less room"
        )


def _note_one_step(
    result: Result, steps: Steps, shown: Mapping[str, str | None], variant: int, note: Callable[[str], None]
) -> None:
    """Note whose points a file has, and how to get the others."""
    for stage, names in steps.items():
        if len(names) > 1:
            size = megabytes(result, stage, names, variant)
            note(
                f"{stage}: the points of {shown[stage]} alone, of {len(names)} steps; --step chooses another one, and "
                f"naming the stage ({stage}) writes all, about {size:.0f} MB"
            )


def _rows(result: Result, stage: str, step: str | None, variant: int) -> int:
    """How many rows a table of a product has; one where it has no arrays."""
    first = next(iter(result.product(stage, step, variant).variables), None)
    return 1 if first is None else math.prod(result.arrays(stage, step, variant)[first].shape[:2])


def _items(
    result: Result, stage: str, steps: Sequence[str | None], quantities: tuple[str, ...], variant: int
) -> Iterator[Item]:
    """The products of a stage, one at a time."""
    for step in steps:
        product = result.product(stage, step, variant)
        check_quantities(stage, product, quantities)
        item = Item(stage, step, product, quantities)
        if product.kind == "total":
            total, places = Total.read(product), Places(result, variant)
            of_first = partial(places.of_first, total) if places.has_first(total) else None
            item = item._replace(places=of_first, number=result.number(stage, step, variant))
        elif product.kind == "region":
            item = item._replace(outline=Places(result, variant).as_taken)
        yield item
