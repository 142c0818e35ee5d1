"""Section: the variants of a sweep side by side."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

from markupsafe import Markup

from dicflow.io.results import table_text
from dicflow.kinds.kind import summary_of
from dicflow.kinds.quantities import QUANTITIES
from dicflow.pipeline import Result
from dicflow.report.context import Context, Section
from dicflow.report.rendering import render
from dicflow.report.resolution import Resolution, resolution_chart, resolutions
from dicflow.report.words import number
from dicflow.views.variant_names import variant_names

__all__ = ["PLACE", "TITLE", "sweep"]

PLACE = 5
TITLE = "Variants of the sweep"

_FIELDS = tuple(name for name, quantity in QUANTITIES.items() if "sweep" in quantity.uses)
_ON_PAPER = tuple(f"{part}_{name}" for part in ("mean", "sigma", "u") for name in ("exx", "eyy"))
"""Scalars of a total that a sheet of paper has room for."""
_MOST_OPEN = 9
"""Panels of means that are shown unasked where there are no fields; more are folded away."""
_ALIKE, _ALIKE_DRAWN = 1e-9, 1e-4
"""Relative spread up to which scalars count as equal; smaller differences than the second are not drawn."""


def sweep(context: Context) -> Section | None:
    """The section, None for a pipeline with one variant."""
    result = context.result
    if len(result.values) < 2:
        return None
    table = result.table()
    scalars = list(dict.fromkeys(key for row in table for key in row if key not in result.values[0]))
    differing = [name for name in scalars if not _alike([row.get(name) for row in table])]
    drawn = [name for name in differing if not _alike([row.get(name) for row in table], _ALIKE_DRAWN)]
    curves = _curves(result, drawn)
    found, fields = resolutions(result), _fields(context)
    labels = [f"#{place + 1}: {label}" for place, label in enumerate(variant_names(result.values))]
    body = render(
        "sweep.html",
        count=len(table),
        chart=Markup(chart) if (chart := resolution_chart(found, labels)) is not None else None,
        measured=any(one is not None and one.measured for one in found),
        columns=_columns(result, differing, found),
        off_paper=set(differing) - set(_on_paper(differing)),
        rows=_rows(result, table, differing, found),
        differs=bool(differing),
        equal=[[name, _shown(table[0].get(name))] for name in scalars if name not in differing],
        means=_means(context, table) if drawn else None,
        is_short=len(drawn) <= _MOST_OPEN and not fields,
        steps=_steps(context, *curves) if curves[0] else None,
        fields=fields,
    )
    empty = [place + 1 for place, row in enumerate(table) if len(row) == len(result.values[place])]
    warnings = tuple(
        f"Variant #{place} of the sweep has nothing in the store; run the pipeline again." for place in empty
    )
    return Section("sweep", TITLE, body, warnings)


def _on_paper(names: Sequence[str]) -> Sequence[str]:
    """Scalars that a sheet of paper shows: those of the strains, else the first ones."""
    of_strains = [name for name in names if name.partition(".")[2] in _ON_PAPER]
    return of_strains or names[: len(_ON_PAPER)]


class Cell(NamedTuple):
    """A cell of the table of variants. key : by which it is sorted, a number as text, or text; empty if unknown"""

    text: str
    key: str


def _columns(result: Result, differing: Sequence[str], found: Sequence[Resolution | None]) -> list[str]:
    """Titles: number, swept parameters, gauge, and scalars that differ."""
    unit = next((one.unit for one in found if one is not None), None)
    gauge = [] if unit is None else [f"virtual strain gauge [{unit}]"]
    return ["variant", *result.values[0], *gauge, *differing]


def _rows(
    result: Result,
    table: Sequence[Mapping[str, Any]],
    differing: Sequence[str],
    found: Sequence[Resolution | None],
) -> list[list[Cell]]:
    """One row per variant, under :func:`_columns`."""
    has_gauge = any(one is not None for one in found)
    rows = []
    for place, (row, one) in enumerate(zip(table, found, strict=True)):
        gauge = [_cell(None if one is None else one.side)] if has_gauge else []
        swept = [_cell(row.get(name)) for name in result.values[0]]
        rows.append(
            [Cell(f"#{place + 1}", str(place + 1)), *swept, *gauge, *(_cell(row.get(name)) for name in differing)]
        )
    return rows


def _cell(value: Any) -> Cell:
    known = value is not None and value == value
    return Cell(_shown(value), str(value) if known else "")


def _shown(value: Any) -> str:
    if isinstance(value, float):
        return number(value)
    return "–" if value is None else str(value)


def _alike(column: Sequence[float | None], share: float = _ALIKE) -> bool:
    known = [value for value in column if value is not None and math.isfinite(value)]
    return len(known) == len(column) and max(known) - min(known) <= share * max(abs(value) for value in known)


def _curves(result: Result, names: Sequence[str]) -> tuple[dict[str, list[list[float]]], tuple[str, ...]]:
    """Per scalar and variant one number per step, of the stages that have the most common steps; and those steps."""
    found: dict[str, list[list[float]]] = {}
    shown: tuple[str, ...] = ()
    for name in names:
        stage, _dot, key = name.partition(".")
        steps = result.steps(stage)
        if len(steps) < 2 or (shown and not set(steps) <= set(shown) and not set(shown) <= set(steps)):
            continue
        shown = steps if len(steps) > len(shown) else shown
        found[name] = [
            [_scalar(result, stage, key, step, place) for step in steps] for place in range(len(result.values))
        ]
    padded = {
        name: [[math.nan] * (len(shown) - len(row)) + row for row in rows]  # a pair of steps has no first
        for name, rows in found.items()
    }
    return padded, shown


def _scalar(result: Result, stage: str, key: str, step: str, variant: int) -> float:
    if not result.has(stage, step, variant):
        return math.nan
    value = summary_of(result.product(stage, step, variant)).get(key)
    return float(value) if isinstance(value, int | float) else math.nan


def _means(context: Context, table: Sequence[Mapping[str, Any]]) -> str:
    def draw() -> bytes:
        from dicflow.views.maps import png
        from dicflow.views.sweep import sweep_figure

        return png(sweep_figure(context.result.values, table))

    return _picture(context, ("sweep means", table_text(table)), draw)


def _steps(context: Context, curves: Mapping[str, list[list[float]]], steps: Sequence[str]) -> str:
    def draw() -> bytes:
        from dicflow.views.maps import png
        from dicflow.views.sweep import step_figure

        return png(step_figure(context.result.values, curves, steps))

    return _picture(context, ("sweep steps", json.dumps([context.result.values, curves, list(steps)])), draw)


def _fields(context: Context) -> list[tuple[str, str]]:
    """Title and picture of each field of the last step, of all variants that have it; the largest strain first."""
    result = context.result
    totals = result.stages_of("total")
    if not totals:
        return []
    stage, step = totals[-1], result.steps(totals[-1])[-1]
    there = [place for place in range(len(result.values)) if result.has(stage, step, place)]
    if not there:
        return []
    digests = [result.digest(stage, step, place) for place in there]
    labels = [f"#{place + 1}" for place in there]

    def drawing(quantity: str) -> Callable[[], bytes]:
        def draw() -> bytes:
            from dicflow.views.sweep import small_multiples

            return small_multiples([result.product(stage, step, place) for place in there], labels, quantity)

        return draw

    known = result.product(stage, step, there[0])
    summary = summary_of(known)
    largest_first = sorted(_FIELDS, key=lambda name: -abs(summary.get(f"mean_{name}") or 0.0))
    return [
        (
            f"{QUANTITIES[name].symbol} at {step}",
            _picture(context, ("sweep field", name, *labels, *digests), drawing(name)),
        )
        for name in largest_first
        if name in known
    ]


def _picture(context: Context, sources: tuple[str, ...], draw: Callable[[], bytes]) -> str:
    """A picture as the text of a data address, drawn once for the same sources."""
    return f"data:image/png;base64,{base64.b64encode(context.pieces.get(sources, draw)).decode()}"
