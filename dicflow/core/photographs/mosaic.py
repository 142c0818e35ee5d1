"""Raw mosaics: grey levels of which neighbours were seen through filters of different colours (B. E. Bayer, 1976).

In every square of 2 × 2 pixels two on a diagonal are green, the others red and blue. On a grey specimen the four
sub-lattices then show one picture at different brightness: the greens alike, red and blue each by a factor of its own.
In a photograph without filters all four are alike, since each shows the same picture half a pixel aside.
"""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Array, Grey

__all__ = ["colour_filters", "filter_contrast"]

MIN_CONTRAST = 0.05
"""Least relative difference of red and of blue from green that counts as a mosaic. Real photographs reach 0.004."""
_TILE_PX, _MOST_TILES, _LEAST_TILES = 32, 1024, 16
_DARK = 0.02
"""Tiles below this share of the brightest one's mean say nothing."""
_SHARE_ALIKE = 0.9
"""The share of the tiles in which red and blue must lie on one side of green."""
_GREENS_ALIKE = 0.5
"""Greatest difference of the greens, as a share of the contrast."""
_FILTERS = ("RGGB or BGGR", "GRBG or GBRG")


def colour_filters(grey: Grey) -> str | None:
    """The arrangement of the colour filters that a photograph (row, col) shows; None for one without."""
    found = {name: filter_contrast(grey, k) for k, name in enumerate(_FILTERS)}
    best = max(found, key=lambda name: found[name])
    return best if found[best] > MIN_CONTRAST else None


def filter_contrast(grey: Grey, arrangement: int) -> float:
    """How much red and blue differ from green, the smaller of both relative differences; 0 if it is not a mosaic.

    arrangement : 0 where the first pixel of the first row is red or blue, 1 where it is green
    """
    logs = _tile_logs(grey)
    if len(logs) < _LEAST_TILES:
        return 0.0
    if arrangement:
        logs = logs[:, :, ::-1]
    green = logs[:, [0, 1], [1, 0]]
    others = logs[:, [0, 1], [0, 1]] - green.mean(axis=1, keepdims=True)
    typical = np.median(others, axis=0)
    contrast = float(np.abs(typical).min())
    one_sided = np.mean(others * np.sign(typical) > 0, axis=0).min() >= _SHARE_ALIKE
    greens_alike = np.median(np.abs(green[:, 0] - green[:, 1])) < _GREENS_ALIKE * contrast
    return contrast if one_sided and greens_alike and np.ptp(typical) > _GREENS_ALIKE * MIN_CONTRAST else 0.0


def _tile_logs(grey: Grey) -> Array:
    """Logarithms of the means of the four sub-lattices, (tile, row, col), over tiles spread over a photograph."""
    rows, cols = (side // _TILE_PX for side in grey.shape)
    if not rows * cols:
        return np.zeros((0, 2, 2))
    every = max(1, int(np.sqrt(rows * cols / _MOST_TILES)))
    cut = grey[: rows * _TILE_PX, : cols * _TILE_PX].reshape(rows, _TILE_PX, cols, _TILE_PX)[::every, :, ::every]
    halves = cut.reshape(*cut.shape[:1], _TILE_PX // 2, 2, cut.shape[2], _TILE_PX // 2, 2)
    means = halves.mean(axis=(1, 4)).transpose(0, 2, 1, 3).reshape(-1, 2, 2)
    lit = means.min(axis=(1, 2)) > _DARK * means.max(initial=1.0)
    logs: Array = np.log(means[lit])
    return logs
