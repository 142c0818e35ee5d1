"""Windows on a grid whose parts move on their own: none reaches from one part into another.

A window that holds points of several parts is cut out with the points of its centre's part alone, and fitted again.
"""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.kernels import KERNEL
from dicflow.core.parts import Parts, are_apart
from dicflow.core.surfaces.filters import local_polynomial

__all__ = ["Tiles", "mixed_windows", "smooth_parts"]


_CHUNK = 1000
"""Windows that are fitted at once."""


def smooth_parts(parts: Parts | None, values: Array, window: tuple[int, int], degree: int) -> Array:
    """Values (row, col, k) of local polynomials, part by part; the parameters are those of ``local_polynomial``."""
    smooth = local_polynomial(values, window, degree).value
    for tiles in mixed_windows(parts, np.asarray(np.isfinite(values).all(axis=-1)), window):
        smooth[tiles.centres] = tiles.centres_of(local_polynomial(tiles.cut_out(values), window, degree).value)
    return smooth


def mixed_windows(parts: Parts | None, known: Mask, window: tuple[int, int]) -> Iterator[Tiles]:
    """The windows around known points (rows, cols) that hold points apart from their centres, some at a time."""
    if parts is None:
        return
    centres = _mixed_centres(parts, known, window)
    for first in range(0, len(centres), _CHUNK):
        yield Tiles(parts, centres[first : first + _CHUNK], window)


def _mixed_centres(parts: Parts, known: Mask, window: tuple[int, int]) -> Index:
    """Known points (n, 2), row and column, whose window may hold points that are apart from them."""
    if parts.is_single:
        return np.zeros((0, 2), dtype=np.int64)
    box, number = np.ones(window, dtype=np.uint8), parts.number.astype(np.float32)
    highest = cv2.dilate(number, box, borderType=cv2.BORDER_CONSTANT, borderValue=0.0)
    lowest = cv2.erode(np.where(number > 0, number, np.float32(np.inf)), box, borderType=cv2.BORDER_REPLICATE)
    near_cut = np.zeros(known.shape, dtype=np.bool_)
    steps = [np.nanmax(np.abs(np.diff(parts.places[..., axis], axis=1 - axis)), initial=0.0) for axis in (0, 1)]
    reach = 0.5 * np.hypot(window[0] * steps[1], window[1] * steps[0])
    for cut in parts.cuts:
        near_cut |= _distance(parts.places, cut) <= reach
    return np.argwhere(known & (parts.number > 0) & ((highest != lowest) | near_cut))


def _distance(places: Array, cut: Array) -> Array:
    """Distance of places (..., 2) from a straight piece (4,) of a cut [px]; infinite where unknown."""
    start, along = cut[:2], cut[2:] - cut[:2]
    share = np.clip((places - start) @ along / max(float(along @ along), 1e-12), 0.0, 1.0)
    away = np.linalg.norm(places - start - share[..., None] * along, axis=-1)
    return np.asarray(np.where(np.isnan(away), np.inf, away))


class Tiles:
    """Windows cut out of a grid and laid below one another, without the points that are apart from their centres.

    centres : (n, 2) — row and column
    """

    def __init__(self, parts: Parts, centres: Index, window: tuple[int, int]) -> None:
        high, wide = window
        self.centres = centres[:, 0], centres[:, 1]
        self._rows, self._cols = np.broadcast_arrays(
            centres[:, 0, None, None] + np.arange(high)[:, None] - high // 2,
            centres[:, 1, None, None] + np.arange(wide) - wide // 2,
        )
        rows, cols = parts.number.shape
        inside = (self._rows >= 0) & (self._rows < rows) & (self._cols >= 0) & (self._cols < cols)
        self._rows, self._cols = np.clip(self._rows, 0, rows - 1), np.clip(self._cols, 0, cols - 1)
        self._own = inside & _own_points(parts, centres, self._rows, self._cols)
        self._middle = np.arange(len(centres)) * high + high // 2, wide // 2

    def cut_out(self, values: Array) -> Array:
        """The tiles of a field (row, col, …) as one field."""
        own = self._own.reshape(self._own.shape + (1,) * (values.ndim - 2))
        tiles = np.where(own, values[self._rows, self._cols], np.nan)
        return np.asarray(tiles.reshape(-1, *tiles.shape[2:]), dtype=np.float64)

    def centres_of(self, values: Array) -> Array:
        """The values (n, …) of a field of tiles at the centres."""
        return np.asarray(values[self._middle])


@njit(**KERNEL)
def _own_points(parts: Parts, centres: Index, rows: Index, cols: Index) -> Mask:
    """Which points (n, high, wide) of windows are not apart from their centres."""
    own = np.zeros(rows.shape, dtype=np.bool_)
    for n in range(rows.shape[0]):
        for i in range(rows.shape[1]):
            for j in range(rows.shape[2]):
                own[n, i, j] = not are_apart(parts, centres[n, 0], centres[n, 1], rows[n, i, j], cols[n, i, j])
    return own
