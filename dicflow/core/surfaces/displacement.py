"""Displacement of one increment, from points or transforms in the images and the clouds of both steps.

``material_increment`` gives the vectors between the positions of material points. ``thesis_increment`` is the
definition of the thesis (§3.2.8), kept for comparison: its horizontal and vertical components both contain the whole
change of depth, and its grid is one of pixels of the deformed state, not of material points.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dicflow.core.arrays import Array, Codes, Mask
from dicflow.core.matching.transform import apply_transform
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import bounding_box, contains
from dicflow.core.status import Status
from dicflow.core.surfaces.filters import Filled, fill_moving_mean

__all__ = [
    "Cloud",
    "Increment",
    "bilinear",
    "fill_cells",
    "material_increment",
    "resize",
    "resize_codes",
    "thesis_increment",
]


WINDOW_PX = 3
"""Side of the thesis's windows and of the cells of its grid [px]."""
_FILL_WINDOW_PX = 20


class Cloud(NamedTuple):
    """Points in space of a rectangle of pixels.

    xyz : (row, col, 3) [mm]; NaN where missing
    status : (row, col)
    origin : (x, y) of element [0, 0] [px]
    """

    xyz: NDArray[np.floating]
    status: Codes
    origin: tuple[float, float]


class Increment(NamedTuple):
    """Motion from the step before to this one, on a grid; NaN where unknown.

    xy : (row, col, 2) — position in the image at this step [px]
    xyz_reference, xyz : (row, col, 3) — position in space at the step before and at this step [mm; px without clouds]
    displacement : (row, col, 3) [mm; px without clouds]
    status : (row, col)
    """

    xy: Array
    xyz_reference: Array
    xyz: Array
    displacement: Array
    status: Codes


def bilinear(field: ArrayLike, points: Array, origin: tuple[float, float] = (0.0, 0.0)) -> Array:
    """Values of a field at points, interpolated between the four neighbouring pixels.

    field : (row, col, k)
    points : (..., 2) — (x, y) [px]
    origin : (x, y) of element [0, 0] [px]
    Returns (..., k) float64; NaN outside the field, and where a neighbour with a weight above 0 is NaN.
    """
    values = np.asarray(field)
    rows, cols = values.shape[:2]
    place = points - np.asarray(origin, dtype=np.float64)
    inside: Mask = np.asarray(((place >= 0.0) & (place <= (cols - 1.0, rows - 1.0))).all(axis=-1))
    place = np.where(inside[..., None], place, 0.0)
    corner = np.minimum(place.astype(np.int64), np.maximum([cols - 2, rows - 2], 0))
    (col, row), (u, v) = np.moveaxis(corner, -1, 0), np.moveaxis(place - corner, -1, 0)
    total = np.zeros((*points.shape[:-1], values.shape[2]))
    for down, across in ((0, 0), (0, 1), (1, 0), (1, 1)):
        weight = ((v if down else 1.0 - v) * (u if across else 1.0 - u))[..., None]
        neighbour = values[np.minimum(row + down, rows - 1), np.minimum(col + across, cols - 1)]
        total += np.where(weight > 0.0, weight * neighbour, 0.0)
    total[~inside] = np.nan
    return total


def resize(field: Array, shape: tuple[int, int]) -> Array:
    """Resample a field (row, col, k) to another number of rows and columns; the outer borders stay the same.

    Bilinear between the four neighbours, or between the known ones where these have at least half of the weight, so
    that repeated resampling does not shrink a field with an irregular border. A point with any NaN is unknown.
    """
    y, x = (
        np.clip((np.arange(new) + 0.5) * old / new - 0.5, 0.0, old - 1.0)
        for new, old in zip(shape, field.shape[:2], strict=True)
    )
    places = np.stack(np.meshgrid(x, y), axis=-1)
    known = np.isfinite(field).all(axis=2, keepdims=True)
    weight = bilinear(known.astype(np.float64), places)
    total = bilinear(np.where(known, field, 0.0), places)
    return np.where(weight >= 0.5, total / np.maximum(weight, 0.5), np.nan)


