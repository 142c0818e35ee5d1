"""Section: how good the calibration is."""

from __future__ import annotations

from dicflow.report.context import Context, Section

__all__ = ["calibration"]


def calibration(context: Context) -> Section | None:
    """The section, None for a pipeline without a rig."""
    return None
