"""Section: the variants of a sweep side by side."""

from __future__ import annotations

from dicflow.report.context import Context, Section

__all__ = ["sweep"]


def sweep(context: Context) -> Section | None:
    """The section, None for a pipeline with one variant."""
    return None
