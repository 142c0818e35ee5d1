"""CSV with a commented header: units, measures, virtual strain gauge, version."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dicflow.io.exports.items import Item, place
from dicflow.io.results import csv_text

__all__ = ["KINDS", "write"]

KINDS = None


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One table per product."""
    for item in items:
        place(folder, f"{item.stem}.csv").write_text(csv_text(item.chosen, item.stem), encoding="utf-8")
