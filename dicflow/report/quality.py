"""Section: uncertainty, convergence, and what the speckle is good for."""

from __future__ import annotations

from dicflow.report.context import Context, Section

__all__ = ["quality"]


def quality(context: Context) -> Section | None:
    """The section, None where nothing was followed."""
    return None
