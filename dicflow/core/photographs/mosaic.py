"""Raw mosaics: grey levels of which neighbours were seen through filters of different colours (B. E. Bayer, 1976).

In every square of 2 × 2 pixels two on a diagonal are green, the others red and blue. On a grey specimen the four
sub-lattices then show one picture at different brightness: the greens alike, red and blue each by a factor of its own.
In a photograph without filters all four are alike, since each shows the same picture half a pixel aside.
"""

from __future__ import annotations

import math

import numpy as np

from dicflow.core.arrays import Array, Grey

__all__ = ["colour_filters", "filter_contrast"]

MIN_CONTRAST = 0.05
"""Least relative difference of red and of blue from green that counts as a mosaic; sharp photographs reach 0.008."""
_TILE_PX, _MOST_TILES, _LEAST_TILES = 48, 100, 12
_DARK = 0.1
"""Tiles below this share of the brightest one's mean say nothing."""
_SHARE_ALIKE = 0.9
"""The share of the tiles in which red and blue must lie on one side of green."""
_ALIKE = 0.5
"""Greatest difference of the greens, and of pixels behind filters of one colour, as a share of the contrast."""
_SAME_PICTURE, _DETAILED = 0.25, 0.1
"""Least correlation of the details that two sub-lattices show, and in which share of the tiles there are details."""
_OTHER_PERIODS = (4, 6, 8)
"""Periods [px] of printed dots and boards, whose harmonics may look like a period of 2 px."""
_FILTERS = ("RGGB or BGGR", "GRBG or GBRG")


def colour_filters(grey: Grey) -> str | None:
    """The arrangement of the colour filters that a photograph (row, col) shows; None for one without."""
    return next((name for k, name in enumerate(_FILTERS) if filter_contrast(grey, k) > MIN_CONTRAST), None)


def filter_contrast(grey: Grey, arrangement: int) -> float:
    """How much red and blue differ from green, the smaller of both relative differences; 0 if it is not a mosaic.

    arrangement : 0 where the first pixel of the first row is red or blue, 1 where it is green
    """
    logs = _tile_logs(grey, 2)
    if len(logs) < _LEAST_TILES:
        return 0.0
    square = logs[:, :, ::-1] if arrangement else logs
    green = square[:, [0, 1], [1, 0]]
    others = square[:, [0, 1], [0, 1]] - green.mean(axis=1, keepdims=True)
    typical = np.median(others, axis=0)
    contrast = float(np.abs(typical).min())
    one_sided = np.mean(others * np.sign(typical) > 0, axis=0).min() >= _SHARE_ALIKE
    greens_alike = np.median(np.abs(green[:, 0] - green[:, 1])) < _ALIKE * contrast
    if not (contrast > 0 and one_sided and greens_alike):
        return 0.0
    longer = max(_longer_period(grey, period) for period in _OTHER_PERIODS)
    return contrast if longer < _ALIKE * contrast and _show_one_picture(grey) else 0.0


def _show_one_picture(grey: Grey) -> bool:
    """Whether the four sub-lattices show the same details: printed dots of 2 px, or a board of 1 px, have none."""
    tiles = _tiles(grey).swapaxes(1, 2).reshape(-1, _TILE_PX // 2, 2, _TILE_PX // 2, 2).astype(float)
    details = tiles - tiles.mean(axis=(1, 3), keepdims=True)
    covariance = np.einsum("tiajb,ticjd->tabcd", details, details).reshape(-1, 4, 4)
    variance = np.einsum("tkk->tk", covariance)
    scale = np.sqrt(variance[:, :, None] * variance[:, None, :])
    correlation = np.divide(covariance, scale, out=np.zeros_like(scale), where=scale > 0)
    return bool(np.quantile(correlation.min(axis=(1, 2)), 1.0 - _DETAILED) > _SAME_PICTURE)


def _longer_period(grey: Grey, period: int) -> float:
    """How much pixels that are ``period`` px apart differ from others 2 px apart, where all tiles agree."""
    logs = _tile_logs(grey, period)
    by_two = logs.reshape(len(logs), period // 2, 2, period // 2, 2)
    differences = by_two - by_two.mean(axis=(1, 3), keepdims=True)
    return float(np.abs(np.median(differences, axis=0)).max(initial=0.0))


def _tile_logs(grey: Grey, period: int) -> Array:
    """Logarithms of means over pixels that are ``period`` px apart, (tile, row, col), of tiles over a photograph."""
    tiles, count = _tiles(grey), _TILE_PX // period
    parts = tiles.reshape(tiles.shape[0], count, period, tiles.shape[2], count, period)
    sums = parts.sum(axis=1, dtype=np.uint32).sum(axis=3)  # of integers, so that they are exact in any order
    means = (sums / count**2).transpose(0, 2, 1, 3).reshape(-1, period, period)
    lit = means.mean(axis=(1, 2)) > _DARK * means.max(initial=1.0)
    logs: Array = np.log(np.maximum(means[lit], 1e-3))
    return logs


def _tiles(grey: Grey) -> Grey:
    """Squares (row of tiles, row, column of tiles, col) spread over a photograph."""
    rows, cols = (side // _TILE_PX for side in grey.shape)
    every = max(1, math.ceil(math.sqrt(rows * cols / _MOST_TILES)))
    whole = grey[: rows * _TILE_PX, : cols * _TILE_PX].reshape(rows, _TILE_PX, cols, _TILE_PX)
    return whole[::every, :, ::every]