def resize_codes(codes: Codes, shape: tuple[int, int]) -> Codes:
    """Resample codes (row, col) as :func:`resize` does a field, each point from its nearest neighbour."""
    row, col = (
        ((np.arange(new) + 0.5) * old / new).astype(np.int64) for new, old in zip(shape, codes.shape, strict=True)
    )
    return codes[np.ix_(row, col)]


def fill_cells(field: Array, inside: Mask) -> Filled:
    """Fill missing cells (row, col, k) of the thesis's grid by five passes of a moving mean over 20 px.

    inside : (row, col) — cells to fill
    """
    return fill_moving_mean(field, round(_FILL_WINDOW_PX / WINDOW_PX), 5, inside)


def material_increment(
    before: Array, after: Array, status: Codes, cloud_before: Cloud | None = None, cloud: Cloud | None = None
) -> Increment:
    """Displacement vectors of material points.

    before, after : (row, col, 2) — the points in the image at the two steps [px]
    status : (row, col) — of the points
    cloud_before, cloud : of the two steps; without them the result is in pixels with z = 0
    """
    reference, code_before = _points_in_space(before, cloud_before)
    xyz, code = _points_in_space(after, cloud)
    displacement = xyz - reference
    worst = np.maximum(np.maximum(status, code_before), code)
    known: Mask = np.asarray(np.isfinite(displacement).all(axis=-1))
    xy, reference, xyz, displacement = (
        np.where(known[..., None], field, np.nan) for field in (after, reference, xyz, displacement)
    )
    code = np.where(known, np.minimum(worst, Status.FILLED), np.maximum(worst, Status.OUTSIDE)).astype(np.uint8)
    return Increment(xy, reference, xyz, displacement, code)


def thesis_increment(
    transforms: Array,
    region_before: Sequence[Polygon],
    region: Sequence[Polygon],
    cloud_before: Cloud | None = None,
    cloud: Cloud | None = None,
) -> Increment:
    """Displacement as the thesis defines it, on the centres of equal cells that fill the deformed region's box.

    The box of the region at the step before is divided into subsets, and these into windows of 3 × 3 px, the size of
    the cells. The centre of a window moves by the transform of its subset. Its displacement dx = ±√(Δx² + Δz²),
    dy = ±√(Δy² + Δz²), with the signs of Δx and Δy, belongs to the cell at its end. The mean is taken where a cell has
    several; cells without any are filled from their neighbours.

    transforms : (subset_row, subset_col, 3, 3)
    region_before, region : at the two steps [px]
    cloud_before, cloud : of the two steps; without them the result is (Δx, Δy, 0) in pixels

    The third component is Δz. ``xyz_reference`` is the cloud of the step before, stretched from its box to that of this
    step, as the strain of the thesis needs it. Clouds are interpolated between pixels; the thesis's script takes the
    nearest pixel.
    """
    centres, moved = _moved_windows(transforms, region_before)
    before, after = _points_in_space(centres, cloud_before)[0], _points_in_space(moved, cloud)[0]
    motion = after - before
    signed = np.copysign(np.hypot(motion[:, :2], motion[:, 2:]), motion[:, :2])
    box_before, box = np.array(bounding_box(region_before)), np.array(bounding_box(region))
    grid = _cell_centres(box)
    means = _cell_means(np.concatenate([signed, motion[:, 2:]], axis=1), moved, grid)
    inside = contains(region, grid)
    means[~inside] = np.nan
    filled = fill_cells(means, inside)
    missing = np.isnan(filled.values).any(axis=-1)
    status = np.where(filled.filled, Status.FILLED, np.where(missing, Status.OUTSIDE, Status.VALID))
    status[missing & inside] = Status.UNTRACKED
    scale = (box_before[2:] - box_before[:2]) / (box[2:] - box[:2])
    reference = _points_in_space(box_before[:2] + (grid - box[:2]) * scale, cloud_before)[0]
    xyz = _points_in_space(grid, cloud)[0]
    return Increment(grid, reference, xyz, filled.values, status.astype(np.uint8))


