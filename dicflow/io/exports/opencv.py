"""Rigs as OpenCV's YAML."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dicflow.io.calibrations.opencv import opencv_text
from dicflow.io.exports.items import Item, place
from dicflow.kinds.rig import CalibratedRig

__all__ = ["DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "a rig as OpenCV's YAML"
KINDS = ("rig",)


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One file per rig."""
    for item in items:
        text = opencv_text(CalibratedRig.read(item.product).cameras)
        place(folder, f"{item.stem}.yaml").write_text(text, encoding="utf-8")
