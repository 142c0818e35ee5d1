"""Section: each quantity over the photographs, step by step."""

from __future__ import annotations

from dicflow.report.context import Context, Section

__all__ = ["fields"]


def fields(context: Context) -> Section | None:
    """The section, None for a pipeline without totals."""
    return None
