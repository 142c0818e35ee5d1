"""CSV with a commented header: units, measures, virtual strain gauge, version."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dicflow.io.exports.items import Item, place
from dicflow.io.results import csv_text

__all__ = ["BESIDE", "DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "a table with units"
KINDS = None
BESIDE = ("comparison", "probes", "channels", "noise", "curve", "material")


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One table per product."""
    for item in items:
        text = csv_text(item.placed, item.stem, item.style)
        place(folder, f"{item.stem}.csv").write_text(text, encoding="utf-8")
