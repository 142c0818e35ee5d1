"""Speckles as drawn with a marker pen: soft-edged, slightly oval dots at random places of the material."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Index
from dicflow.core.kernels import KERNEL

__all__ = ["Speckles", "darkness", "scatter_speckles"]


_MIN_DISTANCE_RATIO = 0.78
"""Least distance of two dots over the sum of their radii: dots may overlap a little."""
_CANDIDATES_PER_DOT = 60
_MAX_DOTS_PER_CELL = 32


class Speckles(NamedTuple):
    """Dots on a strip, and an index of cells for the search of the dots near a point.

    centres : (n, 2) [mm]
    shapes : (n, 3) — a, b, c of a dot's edge a dx² + 2 b dx dy + c dy² = 1 [1/mm²]
    radii : (n,) — radius of the circle of equal area [mm]
    edge : width of the transition from black to white [mm]
    origin, cell : corner (2,) and side of the square cells of the index [mm]
    first : (rows, cols + 1) — index of the first dot of each cell in ``members``; the next cell's is its end
    members : (m,) — dots by cell; a dot belongs to every cell that it reaches
    """

    centres: Array
    shapes: Array
    radii: Array
    edge: float
    origin: Array
    cell: float
    first: Index
    members: Index


def scatter_speckles(
    size: tuple[float, float],
    diameter: tuple[float, float],
    edge: float,
    coverage: float = 0.45,
    elongation: float = 1.35,
    seed: int = 0,
) -> Speckles:
    """Random dots on the strip X ∈ [−W/2, W/2], Y ∈ [0, L], added one by one until the share ``coverage`` is dark.

    Dots do not reach beyond the ends Y = 0 and Y = L of the speckled region; at the sides they are cut off.

    size : width W and length L [mm]
    diameter : least and greatest [mm]
    edge : width of the transition from black to white [mm]
    coverage : total area of the dots over that of the region [-]
    elongation : greatest ratio of a dot's axes [-]
    """
    rng = np.random.default_rng([seed, 0x5BEC])
    width, length = size
    mean_area = np.pi / 12.0 * (diameter[0] ** 2 + diameter[0] * diameter[1] + diameter[1] ** 2)
    candidates = int(_CANDIDATES_PER_DOT * coverage * width * length / mean_area) + 1
    radii = rng.uniform(*diameter, candidates) / 2.0
    ratios = np.sqrt(rng.uniform(1.0, elongation, candidates))
    reach = radii * ratios + edge / 2.0
    centres = np.stack(
        [
            rng.uniform(-width / 2, width / 2, candidates),
            reach + rng.uniform(0.0, 1.0, candidates) * (length - 2.0 * reach),
        ],
        -1,
    )
    angles = rng.uniform(0.0, np.pi, candidates)
    kept = _select_dots(
        centres, radii, np.array([-width / 2, 0.0]), diameter[1], coverage * width * length, _MIN_DISTANCE_RATIO
    )
    return _indexed(centres[kept], _oval_shapes(radii, ratios, angles)[kept], radii[kept], reach[kept], edge)


def darkness(speckles: Speckles, material: ArrayLike) -> Array:
    """Darkness (...) of material points (..., 2) [mm]: 0 white … 1 black."""
    points = np.asarray(material, dtype=float)
    return np.asarray(_darkness_at(speckles, points.reshape(-1, 2))).reshape(points.shape[:-1])


def _oval_shapes(radii: Array, ratios: Array, angles: Array) -> Array:
    """Shapes (n, 3) of ovals with semi-axes radius × ratio and radius / ratio, the longer one at an angle [rad]."""
    long, short = (radii * ratios) ** -2.0, (radii / ratios) ** -2.0
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([long * c * c + short * s * s, (long - short) * c * s, long * s * s + short * c * c], axis=-1)


def _indexed(centres: Array, shapes: Array, radii: Array, reach: Array, edge: float) -> Speckles:
    """Speckles with their index of cells; reach : (n,) — greatest distance of a dot's ink from its centre."""
    cell = 2.0 * float(radii.max())
    origin = (centres - reach[:, None]).min(axis=0)
    low = np.floor((centres - reach[:, None] - origin) / cell).astype(np.int64)
    high = np.floor((centres + reach[:, None] - origin) / cell).astype(np.int64)
    cols, rows = high.max(axis=0) + 1
    first, members = _dots_by_cell(low, high, rows, cols)
    return Speckles(centres, shapes, radii, edge, origin, cell, first, members)


