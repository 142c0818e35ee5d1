"""Material points in a photograph, with which a search starts and which it returns."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Codes, Iterations, Mask, all_finite
from dicflow.core.correlation.warp import warp_from_gradient
from dicflow.core.matching.pairs import local_motion
from dicflow.core.nearest import nearest
from dicflow.core.parts import Parts, sees
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import carry, enclosing
from dicflow.core.status import Status

__all__ = [
    "DIRECT",
    "MIN_POINTS_FOR_MOTION",
    "VIA_REFERENCE_STEP",
    "FoundPoints",
    "ReferencePhotograph",
    "carried_motion",
    "carried_outline",
    "carried_points",
    "cropped",
    "merged",
    "part_masks",
    "with_terms",
]

DIRECT, VIA_REFERENCE_STEP = 1, 2
"""Routes by which a point is found."""

MARGIN_PX = 24
"""Pixels kept around the subsets of a cropped photograph: those farther away do not change the spline there."""


MIN_POINTS_FOR_MOTION = 3
"""With fewer valid points, the motion of the others is unknown."""
_NEAR_CORNER = 200
"""Points around a corner of the outline among which those on its own side of a cut are looked for."""


class ReferencePhotograph(NamedTuple):
    """A photograph with known places of the material points, whose subsets can be searched for.

    image : (h, w); part of the photograph
    origin : (x, y) of its first pixel [px]
    region : (h, w) bool — pixels in the region
    points : (rows, cols, 2) — places of the points in the photograph [px]; NaN where unknown
    warp : (rows, cols, 2, m) — from the first photograph
    inherited_covariance : (rows, cols, 3) — of the places, by earlier photographs except the first [px²]
    slope : (rows, cols, 2, 2) — gradient of the motion from the photograph with whose subsets the points were found
    age : steps for which it has been the reference photograph
    """

    image: Photograph
    origin: tuple[int, int]
    region: Mask
    points: Array
    warp: Array
    inherited_covariance: Array
    slope: Array
    age: int = 0


class FoundPoints(NamedTuple):
    """Material points in one photograph, on the grid (rows, cols).

    warp : (..., 2, m) — from the first photograph; NaN where a point has no value
    znssd, iterations, status : of the subset that found the point
    covariance : (..., 3) — of the places, without the noise of the first photograph [px²]
    route : uint8 — DIRECT: with a subset of the first photograph; VIA_REFERENCE_STEP; 0: no value, or the photograph
        is the first one
    template_covariance : (..., 3) — of the places, by the noise of the template [px² of the first photograph]
    inherited_covariance : (..., 3) — share of reference steps in ``covariance`` [px²]
    slope : (..., 2, 2) — gradient of the motion from the reference photograph
    residual : (...) — variance of the difference of template and target [grey levels²]
    misfit : (..., 3) — share of the misfit of subsets in ``covariance`` [px²]
    """

    warp: Array
    znssd: Array
    iterations: Iterations
    status: Codes
    covariance: Array
    route: Codes
    template_covariance: Array
    inherited_covariance: Array
    slope: Array
    residual: Array
    misfit: Array

    @property
    def valid(self) -> Mask:
        """Which points have a value."""
        return np.asarray(self.status == Status.VALID, dtype=np.bool_)


def cropped(reference: ReferencePhotograph, subset_size: int) -> ReferencePhotograph:
    """The reference photograph without pixels that its subsets do not need."""
    if not all_finite(reference.points).any():
        return reference
    reach, places = subset_size // 2 + 1 + MARGIN_PX, [reference.points[..., axis] for axis in range(2)]
    least, most = (np.array([bound(place) for place in places]) for bound in (np.nanmin, np.nanmax))
    x0, y0 = np.maximum(np.floor(least - reference.origin).astype(int) - reach, 0).tolist()
    x1, y1 = (np.ceil(most - reference.origin).astype(int) + reach + 1).tolist()
    part = slice(y0, y1), slice(x0, x1)
    origin = reference.origin[0] + x0, reference.origin[1] + y0
    image = Photograph._make(None if values is None else values[part] for values in reference.image)
    return reference._replace(image=image, region=reference.region[part], origin=origin)


def with_terms(reference: ReferencePhotograph, terms: int) -> ReferencePhotograph:
    """The reference photograph with warps of so many terms: further ones are 0, those of a poorer shape are dropped."""
    warp = np.zeros((*reference.warp.shape[:-1], terms))
    shared = min(terms, reference.warp.shape[-1])
    warp[..., :shared] = reference.warp[..., :shared]
    return reference._replace(warp=warp)


def merged(found: FoundPoints, better: FoundPoints) -> FoundPoints:
    """The points of ``found``, replaced by those of ``better`` where these have a value."""
    pairs: Iterable[tuple[Any, Any]] = zip(found, better, strict=True)
    return FoundPoints._make(np.where(_broadcast_mask(better.valid, new), new, old) for old, new in pairs)


def carried_points(found: FoundPoints, grid: Array, points: Array) -> Array:
    """Where points (n, 2) of the first photograph are, by the motion of the material points around them [px].

    grid : (rows, cols, 2) — the material points in the first photograph; NaN for those that do not count
    Returns NaN with too few valid material points.
    """
    return carried_motion(found, grid, points)[..., 0]


def carried_motion(found: FoundPoints, grid: Array, points: Array) -> Array:
    """Affine warps (n, 2, 3) of points (n, 2) of the first photograph, as :func:`carried_points`."""
    valid = found.valid & all_finite(grid)
    if valid.sum() < MIN_POINTS_FOR_MOTION or len(points) == 0:
        return np.full((*points.shape, 3), np.nan)
    return warp_from_gradient(*local_motion(grid[valid], found.warp[..., 0][valid], points))


def carried_outline(
    start: Sequence[Polygon], last: Sequence[Polygon], found: FoundPoints, parts: Parts
) -> Sequence[Polygon]:
    """Polygons of the first photograph, each carried by the points in it; as in ``last`` where these are too few.

    A corner moves with points on its own side of a cut.
    """
    separate = len(start) > 1
    polygon = enclosing(start, parts.places) if separate else all_finite(parts.places).astype(np.int32)
    outline = []
    for number, (before, kept) in enumerate(zip(start, last, strict=True), start=1):
        places = np.where((polygon == number)[..., None], parts.places, np.nan)
        if (found.valid & (polygon == number)).sum() < MIN_POINTS_FOR_MOTION:
            outline.append(kept)
        else:
            outline += carry([before], partial(_carried_ring, found, places, parts.cuts))
    return outline


def _carried_ring(found: FoundPoints, places: Array, cuts: Array, ring: Array) -> Array:
    """Corners (n, 2) of a polygon, carried by points on their own side of the cuts where these are enough."""
    carried = carried_points(found, places, ring)
    valid = found.valid & all_finite(places)
    if len(cuts) == 0 or np.isnan(carried).any():
        return carried
    source, target = places[valid], found.warp[..., 0][valid]
    for k, near in enumerate(nearest(source, ring, min(_NEAR_CORNER, len(source)))[1]):
        own = near[sees(ring[k], source[near], cuts)]
        if MIN_POINTS_FOR_MOTION <= len(own) < len(near):
            carried[k] = local_motion(source[own], target[own], ring[k : k + 1]).position[0]
    return carried


def part_masks(points: Array, parts: Parts | None) -> Iterator[Mask]:
    """Which points of a grid (rows, cols, 2) belong to each of its parts; all of them if it has a single one."""
    known = all_finite(points)
    if parts is None or parts.is_single:
        yield known
    else:
        yield from (known & (parts.number == part) for part in range(1, int(parts.number.max()) + 1))


def _broadcast_mask(mask: Mask, values: Array) -> Mask:
    """The mask with as many axes as the values."""
    return mask.reshape(mask.shape + (1,) * (values.ndim - mask.ndim))
