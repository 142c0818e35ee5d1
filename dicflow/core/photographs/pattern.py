"""The speckle pattern in a photograph, and checks of it: texture, exposure, and speckles per subset."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Grey, Mask
from dicflow.core.photographs.texture import MIN_TEXTURE, mean_intensity_gradient, saturated_share, speckle_size

__all__ = ["MAX_SATURATED_SHARE", "Pattern", "check_pattern", "checked_pattern", "pattern_of"]

MAX_SATURATED_SHARE = 0.25
"""Largest share of saturated pixels in the region."""
_MIN_SPECKLES_PER_SUBSET, _SPECKLES_PER_SIDE = 3.0, 3.0
"""Least number of speckles in a subset, and recommended number along its side."""


class Pattern(NamedTuple):
    """Figures of a speckle pattern; NaN for an unknown one.

    size_px : diameter of the speckles
    gradient : mean length of the grey-level gradient [grey levels of 255 per px]
    contrast : standard deviation over mean of the grey levels
    saturated : share of saturated pixels
    """

    size_px: float
    gradient: float
    contrast: float
    saturated: float


def pattern_of(image: Grey, usable: Mask) -> Pattern:
    """The pattern inside the region of a photograph.

    image : (rows, cols) grey; usable : (rows, cols) bool — the region in it, not empty
    """
    mean, deviation = (float(part[0, 0]) for part in cv2.meanStdDev(image, mask=usable.view(np.uint8)))
    contrast = deviation / max(mean, 1e-12)
    gradient, saturated = mean_intensity_gradient(image, usable), saturated_share(image, usable)
    return Pattern(speckle_size(image, usable), gradient, contrast, saturated)


def check_pattern(image: Grey, usable: Mask, name: str) -> None:
    """Raise ValueError where the region of a photograph has too little texture or is overexposed.

    image : (rows, cols) grey; usable : (rows, cols) bool — the region in it
    name : of the photograph, as in "the first left photograph"
    """
    _check_light(mean_intensity_gradient(image, usable), saturated_share(image, usable), name)


def checked_pattern(image: Grey, usable: Mask, subset_size: int, name: str) -> Pattern:
    """The pattern inside the region of a photograph, in which subsets can be distinguished.

    subset_size : side of a subset [px]; the others as in :func:`check_pattern`
    Raises ValueError as that does, and where subsets hold too few speckles.
    """
    found = pattern_of(image, usable)
    _check_light(found.gradient, found.saturated, name)
    _check_subset(found.size_px, subset_size)
    return found


def _check_light(gradient: float, saturated: float, name: str) -> None:
    if gradient < MIN_TEXTURE:
        raise ValueError(
            f"the region has too little texture in {name}: its mean intensity gradient is {gradient:.2f} grey levels "
            f"per px, expected at least {MIN_TEXTURE}; check light, exposure and focus"
        )
    if saturated > MAX_SATURATED_SHARE:
        raise ValueError(
            f"{100 * saturated:.0f} % of the region is overexposed in {name} "
            f"(limit {100 * MAX_SATURATED_SHARE:.0f} %); reduce the exposure"
        )


def _check_subset(diameter: float, subset_size: int) -> None:
    if np.isfinite(diameter) and subset_size**2 < _MIN_SPECKLES_PER_SUBSET * 0.5 * np.pi * diameter**2:
        raise ValueError(
            f"a subset of {subset_size} px holds fewer than {_MIN_SPECKLES_PER_SUBSET:.0f} speckles of "
            f"{diameter:.1f} px; use a subset_size of {int(np.ceil(_SPECKLES_PER_SIDE * diameter)) | 1} px or more"
        )