@njit(**KERNEL)
def _select_dots(centres: Array, radii: Array, origin: Array, cell: float, area: float, gap: float) -> Index:
    """Indices of dots that keep their distance from all selected before, until they cover an area.

    A dot is compared with those in the nine cells around it; a cell's side is the greatest diameter.
    """
    spots = np.floor((centres - origin) / cell).astype(np.int64) + 1
    dots = np.full((spots[:, 1].max() + 2, spots[:, 0].max() + 2, _MAX_DOTS_PER_CELL), -1)
    counts = np.zeros(dots.shape[:2], dtype=np.int64)
    kept = np.empty(len(centres), dtype=np.int64)
    n, covered = 0, 0.0
    for i in range(len(centres)):
        col, row = spots[i]
        if counts[row, col] == _MAX_DOTS_PER_CELL or _is_too_near(i, row, col, dots, counts, centres, radii, gap):
            continue
        dots[row, col, counts[row, col]] = i
        counts[row, col] += 1
        kept[n] = i
        n += 1
        covered += np.pi * radii[i] ** 2
        if covered >= area:
            break
    return kept[:n]


@njit(**KERNEL)
def _is_too_near(
    i: int, row: int, col: int, dots: Index, counts: Index, centres: Array, radii: Array, gap: float
) -> bool:
    """Whether dot i in cell (row, col) is too near to a selected dot.

    dots : (rows, cols, 32) — selected dots by cell; counts : (rows, cols) — their numbers
    """
    for r in range(row - 1, row + 2):
        for c in range(col - 1, col + 2):
            for k in range(counts[r, c]):
                j = dots[r, c, k]
                if np.hypot(centres[i, 0] - centres[j, 0], centres[i, 1] - centres[j, 1]) < gap * (radii[i] + radii[j]):
                    return True
    return False


@njit(**KERNEL)
def _dots_by_cell(low: Index, high: Index, rows: int, cols: int) -> tuple[Index, Index]:
    """``first`` and ``members`` of :class:`Speckles`, by a counting sort.

    low, high : (n, 2) — first and last cell (x, y) that each dot reaches
    """
    counts = np.zeros(rows * cols + 1, dtype=np.int64)
    for i in range(len(low)):
        for r in range(low[i, 1], high[i, 1] + 1):
            for c in range(low[i, 0], high[i, 0] + 1):
                counts[r * cols + c + 1] += 1
    starts = np.cumsum(counts)
    members = np.empty(starts[-1], dtype=np.int64)
    filled = starts.copy()
    for i in range(len(low)):
        for r in range(low[i, 1], high[i, 1] + 1):
            for c in range(low[i, 0], high[i, 0] + 1):
                members[filled[r * cols + c]] = i
                filled[r * cols + c] += 1
    first = np.empty((rows, cols + 1), dtype=np.int64)
    for r in range(rows):
        first[r] = starts[r * cols : (r + 1) * cols + 1]
    return first, members


@njit(**KERNEL)
def _ink(speckles: Speckles, x: float, y: float) -> float:
    """Darkness of one material point, 0 … 1; where dots overlap, their transmissions 1 − darkness are multiplied."""
    col = int(np.floor((x - speckles.origin[0]) / speckles.cell))
    row = int(np.floor((y - speckles.origin[1]) / speckles.cell))
    rows, cols = speckles.first.shape[0], speckles.first.shape[1] - 1
    if row < 0 or col < 0 or row >= rows or col >= cols:
        return 0.0
    light = 1.0
    for k in range(speckles.first[row, col], speckles.first[row, col + 1]):
        i = speckles.members[k]
        dx, dy = x - speckles.centres[i, 0], y - speckles.centres[i, 1]
        shape = speckles.shapes[i]
        form = shape[0] * dx * dx + 2.0 * shape[1] * dx * dy + shape[2] * dy * dy
        fade = 0.5 * speckles.edge / speckles.radii[i]
        if form >= (1.0 + fade) ** 2:
            continue
        if form <= max(1.0 - fade, 0.0) ** 2:
            return 1.0
        inside = 0.5 + 0.5 * (1.0 - np.sqrt(form)) / fade
        light *= 1.0 - inside * inside * (3.0 - 2.0 * inside)
    return 1.0 - light


@njit(**KERNEL)
def _darkness_at(speckles: Speckles, points: Array) -> Array:
    """Darkness (n,) of material points (n, 2)."""
    out = np.empty(len(points))
    for i in range(len(points)):
        out[i] = _ink(speckles, points[i, 0], points[i, 1])
    return out
