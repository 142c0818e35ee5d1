"""Section: the reporting table, filled in from the configuration and what was measured."""

from __future__ import annotations

from itertools import groupby

from dicflow.report.context import Context, Section
from dicflow.report.rendering import render
from dicflow.report.reporting import reporting_rows

__all__ = ["PLACE", "TITLE", "settings"]

PLACE = 50
TITLE = "Settings"


def settings(context: Context) -> Section | None:
    """The section, None without photographs; rows without a known value are left to the user."""
    if not context.result.stages_of("images"):
        return None
    rows = reporting_rows(context)
    groups = [(name, list(members)) for name, members in groupby(rows, key=lambda row: row.group)]
    body = render(
        "settings.html",
        groups=groups,
        blanks=sum(row.value is None for row in rows),
        swept=context.result.values[0] if len(context.result.values) > 1 else {},
    )
    return Section("settings", TITLE, body)
