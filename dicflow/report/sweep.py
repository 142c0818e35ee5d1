"""Section: the variants of a sweep side by side."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from dicflow.io.results import table_text
from dicflow.kinds.kind import summary_of
from dicflow.kinds.quantities import QUANTITIES
from dicflow.pipeline import Result
from dicflow.report.context import Context, Section
from dicflow.report.rendering import render
from dicflow.report.words import number

__all__ = ["PLACE", "TITLE", "sweep"]

PLACE = 40
TITLE = "Variants of the sweep"

_FIELDS = tuple(name for name, quantity in QUANTITIES.items() if "sweep" in quantity.uses)
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
    body = render(
        "sweep.html",
        columns=[("", "text"), *((f"#{place + 1}", "number") for place in range(len(table)))],
        swept=[[name, *(_shown(row.get(name)) for row in table)] for name in result.values[0]],
        differing=_rows(table, differing),
        equal=_rows(table, [name for name in scalars if name not in differing]),
        means=_means(context, table) if drawn else None,
        steps=_steps(context, *curves) if curves[0] else None,
        fields=_fields(context),
    )
    empty = [place + 1 for place, row in enumerate(table) if len(row) == len(result.values[place])]
    warnings = tuple(
        f"Variant #{place} of the sweep has nothing in the store; run the pipeline again." for place in empty
    )
    return Section("sweep", TITLE, body, warnings)


def _rows(table: Sequence[Mapping[str, Any]], names: Sequence[str]) -> list[list[str]]:
    return [[name, *(_shown(row.get(name)) for row in table)] for name in names]


def _shown(value: Any) -> str:
    if isinstance(value, int | float) and not isinstance(value, bool):
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
    """Title and picture of each field of the last step, of all variants that have it."""
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
    return [
        (f"{name} at {step}", _picture(context, ("sweep field", name, *labels, *digests), drawing(name)))
        for name in _FIELDS
        if name in known
    ]


def _picture(context: Context, sources: tuple[str, ...], draw: Callable[[], bytes]) -> str:
    """A picture as the text of a data address, drawn once for the same sources."""
    return f"data:image/png;base64,{base64.b64encode(context.pieces.get(sources, draw)).decode()}"
