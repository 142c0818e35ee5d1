"""Speckles as a marker pen makes them: soft-edged, slightly oval dots at random places, each fixed to the material."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Index

__all__ = ["Speckles", "darkness", "scatter_speckles"]


_GAP = 0.78
"""Least distance of two dots over the sum of their radii: a hand with a pen overlaps dots a little, never much."""
_TRIES_PER_DOT = 60
_PER_CELL = 32


class Speckles(NamedTuple):
    """Dots on a strip, and an index of cells to find those near a point.

    centres : (n, 2) [mm]
    shapes : (n, 3) — a, b, c of the oval a dx² + 2 b dx dy + c dy² = 1 that is a dot's edge [1/mm²]
    radii : (n,) — radius of the circle of equal area [mm]
    edge : width over which the ink fades out [mm]
    origin, cell : corner (2,) and side of the square cells of the index [mm]
    first : (rows, cols + 1) — where the dots of each cell start in ``members``; a cell ends where the next starts
    members : (m,) — dots by cell; a dot stands in every cell that it reaches
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
    """Random dots on the strip X ∈ [−W/2, W/2], Y ∈ [0, L], thrown one by one until the share ``coverage`` is dark.

    No dot reaches beyond the ends Y = 0 and Y = L, where the speckled region ends; the sides cut dots off.

    size : width W and length L [mm]
    diameter : least and greatest [mm]
    edge : width over which the ink fades out [mm]
    coverage : share of the region that is dark, overlaps counted once [-]
    elongation : greatest ratio of a dot's axes [-]
    """
    rng = np.random.default_rng([seed, 0x5BEC])
    width, length = size
    mean_area = np.pi / 12.0 * (diameter[0] ** 2 + diameter[0] * diameter[1] + diameter[1] ** 2)
    tries = int(_TRIES_PER_DOT * coverage * width * length / mean_area) + 1
    radii = rng.uniform(*diameter, tries) / 2.0
    ratios = np.sqrt(rng.uniform(1.0, elongation, tries))
    reach = radii * ratios + edge / 2.0
    centres = np.stack(
        [rng.uniform(-width / 2, width / 2, tries), reach + rng.uniform(0.0, 1.0, tries) * (length - 2.0 * reach)], -1
    )
    angles = rng.uniform(0.0, np.pi, tries)
    kept = _throw(centres, radii, np.array([-width / 2, 0.0]), diameter[1], coverage * width * length, _GAP)
    return _indexed(centres[kept], _ovals(radii, ratios, angles)[kept], radii[kept], reach[kept], edge)


def darkness(speckles: Speckles, material: ArrayLike) -> Array:
    """How much ink lies at material points (..., 2) [mm]: 0 none … 1 full, shape (...)."""
    points = np.asarray(material, dtype=float)
    return np.asarray(_darkness(speckles, points.reshape(-1, 2))).reshape(points.shape[:-1])


def _ovals(radii: Array, ratios: Array, angles: Array) -> Array:
    """Quadratic forms (n, 3) of ovals with axes radius × ratio and radius / ratio, the long one at an angle [rad]."""
    long, short = (radii * ratios) ** -2.0, (radii / ratios) ** -2.0
    c, s = np.cos(angles), np.sin(angles)
    return np.stack([long * c * c + short * s * s, (long - short) * c * s, long * s * s + short * c * c], axis=-1)


def _indexed(centres: Array, shapes: Array, radii: Array, reach: Array, edge: float) -> Speckles:
    cell = 2.0 * float(radii.max())
    origin = (centres - reach[:, None]).min(axis=0)
    low = np.floor((centres - reach[:, None] - origin) / cell).astype(np.int64)
    high = np.floor((centres + reach[:, None] - origin) / cell).astype(np.int64)
    cols, rows = high.max(axis=0) + 1
    first, members = _cells(low, high, rows, cols)
    return Speckles(centres, shapes, radii, edge, origin, cell, first, members)


@njit(cache=True, nogil=True)
def _throw(centres, radii, origin, cell, area, gap):  # type: ignore[no-untyped-def]
    """Indices of the dots that keep their distance from all before them, until their area is reached.

    A cell of side ``cell``, the greatest diameter, holds few dots, and only the nine cells around a dot matter.
    """
    spots = np.floor((centres - origin) / cell).astype(np.int64) + 1
    dots = np.full((spots[:, 1].max() + 2, spots[:, 0].max() + 2, _PER_CELL), -1)
    counts = np.zeros(dots.shape[:2], dtype=np.int64)
    kept = np.empty(len(centres), dtype=np.int64)
    n, covered = 0, 0.0
    for i in range(len(centres)):
        col, row = spots[i]
        if counts[row, col] == _PER_CELL or _crowded(i, row, col, dots, counts, centres, radii, gap):
            continue
        dots[row, col, counts[row, col]] = i
        counts[row, col] += 1
        kept[n] = i
        n += 1
        covered += np.pi * radii[i] ** 2
        if covered >= area:
            break
    return kept[:n]


@njit(cache=True, nogil=True)
def _crowded(i, row, col, dots, counts, centres, radii, gap):  # type: ignore[no-untyped-def]
    """Whether a dot thrown before lies too near to dot i."""
    for r in range(row - 1, row + 2):
        for c in range(col - 1, col + 2):
            for k in range(counts[r, c]):
                j = dots[r, c, k]
                if np.hypot(centres[i, 0] - centres[j, 0], centres[i, 1] - centres[j, 1]) < gap * (radii[i] + radii[j]):
                    return True
    return False


@njit(cache=True, nogil=True)
def _cells(low, high, rows, cols):  # type: ignore[no-untyped-def]
    """Dots by cell: their starts (rows, cols + 1) and the list of members, as a counting sort."""
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


@njit(cache=True, nogil=True)
def _ink(speckles, x, y):  # type: ignore[no-untyped-def]
    """Ink at one material point [-]; where dots overlap, the light that each lets through is multiplied."""
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


@njit(cache=True, nogil=True)
def _darkness(speckles, points):  # type: ignore[no-untyped-def]
    out = np.empty(len(points))
    for i in range(len(points)):
        out[i] = _ink(speckles, points[i, 0], points[i, 1])
    return out
