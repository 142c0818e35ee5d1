"""Pixels of a photograph that are measured: neither clipped by the camera nor hidden.

Where light exceeds what a camera can record, all pixels get its greatest level. This pile of equal levels shows in the
histogram, at any level; likewise at level 0. A clipped pixel does not show the material's brightness,
and may stand still while the material moves.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Grey, Index, Mask
from dicflow.core.photographs.noise import image_noise
from dicflow.core.photographs.texture import saturation_level

__all__ = ["Photograph", "measured_pixels", "photograph"]


_HIDDEN_MARGIN_PX = 2
"""Width of the seam beside hidden pixels that is not measured [px]."""
_MIN_PILE, _MIN_PILE_RATIO = 8, 3.0
"""Pixels of the level at which a camera clips, at least, and their number over that of any level close to it."""
_MIN_PILE_SHARE, _MIN_RATIO_BELOW_FULL_SCALE = 1e-4, 20.0
"""The same where a camera clips below the full scale of its bits: share of all pixels, and ratio."""
_NEIGHBOUR_SHARE, _MIN_NEIGHBOURS = 1 / 256, 4
"""Levels close to another one: share of the greatest level, and least number."""
_MIN_NOISE_BELOW_FULL_SCALE = 0.5
"""Noise of the other pixels from which such a pile is a clipped one, not a plain ground without noise [grey levels]."""


class Photograph(NamedTuple):
    """Grey levels, and which of them are measured.

    grey : (rows, cols) uint8 or uint16
    measured : (rows, cols) bool — pixels that are measured; None for all
    """

    grey: Grey
    measured: Mask | None = None


def photograph(grey: Grey, shown: Mask | None = None) -> Photograph:
    """A photograph with the pixels that are measured.

    shown : (rows, cols) bool — False for pixels that do not show the scene, such as transparent ones; None for all
    """
    return Photograph(grey, measured_pixels(grey, shown))


def measured_pixels(grey: Grey, shown: Mask | None = None) -> Mask | None:
    """Pixels (rows, cols) bool that show the scene and are not clipped; None for all.

    The spline between pixels carries what hidden ones contain to their neighbours, so these are not measured either.
    """
    low, high = _clip_levels(grey)
    measured = None if shown is None else _without_margin(shown)
    for is_clipped in (grey <= low if low is not None else None, grey >= high if high is not None else None):
        if is_clipped is not None:
            measured = ~is_clipped if measured is None else measured & ~is_clipped
    return None if measured is None or measured.all() else measured


def _without_margin(shown: Mask) -> Mask:
    """Pixels farther than a margin from those that are not shown."""
    square = np.ones((2 * _HIDDEN_MARGIN_PX + 1,) * 2, dtype=np.uint8)
    return np.asarray(cv2.erode(shown.astype(np.uint8), square, borderValue=1) > 0)


def _clip_levels(grey: Grey) -> tuple[int | None, int | None]:
    """The levels at and below, and at and above which pixels are clipped; None where none are."""
    if grey.size == 0 or not np.issubdtype(grey.dtype, np.integer):
        return None, None
    count = _histogram(grey)
    step = max(1, int(np.gcd.reduce(np.flatnonzero(count))))  # of levels that were multiplied, as 8 bits by 257
    count = count[::step]
    top = len(count) - 1
    near = max(_MIN_NEIGHBOURS, int(top * _NEIGHBOUR_SHARE))
    above, below = count[1 : near + 1], count[max(0, top - near) : top]
    low = 0 if _is_pile(count[0], above) else None
    if top * step > saturation_level(grey):
        return low, top * step if _is_pile(count[top], below) else None
    clips = count[top] > _MIN_PILE_SHARE * grey.size and count[top] > _MIN_RATIO_BELOW_FULL_SCALE * below.max(initial=1)
    is_noisy = clips and image_noise(grey, grey < top * step) > _MIN_NOISE_BELOW_FULL_SCALE
    return low, top * step if is_noisy else None


def _histogram(grey: Grey) -> Index:
    """Number of pixels at each level up to the greatest."""
    if grey.dtype not in (np.uint8, np.uint16):
        return np.bincount(grey.ravel())
    levels = 2 ** (8 * grey.dtype.itemsize)
    count = cv2.calcHist([grey], [0], None, [levels], [0, levels]).ravel()
    return np.asarray(np.rint(count[: int(grey.max()) + 1]), dtype=np.int64)


def _is_pile(pixels: int, near: Grey) -> bool:
    """Whether so many pixels of one level are more than a histogram has by itself; near : those of close levels."""
    return bool(pixels >= _MIN_PILE and pixels > _MIN_PILE_RATIO * near.max(initial=0))
