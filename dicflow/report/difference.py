"""Section: differences between two measurements; also a page of its own."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence

from dicflow._version import __version__
from dicflow.comparison.difference import Comparison, Difference
from dicflow.report.context import Section
from dicflow.report.rendering import assets, render

__all__ = ["COLUMNS", "difference", "difference_page", "difference_rows"]

COLUMNS = (
    "step",
    "quantity",
    "unit",
    "points",
    "share %",
    "mean",
    "σ",
    "rms",
    "2.5 %",
    "50 %",
    "97.5 %",
    "largest",
    "outside σ %",
)
"""Titles of :func:`difference_rows`."""

_MAPS = 6
"""Steps drawn of each quantity; the table has all."""


def difference(comparison: Comparison) -> Section:
    """The section."""
    words = [("step", "text"), ("quantity", "text"), ("unit", "text")]
    body = render(
        "difference.html",
        comparison=comparison,
        alike=not comparison.differs,
        columns=[*words, *((title, "number") for title in COLUMNS[3:])],
        rows=[[_shown(cell) for cell in row] for row in difference_rows(comparison)],
        pictures=[_picture(list(group)) for group in _by_quantity(comparison.differences)],
    )
    return Section("difference", "Differences", body, comparison.notes)


def difference_page(comparison: Comparison) -> bytes:
    """The section as a complete HTML file, which needs no network and no other file."""
    page = render(
        "page.html",
        title="Two measurements compared",
        subtitle=f"A: {comparison.a} · B: {comparison.b}",
        style=assets(".css"),
        script=assets(".js"),
        sections=[difference(comparison)],
        logo="",
        folded=(),
        appendix=(),
        paper_title="",
        version=__version__,
    )
    return page.encode()


def difference_rows(comparison: Comparison) -> list[list[str | int | float]]:
    """One row per step and quantity, under :data:`COLUMNS`."""
    return [_row(one) for one in comparison.differences]


def _row(one: Difference) -> list[str | int | float]:
    found = one.agreement
    outside: str | float = "–" if found.share_beyond_sigma is None else 100.0 * found.share_beyond_sigma
    numbers = (found.mean, found.sigma, found.rms, *found.percentiles, found.largest, outside)
    return [one.step, one.quantity, _unit(one), found.points, 100.0 * found.share, *numbers]


def _unit(one: Difference) -> str:
    return "–" if one.unit in ("", "1") else one.unit


def _shown(cell: str | int | float) -> str:
    if isinstance(cell, float):
        return f"{cell:.3g}".replace("-", "−") if math.isfinite(cell) else "–"
    return str(cell)


def _by_quantity(differences: Sequence[Difference]) -> list[list[Difference]]:
    names = dict.fromkeys(one.quantity for one in differences)
    return [[one for one in differences if one.quantity == name] for name in names]


def _picture(differences: list[Difference]) -> tuple[str, str]:
    """Title and picture as the text of a data address."""
    from dicflow.views.difference import difference_maps
    from dicflow.views.maps import png

    count = len(differences)
    places = sorted({round(index * (count - 1) / max(1, min(_MAPS, count) - 1)) for index in range(min(_MAPS, count))})
    drawn = png(difference_maps([differences[place] for place in places]))
    return differences[0].title, f"data:image/png;base64,{base64.b64encode(drawn).decode()}"
