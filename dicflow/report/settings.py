"""Section: the reporting table, filled in from the configuration and what was measured."""

from __future__ import annotations

from dicflow.report.context import Context, Section

__all__ = ["settings"]


def settings(context: Context) -> Section | None:
    """The section, None where nothing is known of the measurement."""
    return None
