"""Section: what was computed and what was at hand, when, in what time and by which code."""

from __future__ import annotations

from dicflow.report.context import Context, Section

__all__ = ["provenance"]


def provenance(context: Context) -> Section | None:
    """The section, None for a pipeline that was never run."""
    return None
