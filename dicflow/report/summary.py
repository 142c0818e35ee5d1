"""Section: what came out, and what to be careful about."""

from __future__ import annotations

from collections.abc import Sequence

from dicflow.report.context import Context, Section

__all__ = ["summary"]


def summary(context: Context, sections: Sequence[Section]) -> Section | None:
    """The first section, which shows the warnings of all others; None where nothing is there yet."""
    return None
