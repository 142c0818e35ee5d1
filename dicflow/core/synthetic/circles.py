"""The grid of circles: black circles on white paper, the first centre at (0, 0), X along the rows."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array
from dicflow.core.synthetic.render import Extent

__all__ = ["CircleGrid", "circle_centres", "circle_darkness", "circle_extent"]


class CircleGrid(NamedTuple):
    """A flat grid of circles.

    columns, rows : number of circles in a row, and of rows
    spacing : distance of neighbouring rows [mm]; in a symmetric grid the circles of a row have the same distance, in
        an asymmetric one twice that, and every other row is shifted by it
    radius : of a circle [mm]
    margin : width of the white paper around the circles' centres [mm]
    edge : width of the transition from black to white [mm]
    """

    columns: int = 9
    rows: int = 6
    spacing: float = 14.5
    radius: float = 4.5
    asymmetric: bool = False
    margin: float = 15.0
    edge: float = 0.12


def circle_centres(grid: CircleGrid) -> Array:
    """Centres (rows, columns, 2) on the grid's plane [mm]."""
    column, row = np.meshgrid(np.arange(grid.columns), np.arange(grid.rows))
    across = 2 * column + row % 2 if grid.asymmetric else column
    return grid.spacing * np.stack([across, row], axis=-1).astype(float)


def circle_extent(grid: CircleGrid) -> Extent:
    """Extent of the paper [mm]."""
    right, bottom = circle_centres(grid).reshape(-1, 2).max(axis=0) + grid.margin
    return Extent(-grid.margin, float(right), -grid.margin, float(bottom))


def circle_darkness(grid: CircleGrid, points: ArrayLike) -> Array:
    """Darkness (...) of points (..., 2) of the grid [mm]: 0 white … 1 black, ½ on the circles' edges."""
    x, y = np.moveaxis(np.asarray(points, dtype=float) / grid.spacing, -1, 0)
    above = np.floor(y)
    distance = np.minimum(
        _distance_to_nearest_in_row(grid, x, y, above), _distance_to_nearest_in_row(grid, x, y, above + 1.0)
    )
    t = np.clip(0.5 + (grid.radius - grid.spacing * distance) / grid.edge, 0.0, 1.0)
    return np.asarray(t * t * (3.0 - 2.0 * t))


def _distance_to_nearest_in_row(grid: CircleGrid, x: Array, y: Array, row: Array) -> Array:
    """Distance from the nearest centre in a row, which is clipped to those of the grid, in spacings."""
    row = np.clip(row, 0, grid.rows - 1)
    pitch, start = (2.0, row % 2) if grid.asymmetric else (1.0, np.zeros_like(row))
    column = np.clip(np.round((x - start) / pitch), 0, grid.columns - 1)
    return np.asarray(np.hypot(x - start - pitch * column, y - row))
