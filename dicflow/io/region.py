"""Regions of interest from files: GeoJSON polygons with holes, or a mask image."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from dicflow.core.photographs.region import Polygon
from dicflow.errors import InputError

__all__ = ["is_geojson", "read_geojson", "read_mask", "write_geojson"]


def is_geojson(path: Path) -> bool:
    """Whether a file holds polygons, by the suffix of its name."""
    return path.suffix.lower() in (".json", ".geojson")


def read_geojson(path: Path) -> list[Polygon]:
    """Polygons of a GeoJSON file (RFC 7946), coordinates in px: x right, y down.

    Any nesting of FeatureCollection, Feature, GeometryCollection, MultiPolygon and Polygon; nothing else.
    Raises InputError that names the file if it cannot be read or has no polygon.
    """
    try:
        polygons = [_polygon(path, rings) for rings in _polygons(path, json.loads(path.read_text(encoding="utf-8")))]
    except OSError as error:
        raise InputError(f"{path}: expected a region in GeoJSON, but it cannot be read ({error.strerror})") from error
    except ValueError as error:
        raise InputError(f"{path}: expected GeoJSON, but it is not valid JSON ({error}); export it again") from error
    if not polygons:
        raise InputError(f"{path}: has no polygon; draw the region's outline and export it again")
    return polygons


def write_geojson(path: Path, polygons: Sequence[Polygon]) -> None:
    """Write polygons as one GeoJSON MultiPolygon [px], rings closed as the format asks."""
    coordinates = [[np.vstack([ring, ring[:1]]).tolist() for ring in polygon.rings] for polygon in polygons]
    path.write_text(json.dumps({"type": "MultiPolygon", "coordinates": coordinates}) + "\n", encoding="utf-8")


def read_mask(path: Path) -> npt.NDArray[np.bool_]:
    """The bright pixels of a mask image, (row, col) bool: those above half of its greatest grey level.

    Raises InputError that names the file if it is not an image, or is black.
    """
    from dicflow.io.images import read_photograph

    grey, _, counts = read_photograph(path)
    if counts is not None:
        grey = np.where(counts, grey, 0)
    if not grey.any():
        raise InputError(f"{path}: the mask is black everywhere; paint the region of interest white")
    return grey > int(grey.max()) // 2


def _polygons(path: Path, value: Any) -> Iterator[Any]:
    """Coordinates of every polygon inside a GeoJSON object."""
    kind = value.get("type") if isinstance(value, dict) else None
    inside = {"FeatureCollection": "features", "GeometryCollection": "geometries", "MultiPolygon": "coordinates"}
    if kind == "Polygon":
        yield value.get("coordinates")
    elif kind == "Feature":
        yield from _polygons(path, value.get("geometry"))
    elif kind in inside and isinstance(value.get(inside[kind]), list):
        for part in value[inside[kind]]:
            yield from [part] if kind == "MultiPolygon" else _polygons(path, part)
    else:
        raise InputError(f"{path}: expected polygons in GeoJSON, found {kind or type(value).__name__}")


def _polygon(path: Path, rings: Any) -> Polygon:
    """A polygon from its rings, each closed or not."""
    if not isinstance(rings, list) or not rings:
        raise InputError(f"{path}: a polygon has no coordinates; expected a list of rings")
    exterior, *holes = (_ring(path, ring) for ring in rings)
    return Polygon(exterior, tuple(holes))


def _ring(path: Path, ring: Any) -> npt.NDArray[np.float64]:
    try:
        points = np.array([[float(x), float(y)] for x, y, *_ in ring]).reshape(-1, 2)
    except (TypeError, ValueError):
        points = np.full((0, 2), np.nan)
    if len(points) > 1 and (points[0] == points[-1]).all():
        points = points[:-1]
    if len(points) < 3 or not np.isfinite(points).all():
        raise InputError(f"{path}: a ring of a polygon must be at least three finite points [x, y], found {ring!r:.60}")
    return points
