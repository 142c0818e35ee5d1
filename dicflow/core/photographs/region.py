"""Regions of interest: polygons with holes, the pixels that they cover, and their motion.

Every ring is an (n, 2) array of (x, y) [px], n at least 3, without a repetition of the first corner at the end.
Whether a point is inside follows the even-odd rule, so the direction of a ring does not matter.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import cv2
import numpy as np

from dicflow.core.arrays import Array, Bytes, Counts, Grey, Mask
from dicflow.core.parts import Parts, cut_segments, grid_parts
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.texture import Texture, speckled_points

__all__ = [
    "area",
    "bounding_box",
    "carry",
    "contains",
    "cut_apart",
    "densify",
    "densify_line",
    "enclosing",
    "grid_points",
    "interior",
    "mask_polygons",
    "parts_of_region",
    "rasterise",
    "rectangle",
    "simplified",
    "speckled_region",
]


def interior(polygons: Sequence[Polygon], shape: tuple[int, int], margin_px: int = 1) -> Mask:
    """Pixels (rows, cols) of a region without a margin along the edge of each polygon.

    At the specimen's edge, the outermost pixels show a part of the background that changes between photographs.
    Polygons that touch stay apart.

    shape : (rows, cols) of the image
    """
    side = 2 * margin_px + 1
    inside = np.zeros(shape, dtype=np.bool_)
    for polygon in polygons:
        mask = rasterise([polygon], shape).astype(np.uint8)
        inside ^= cv2.erode(mask, np.ones((side, side), dtype=np.uint8)) > 0
    return inside


def rectangle(x0: float, y0: float, x1: float, y1: float) -> Polygon:
    """The polygon of a rectangle with sides along x and y.

    >>> area([rectangle(0, 0, 4, 3)])
    12.0
    """
    return Polygon(np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]], dtype=float))


def area(polygons: Sequence[Polygon]) -> float:
    """Area of a region [px²]: exteriors minus holes, by the shoelace formula."""
    return float(sum(_ring_area(p.exterior) - sum(map(_ring_area, p.holes)) for p in polygons))


def bounding_box(polygons: Sequence[Polygon]) -> tuple[float, float, float, float]:
    """Extent (x0, y0, x1, y1) of a region [px]."""
    corners = np.concatenate([p.exterior for p in polygons])
    x0, y0 = corners.min(axis=0).tolist()
    x1, y1 = corners.max(axis=0).tolist()
    return x0, y0, x1, y1


_MOST_RINGS = 10_000
"""Of a polygon and the strips that are cut out of it."""


def contains(polygons: Sequence[Polygon], points: Array) -> Mask:
    """Which points (..., 2) lie in the region, (...) bool; False for NaN.

    Even-odd rule over all rings. A point on an edge belongs to the region on one side only, so regions that share an
    edge have no common point.
    """
    x, y = points[..., 0], points[..., 1]
    inside = np.zeros(x.shape, dtype=bool)
    for polygon in polygons:
        for ring in polygon.rings:
            for (ax, ay), (bx, by) in zip(ring, np.roll(ring, -1, axis=0), strict=True):
                if ay != by:
                    crosses = (ay > y) != (by > y)
                    inside ^= crosses & (x < ax + (y - ay) * ((bx - ax) / (by - ay)))
    return inside


def enclosing(polygons: Sequence[Polygon], points: Array) -> Counts:
    """Number of the polygon, from 1, in which points (..., 2) lie, (...) int32; 0 outside all and for NaN."""
    number = np.zeros(points.shape[:-1], dtype=np.int32)
    for k, polygon in enumerate(polygons, start=1):
        number[contains([polygon], points)] = k
    return number


def parts_of_region(polygons: Sequence[Polygon], cuts: Sequence[Array], points: Array) -> Parts:
    """The parts of a grid of points (rows, cols, 2): polygons, and what cuts, each a line (n, 2), make of them [px]."""
    separate = len(polygons) > 1
    polygon = enclosing(polygons, points) if separate else np.ones(points.shape[:2], dtype=np.int32)
    return grid_parts(points, polygon, cut_segments(cuts))


def simplified(line: Array, tolerance_px: float = 1.0) -> Array:
    """The places of a line (n, 2) that it needs to stay within a tolerance of itself, (m, 2) [px].

    D. H. Douglas and T. K. Peucker, Cartographica 10 (1973).
    """
    kept = cv2.approxPolyDP(line.astype(np.float32)[:, None], tolerance_px, closed=False)[:, 0]
    if len(kept) > 2 and (line[0] == line[-1]).all() and (kept[0] != kept[-1]).any():
        kept = np.concatenate([kept, kept[:1]])  # OpenCV closes a line that ends where it begins, and drops its end
    return np.asarray(np.round(kept.astype(np.float64), 3))


def cut_apart(polygon: Polygon, cuts: Sequence[Array], width_px: float = 3.0) -> Polygon:
    """A polygon without strips along lines.

    cuts : lines, each (n, 2) [px]; width_px : of the strips

    Strips become holes by the even-odd rule: what a strip has in common with a ring is one more ring.
    Raises ValueError for lines that meet or cross so often that the rings would be too many.
    """
    rings = list(polygon.rings)
    for line in cuts:
        for start, end in pairwise(line):
            shared = (_clipped(ring, _strip(start, end, 0.5 * width_px)) for ring in rings)
            rings += [ring for ring in shared if len(ring) >= 3]
            if len(rings) > _MOST_RINGS:
                raise ValueError("the cuts meet or cross too often; simplify the lines")
    return Polygon(rings[0], tuple(rings[1:]))


def _strip(start: Array, end: Array, half_width_px: float) -> Array:
    """Corners (4, 2) of the strip along a straight line, half its width longer at each end."""
    along = (end - start) * (half_width_px / max(float(np.linalg.norm(end - start)), 1e-9))
    across = np.array([-along[1], along[0]])
    return np.array([start - along - across, end + along - across, end + along + across, start - along + across])


def _clipped(ring: Array, convex: Array) -> Array:
    """The part of a ring inside a convex ring (Sutherland and Hodgman, Communications of the ACM 17, 1974).

    Separate parts are joined by edges that are run along twice, which the even-odd rule does not count.
    """
    if (ring.max(axis=0) < convex.min(axis=0)).any() or (ring.min(axis=0) > convex.max(axis=0)).any():
        return ring[:0]
    for corner, following in zip(convex, np.roll(convex, -1, axis=0), strict=True):
        if len(ring) == 0:
            break
        x, y = following - corner
        side = x * (ring[:, 1] - corner[1]) - y * (ring[:, 0] - corner[0])
        before, side_before = np.roll(ring, 1, axis=0), np.roll(side, 1)
        points = []
        for a, b, s, t in zip(before, ring, side_before, side, strict=True):
            if (s >= 0.0) != (t >= 0.0):
                points.append(a + (b - a) * (s / (s - t)))
            if t >= 0.0:
                points.append(b)
        ring = np.array(points).reshape(-1, 2)
    return ring


def grid_points(polygons: Sequence[Polygon], step_size: int) -> Array:
    """A grid of whole pixels (rows, cols, 2) over a region; NaN outside the region.

    step_size : distance between neighbouring points [px]
    """
    x0, y0, x1, y1 = bounding_box(polygons)
    x, y = (np.arange(np.ceil(low), high, step_size) for low, high in ((x0, x1), (y0, y1)))
    points = np.stack(np.meshgrid(x, y), axis=-1)
    points[~_grid_inside(polygons, x, y)] = np.nan
    return points


def rasterise(polygons: Sequence[Polygon], shape: tuple[int, int]) -> Mask:
    """Pixels (rows, cols) whose centres lie in the region, as by :func:`contains` on a pixel grid, but faster.

    shape : (rows, cols) of the image
    """
    height, width = shape
    return _grid_inside(polygons, np.arange(width, dtype=np.float64), np.arange(height, dtype=np.float64))


def _grid_inside(polygons: Sequence[Polygon], x: Array, y: Array) -> Mask:
    """Which places of a grid with rising axes (cols,) and (rows,) lie in the region, (rows, cols).

    Where an edge crosses a row, the places beyond change sides. Whole columns take it from the one before at once.
    """
    if not (len(x) and len(y)):
        return np.zeros((len(y), len(x)), dtype=np.bool_)
    rings = [np.empty((0, 2)), *(ring for polygon in polygons for ring in polygon.rings)]
    starts, ends = np.concatenate(rings), np.concatenate([np.roll(ring, -1, axis=0) for ring in rings])
    first, last = np.searchsorted(y, np.sort([starts[:, 1], ends[:, 1]], axis=0))
    edge = np.repeat(np.arange(len(starts)), last - first)
    row = np.arange(len(edge)) - np.repeat(np.cumsum(last - first) - last, last - first)
    (ax, ay), (bx, by) = starts[edge].T, ends[edge].T
    crossing = ax + (y[row] - ay) * ((bx - ax) / (by - ay))
    by_column = np.zeros((len(x) + 1, len(y)), dtype=np.uint8)
    np.bitwise_xor.at(by_column, (np.searchsorted(x, crossing), row), 1)
    top, left, height, width = cv2.boundingRect(by_column)
    for before, after in pairwise(by_column[left : left + width, top : top + height]):
        after ^= before
    return np.asarray(cv2.transpose(by_column[: len(x)])).view(np.bool_)


def densify(ring: Array, spacing_px: float) -> Array:
    """The ring with corners added on its edges, so that no edge is longer than ``spacing_px``.

    A straight edge may become curved under lens distortion or a deformation.
    """
    edges = np.roll(ring, -1, axis=0) - ring
    pieces = np.maximum(1, np.ceil(np.linalg.norm(edges, axis=1) / spacing_px)).astype(int)
    start = np.repeat(np.arange(len(ring)), pieces)
    within = np.arange(len(start)) - np.repeat(np.cumsum(pieces) - pieces, pieces)
    dense: Array = ring[start] + edges[start] * (within / pieces[start])[:, None]
    return dense


def densify_line(line: Array, spacing_px: float) -> Array:
    """A line (n, 2) with points added on its pieces, so that none is longer than ``spacing_px``; ends stay."""
    pieces = [densify(np.stack([start, end]), spacing_px) for start, end in pairwise(line)]
    return np.concatenate([*(piece[: (len(piece) + 1) // 2] for piece in pieces), line[-1:]])


def carry(
    polygons: Sequence[Polygon], mapping: Callable[[Array], Array], spacing_px: float | None = None
) -> list[Polygon]:
    """The region with every corner moved by ``mapping`` ((n, 2) → (n, 2)).

    spacing_px : greatest length of an edge before the motion (:func:`densify`); edges stay whole if absent
    """

    def moved(ring: Array) -> Array:
        return mapping(ring if spacing_px is None else densify(ring, spacing_px))

    return [Polygon(moved(p.exterior), tuple(moved(hole) for hole in p.holes)) for p in polygons]


def mask_polygons(mask: Mask, *, tolerance_px: float = 0.5, least_area_px: float = 16.0) -> list[Polygon]:
    """Outlines of the parts of a mask (rows, cols), with holes, largest part first.

    tolerance_px : largest deviation of the simplified outline from the mask's
    least_area_px : smaller parts are dropped, smaller holes filled [px²]

    Outlines run through the centres of the mask's border pixels.
    """
    contours, hierarchy = cv2.findContours(mask.astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    rings = [_simplified(contour, tolerance_px) for contour in contours]
    keep = [len(ring) >= 3 and _ring_area(ring) >= least_area_px for ring in rings]
    parents = [] if hierarchy is None else hierarchy[0][:, 3].tolist()
    polygons = []
    for outer, parent in enumerate(parents):
        if parent < 0 and keep[outer]:
            holes = (rings[i] for i, of in enumerate(parents) if of == outer and keep[i])
            polygons.append(Polygon(rings[outer], tuple(holes)))
    return sorted(polygons, key=lambda polygon: -area([polygon]))


def speckled_region(texture: Texture, excluded: Mask | None = None) -> list[Polygon]:
    """The largest speckled part of an image with its holes, as one polygon [px]; empty without speckles.

    excluded : (rows, cols) of the texture's grid — points that do not belong to the specimen

    Gaps and islands narrower than a window are removed. The edge is moved inwards by half a window, because a window
    that is half on the background still contains texture.
    """
    side = max(1, round(texture.window_px / texture.stride_px))
    mask = (speckled_points(texture) & (True if excluded is None else ~excluded)).astype(np.uint8)
    mask = cv2.morphologyEx(np.pad(mask, side, mode="edge"), cv2.MORPH_CLOSE, _disc(side // 2))
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, _disc(side // 2))
    mask = cv2.erode(mask, _disc(side // 2))[side:-side, side:-side]
    outlines = mask_polygons(mask > 0, tolerance_px=0.5, least_area_px=float(side**2))[:1]
    return carry(outlines, lambda ring: ring * texture.stride_px)


def _ring_area(ring: Array) -> float:
    """Area inside one ring [px²]."""
    x, y = (ring - ring[0]).T
    return 0.5 * abs(float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))))


def _simplified(contour: Grey, tolerance_px: float) -> Array:
    """A contour of cv2 (n, 1, 2) as a ring with fewer corners."""
    return np.asarray(cv2.approxPolyDP(contour, tolerance_px, True)[:, 0], dtype=float)


def _disc(radius: int) -> Bytes:
    """Round structuring element."""
    return np.asarray(cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * radius + 1, 2 * radius + 1)), dtype=np.uint8)
