"""Section: the reporting table, filled in from the configuration and what was measured."""

from __future__ import annotations

import json
from itertools import groupby

from dicflow.report.context import Context, Section
from dicflow.report.rendering import render
from dicflow.report.reporting import Row, reporting_rows

__all__ = ["PLACE", "TITLE", "settings"]

PLACE = 50
TITLE = "Settings"


def settings(context: Context) -> Section:
    """The section; rows without a known value are left to the user."""
    rows = _rows(context)
    groups = [(name, list(members)) for name, members in groupby(rows, key=lambda row: row.group)]
    body = render(
        "settings.html",
        groups=groups,
        blanks=sum(row.value is None for row in rows),
        swept=context.result.values[0] if len(context.result.values) > 1 else {},
    )
    return Section("settings", TITLE, body)


def _rows(context: Context) -> list[Row]:
    """The table, made again if a setting or a product has changed."""
    result, resolved = context.result, context.pipeline.resolved()
    digests = [
        result.digest(stage, step)
        for stage in result.stages
        for step in result.steps(stage) or (None,)
        if result.has(stage, step)
    ]

    def made() -> bytes:
        return json.dumps(reporting_rows(result, resolved)).encode()

    found = json.loads(context.pieces.get(["reporting", json.dumps(resolved), *digests], made))
    return [Row(*row) for row in found]
