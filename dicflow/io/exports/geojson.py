"""Regions as GeoJSON, in pixels of the left photograph."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from dicflow.core.photographs.region import carry
from dicflow.io.exports.items import Item, place
from dicflow.io.region import write_geojson
from dicflow.kinds.region import Region

__all__ = ["BESIDE", "DESCRIPTION", "KINDS", "write"]

DESCRIPTION = "a region"
KINDS = ("region",)
BESIDE = ("region",)
_SPACING_PX = 20.0
"""Longest edge: lens distortion curves an edge, which a longer straight one would not follow."""


def write(items: Iterable[Item], folder: Path, name: str) -> None:
    """One file per region, such as the stage "region" reads."""
    for item in items:
        polygons = Region.read(item.product).polygons
        if item.outline is not None:
            polygons = carry(polygons, item.outline, _SPACING_PX)
        write_geojson(place(folder, f"{item.stem}.geojson"), polygons)
