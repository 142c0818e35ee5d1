"""CSV with a commented header: units, measures, virtual strain gauge, version."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dicflow.engine.product import Product, Variable
from dicflow.io.exports.items import Item, place
from dicflow.io.results import csv_text

__all__ = ["BESIDE", "DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "a table with units"
KINDS = None
BESIDE = ("comparison", "probes", "noise")


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One table per product."""
    for item in items:
        place(folder, f"{item.stem}.csv").write_text(csv_text(_placed(item), item.stem), encoding="utf-8")


def _placed(item: Item) -> Product:
    """The chosen arrays; of a whole total also the places in the first photograph, by which tables are compared."""
    product = item.chosen
    if item.quantities or item.places is None or "xy_reference" in product:
        return product
    places = Variable(
        ("row", "col", "component"), item.places(), "px", "place in the left photograph of the first step"
    )
    return Product(product.kind, {**product.variables, "xy_reference": places}, product.attrs)
