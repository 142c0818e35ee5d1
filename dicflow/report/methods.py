"""Section: a methods paragraph for a paper, with its references."""

from __future__ import annotations

from dicflow.report.context import Context, Section
from dicflow.report.paragraph import methods_paragraph
from dicflow.report.rendering import render

__all__ = ["PLACE", "TITLE", "methods"]

PLACE = 55
TITLE = "Methods"


def methods(context: Context) -> Section:
    """The section; its button copies paragraph and references as text."""
    return Section(
        "methods", TITLE, render("methods.html", paragraph=methods_paragraph(context.pipeline, context.result))
    )
