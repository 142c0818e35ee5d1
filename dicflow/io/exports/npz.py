"""NumPy's NPZ."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dicflow.io.exports.items import Item, place
from dicflow.io.results import npz_bytes

__all__ = ["DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "NumPy"
KINDS = None


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One file per product: the arrays, and ``attributes`` as JSON text with the unit of each."""
    for item in items:
        place(folder, f"{item.stem}.npz").write_bytes(npz_bytes(item.chosen))
