"""Rigs as JSON."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dicflow.io.exports.items import Item, place
from dicflow.io.rig import rig_from_dict, rig_text

__all__ = ["KINDS", "write"]

KINDS = ("rig",)


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One file per rig; its numbers come back bit for bit."""
    for item in items:
        text = rig_text(rig_from_dict(item.product.attrs["rig"]))
        place(folder, f"{item.stem}.json").write_text(text, encoding="utf-8")
