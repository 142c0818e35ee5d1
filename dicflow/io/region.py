"""Regions of interest from files: GeoJSON polygons with holes, or a mask image."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import numpy.typing as npt

from dicflow.core.photographs.polygon import Polygon
from dicflow.errors import InputError
from dicflow.io.json_text import read_json
from dicflow.io.text import printable

__all__ = ["Drawing", "geojson_text", "is_geojson", "read_geojson", "read_mask", "write_geojson"]

_MAX_BYTES = 10_000_000
_MAX_CORNERS = 100_000
_FARTHEST_PX = 1e6
_INSIDE = {
    "FeatureCollection": "features",
    "Feature": "geometry",
    "GeometryCollection": "geometries",
    "MultiPolygon": "coordinates",
    "Polygon": "coordinates",
    "MultiLineString": "coordinates",
    "LineString": "coordinates",
}
_REDRAW = "draw the region as a polygon and export it again"


class Drawing(NamedTuple):
    """What a GeoJSON file holds.

    polygons : one or more
    cuts : lines to cut them along, each (n, 2) [px]
    """

    polygons: list[Polygon]
    cuts: list[npt.NDArray[np.float64]]


def is_geojson(path: Path) -> bool:
    """Whether a file holds polygons, by the suffix of its name."""
    return path.suffix.lower() in (".json", ".geojson")


def read_geojson(path: Path) -> Drawing:
    """Polygons and cuts of a GeoJSON file (RFC 7946), coordinates in px: x right, y down.

    Any nesting of FeatureCollection, Feature, GeometryCollection, MultiPolygon, Polygon, MultiLineString and
    LineString; nothing else. Raises InputError that names the file if it cannot be read or has no polygon.
    """
    shapes = list(_all_shapes(path, read_json(path, "a region in GeoJSON", _MAX_BYTES)))
    polygons = [rings for kind, rings in shapes if kind == "Polygon"]
    lines = [line for kind, line in shapes if kind == "LineString"]
    _check_corners(path, [*lines, *(ring for rings in polygons if isinstance(rings, list) for ring in rings)])
    if not polygons:
        raise InputError(str(path), "has no polygon", "draw the region's outline and export it again")
    return Drawing([_polygon(path, rings) for rings in polygons], [_line(path, line) for line in lines])


def write_geojson(path: Path, polygons: Sequence[Polygon]) -> None:
    """Write polygons as one GeoJSON MultiPolygon [px], rings closed as the format asks."""
    path.write_text(geojson_text(polygons), encoding="utf-8")


def geojson_text(polygons: Sequence[Polygon], cuts: Sequence[npt.NDArray[np.float64]] = ()) -> str:
    """The text of a GeoJSON file: a MultiPolygon, and beside it the lines to cut along, if there are any [px]."""
    coordinates = [[np.vstack([ring, ring[:1]]).tolist() for ring in polygon.rings] for polygon in polygons]
    area = {"type": "MultiPolygon", "coordinates": coordinates}
    lines = {"type": "MultiLineString", "coordinates": [line.tolist() for line in cuts]}
    whole = {"type": "GeometryCollection", "geometries": [area, lines]} if len(cuts) else area
    return json.dumps(whole) + "\n"


def read_mask(path: Path) -> npt.NDArray[np.bool_]:
    """The bright pixels of a mask image, (row, col) bool: those above half of its greatest grey level.

    Raises InputError that names the file if it is not an image, or is black.
    """
    from dicflow.io.images import read_photograph

    grey, _, counts = read_photograph(path)
    if counts is not None:
        grey = np.where(counts, grey, 0)
    if not grey.any():
        raise InputError(str(path), "the mask is black everywhere", "paint the region of interest white")
    return grey > int(grey.max()) // 2


def _check_corners(path: Path, lines: Sequence[Any]) -> None:
    corners = sum(len(line) for line in lines if isinstance(line, list))
    if corners > _MAX_CORNERS:
        raise InputError(
            str(path), f"has {corners:,} corners, at most {_MAX_CORNERS:,} are read", "simplify the outline"
        )


def _all_shapes(path: Path, whole: Any) -> Iterator[tuple[str, Any]]:
    """Polygon or LineString, and its coordinates, of every one inside a GeoJSON object, in the order of the file."""
    waiting = [whole]
    while waiting:
        value = waiting.pop()
        kind = str(value.get("type")) if isinstance(value, dict) else type(value).__name__
        inside = value.get(_INSIDE[kind]) if kind in _INSIDE else None
        if kind in ("Polygon", "LineString"):
            yield kind, inside
        elif kind == "Feature":
            waiting.append(inside)
        elif not isinstance(inside, list):
            raise InputError(str(path), f"expected polygons in GeoJSON, found {printable(kind)}", _REDRAW)
        elif kind.startswith("Multi"):
            yield from ((kind.removeprefix("Multi"), part) for part in inside)
        else:
            waiting += reversed(inside)


def _polygon(path: Path, rings: Any) -> Polygon:
    """A polygon from its rings, each closed or not."""
    if not isinstance(rings, list) or not rings:
        raise InputError(str(path), "a polygon has no coordinates, expected a list of rings", _REDRAW)
    exterior, *holes = (_ring(path, ring) for ring in rings)
    return Polygon(exterior, tuple(holes))


def _line(path: Path, line: Any) -> npt.NDArray[np.float64]:
    points = _points(path, line)
    if len(points) < 2:
        raise InputError(str(path), f"a line must be at least two points [x, y], found {printable(line)}", _REDRAW)
    return points


def _ring(path: Path, ring: Any) -> npt.NDArray[np.float64]:
    points = _points(path, ring)
    if len(points) > 1 and (points[0] == points[-1]).all():
        points = points[:-1]
    if len(points) < 3:
        problem = f"a ring of a polygon must be at least three points [x, y], found {printable(ring)}"
        raise InputError(str(path), problem, _REDRAW)
    return points


def _points(path: Path, values: Any) -> npt.NDArray[np.float64]:
    """Points (n, 2) [px]; none where the values are not points."""
    try:
        points = np.array([_corner(*point) for point in values]).reshape(-1, 2)
    except (TypeError, ValueError):
        points = np.zeros((0, 2))
    if np.abs(points).max(initial=0.0) > _FARTHEST_PX:
        problem = f"a corner lies at {np.abs(points).max():g} px, expected {_FARTHEST_PX:,.0f} px at most"
        raise InputError(str(path), problem, "give the region in pixels of the left photograph")
    return points


def _corner(x: Any, y: Any, *_: Any) -> tuple[float, float]:
    """A corner [px]. Raises TypeError if its coordinates are not numbers."""
    if not (isinstance(x, int | float) and isinstance(y, int | float)):
        raise TypeError
    return float(x), float(y)
