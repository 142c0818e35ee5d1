"""Patterns that repeat themselves: where a displacement looks the same as one a period longer.

The autocorrelation of a random pattern has one peak, at a shift of zero; that of a repeating one has equal peaks at its
periods. That of stripes does not fall along them, and the displacement along them cannot be measured at all.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Grey, Mask
from dicflow.core.photographs.autocorrelation import autocorrelation, overlap

__all__ = ["Repetition", "repetition"]


_BLOCK_PX, _MAX_BLOCKS_PER_SIDE = 256, 4
"""Side of the blocks of a photograph that are examined, and their greatest number along each side of the region."""
_MIN_OVERLAP = 0.25
"""Share of a block's pixels that a shift must leave in the block."""
_MAIN_PEAK, _MIN_PEAK, _EQUAL_PEAKS = 0.3, 0.4, 0.85
"""Correlation that bounds the main peak; least one of another peak; share of the highest that counts as equal."""
_MIN_SIGNIFICANCE = 5.5
"""Least height of a peak, in standard deviations of a random pattern's correlation."""
_STRIPE_REACH, _MIN_STRIPE = 0.5, 0.6
"""Shift along stripes, as a share of the greatest, beyond which the main peak still reaches the second figure."""


class Repetition(NamedTuple):
    """How a pattern repeats itself.

    period_px : least shift at which it looks the same; NaN where it does not repeat
    share : share of the examined blocks that repeat
    stripes_share : share of those that show stripes
    """

    period_px: float
    share: float
    stripes_share: float


def repetition(image: Grey, region: Mask) -> Repetition:
    """How the pattern in a region of an image repeats itself.

    image : (rows, cols) grey; region : (rows, cols) bool
    """
    found = np.array([_examine(grey, inside) for grey, inside in _blocks(image, region)]).reshape(-1, 2)
    if len(found) == 0:
        return Repetition(float("nan"), 0.0, 0.0)
    repeats, stripes = np.isfinite(found[:, 0]), found[:, 1] > 0.0
    period = float(np.median(found[repeats, 0])) if repeats.any() else float("nan")
    return Repetition(period, float(repeats.mean()), float(stripes.mean()))


def _blocks(image: Grey, region: Mask) -> Iterator[tuple[Array, Array]]:
    """Grey levels and masks of blocks that cover the region, at most so many, where they are half in it."""
    x, y, width, height = cv2.boundingRect(region.astype(np.uint8))
    for top in _firsts(y, height):
        for left in _firsts(x, width):
            part = slice(top, min(top + _BLOCK_PX, y + height)), slice(left, min(left + _BLOCK_PX, x + width))
            inside = region[part].astype(np.float64)
            if inside.size and inside.mean() >= 0.5:
                yield image[part].astype(np.float64), inside


def _firsts(start: int, length: int) -> list[int]:
    """First pixels of the blocks along a side of the region."""
    count = min(_MAX_BLOCKS_PER_SIDE, -(-length // _BLOCK_PX))
    return [int(first) for first in np.linspace(start, start + max(0, length - _BLOCK_PX), count)]


def _examine(grey: Array, inside: Array) -> tuple[float, float]:
    """The period of a block [px], NaN without one; and 1 for stripes, else 0."""
    side = max(3, max(grey.shape) // 2)
    mean = cv2.blur(grey * inside, (side, side)) / np.maximum(cv2.blur(inside, (side, side)), 1e-9)
    half = grey.shape[0] // 2, grey.shape[1] // 2
    correlation, common = autocorrelation((grey - mean) * inside, half), overlap(inside, half)
    enough = common >= _MIN_OVERLAP * inside.sum()
    correlation = np.where(enough, correlation / np.maximum(common, 1.0), 0.0)
    middle = tuple(size // 2 for size in correlation.shape)
    scale = max(correlation[middle[0] + i, middle[1] + j] for i, j in ((0, 1), (1, 0)))
    if not scale > 0.0:
        return float("nan"), 0.0
    correlation /= scale
    main = cv2.connectedComponents((correlation > _MAIN_PEAK).view(np.uint8), connectivity=4)[1]
    in_main = main == main[middle]
    shift = np.hypot(*np.meshgrid(*(np.arange(size) - size // 2 for size in correlation.shape), indexing="ij"))
    along = in_main & (shift > _STRIPE_REACH * shift[enough].max())
    is_striped = along.any() and correlation[along].max() > _MIN_STRIPE
    return _period(np.where(in_main | ~enough, 0.0, correlation), common, in_main, shift), float(is_striped)


def _period(beside: Array, common: Array, in_main: Mask, shift: Array) -> float:
    """The period [px] by the peaks of the autocorrelation beside the main one, for shifts [px]; NaN without any."""
    independent = common / max(1.0, float(in_main.sum()))
    high = (beside > _MIN_PEAK) & (beside * np.sqrt(np.maximum(independent, 0.0)) > _MIN_SIGNIFICANCE)
    if not high.any():
        return float("nan")
    kept = np.where(
        high, beside, 0.0
    )  # the highest of these is a peak, even beside a higher one that is not significant
    is_peak = high & (kept >= _EQUAL_PEAKS * kept.max()) & (kept == cv2.dilate(kept, np.ones((3, 3), dtype=np.uint8)))
    return float(shift[is_peak].min())