def _points_in_space(points: Array, cloud: Cloud | None) -> tuple[Array, Codes]:
    """Points in space (..., 3) at points (..., 2) of the image, and the highest status of the pixels around them.

    Without a cloud, the points themselves with z = 0, and VALID.
    """
    if cloud is None:
        flat = np.where(np.isnan(points[..., :1]), np.nan, 0.0)
        return np.concatenate([points, flat], axis=-1), np.zeros(points.shape[:-1], np.uint8)
    return bilinear(cloud.xyz, points, cloud.origin), _worst_neighbour(cloud.status, points, cloud.origin)


def _worst_neighbour(status: Codes, points: Array, origin: tuple[float, float]) -> Codes:
    """Highest code of the pixels around each point (..., 2); OUTSIDE where one of them is beyond the field."""
    rows, cols = status.shape
    place = np.nan_to_num(points - np.asarray(origin, dtype=np.float64), nan=-1.0)
    low, high = np.floor(place).astype(np.int64), np.ceil(place).astype(np.int64)
    inside: Mask = np.asarray(((low >= 0) & (high < (cols, rows))).all(axis=-1))
    (left, top), (right, bottom) = (np.moveaxis(np.where(inside[..., None], c, 0), -1, 0) for c in (low, high))
    around = [status[row, col] for row in (top, bottom) for col in (left, right)]
    return np.where(inside, np.max(around, axis=0), np.uint8(Status.OUTSIDE))


def _moved_windows(transforms: Array, region: Sequence[Polygon]) -> tuple[Array, Array]:
    """Centres (n, 2) of the windows inside a region, before and after the transforms of their subsets [px]."""
    rows, cols = transforms.shape[:2]
    x0, y0, x1, y1 = bounding_box(region)
    centres, moved = [], []
    for row, top in enumerate(np.linspace(y0, y1, rows + 1)[:-1]):
        for col, left in enumerate(np.linspace(x0, x1, cols + 1)[:-1]):
            x = np.arange(left, left + (x1 - x0) / cols, WINDOW_PX) + WINDOW_PX / 2.0
            y = np.arange(top, top + (y1 - y0) / rows, WINDOW_PX) + WINDOW_PX / 2.0
            points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
            points = points[contains(region, points)]
            centres.append(points)
            moved.append(apply_transform(transforms[row, col], points))
    return np.concatenate(centres), np.concatenate(moved)


def _cell_centres(box: Array) -> Array:
    """Centres (row, col, 2) of equal cells of about 3 × 3 px that fill a box (x0, y0, x1, y1) [px]."""
    x, y = (_centres(low, high) for low, high in ((box[0], box[2]), (box[1], box[3])))
    return np.stack(np.meshgrid(x, y), axis=-1)


def _centres(low: float, high: float) -> Array:
    """Centres (n,) of equal cells of about 3 px between two limits, at least two."""
    count = max(2, round((high - low) / WINDOW_PX))
    return low + (np.arange(count) + 0.5) * (high - low) / count


def _cell_means(values: Array, points: Array, grid: Array) -> Array:
    """Mean of the values (n, k) whose points (n, 2) lie in the cell around each point of the grid; NaN for empty cells.

    grid : (row, col, 2) — centres of the cells
    Returns (row, col, k).
    """
    rows, cols = grid.shape[:2]
    known = np.isfinite(values).all(axis=1) & np.isfinite(points).all(axis=1)
    cell = np.rint((points[known] - grid[0, 0]) / (grid[1, 1] - grid[0, 0])).astype(np.int64)
    inside = ((cell >= 0) & (cell < (cols, rows))).all(axis=1)
    index = cell[inside, 1] * cols + cell[inside, 0]
    count = np.bincount(index, minlength=rows * cols)
    sums = np.stack([np.bincount(index, plane, minlength=rows * cols) for plane in values[known][inside].T], axis=-1)
    means = np.where(count[:, None] > 0, sums / np.maximum(count, 1)[:, None], np.nan)
    return np.asarray(means.reshape(rows, cols, -1))
