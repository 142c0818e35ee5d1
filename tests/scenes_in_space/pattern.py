"""Speckles in the material: one soft disc at a random place in every cell of a square lattice, in closed form."""

from __future__ import annotations

import numpy as np
from numba import njit

__all__ = ["light_of_speckles"]

_PERIOD = 512
"""Cells after which the pattern repeats itself, far beyond any specimen."""
_CELL = 1.15
"""Side of a cell over the mean diameter of a disc: 45 % of the area is dark."""
_EDGE = 0.6
"""Width of a disc's edge over the mean diameter."""


def light_of_speckles(material: np.ndarray, diameter: float) -> np.ndarray:
    """Share of light (n,) that speckled material reflects at points (n, 2) [mm]. diameter : mean of the discs [mm]"""
    return _light(np.ascontiguousarray(material / (_CELL * diameter)), _DISCS)


def _discs() -> np.ndarray:
    """Discs (row, col, 4) of the cells: x, y and radius in sides of the cell, and darkness."""
    rng = np.random.default_rng(20)
    x, y = rng.uniform(0.0, 1.0, (2, _PERIOD, _PERIOD))
    radius, darkness = rng.uniform(0.35, 0.65, x.shape) / _CELL, rng.uniform(0.75, 1.0, x.shape)
    return np.stack([x, y, radius, darkness], axis=-1)


_DISCS = _discs()


@njit(cache=True, nogil=True)
def _light(places, discs):  # type: ignore[no-untyped-def]
    """Light (n,) at places (n, 2) in sides of the cells; where discs overlap, what they let through is multiplied."""
    period, half = discs.shape[0], 0.5 * _EDGE / _CELL
    out = np.empty(len(places))
    for k in range(len(places)):
        x, y = places[k]
        col, row = int(np.floor(x)), int(np.floor(y))
        light = 1.0
        for i in range(row - 1, row + 2):
            for j in range(col - 1, col + 2):
                disc = discs[i % period, j % period]
                dx, dy, reach = x - j - disc[0], y - i - disc[1], disc[2] + half
                square = dx * dx + dy * dy
                if square < reach * reach:
                    t = min(0.5 * (reach - np.sqrt(square)) / half, 1.0)
                    light *= 1.0 - disc[3] * t * t * t * (10.0 + t * (6.0 * t - 15.0))
        out[k] = light
    return out
