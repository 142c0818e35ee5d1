"""Rigs as JSON."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dicflow.io.exports.items import Item, place
from dicflow.io.rig import rig_text
from dicflow.kinds.rig import CalibratedRig

__all__ = ["BESIDE", "DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "a rig"
KINDS = ("rig",)
BESIDE = ("rig",)


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One file per rig, with its covariance if it is known; the numbers come back bit for bit."""
    for item in items:
        rig = CalibratedRig.read(item.product)
        text = rig_text(rig.cameras, rig.covariance)
        place(folder, f"{item.stem}.json").write_text(text, encoding="utf-8")
