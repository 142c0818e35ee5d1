"""Whether a photograph shows a pattern that subsets can be told apart by."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from dicflow.core.arrays import Mask
from dicflow.core.photographs.texture import LEAST_TEXTURE, mean_intensity_gradient, saturated_share, speckle_size

__all__ = ["SATURATED", "check_pattern", "check_subset"]

SATURATED = 0.25
"""Share of pixels as bright as can be, above which too much of the pattern is gone."""
_SPECKLES, _ACROSS = 3.0, 3.0
"""Least number of speckles in a subset, and how many should fit along its side."""


def check_pattern(image: npt.NDArray[Any], usable: Mask, name: str) -> None:
    """Raise ValueError where a photograph shows too little of a pattern, or is exposed too much.

    image : (rows, cols) grey; usable : (rows, cols) bool — the region in it
    name : of the photograph, as in "the first left photograph"
    """
    texture, saturated = mean_intensity_gradient(image, usable), saturated_share(image, usable)
    if texture < LEAST_TEXTURE:
        raise ValueError(
            f"the region shows too little texture in {name}: its mean intensity gradient is {texture:.2f} grey levels "
            f"per px, and correlation needs {LEAST_TEXTURE} or more; check light, exposure and focus"
        )
    if saturated > SATURATED:
        raise ValueError(
            f"{saturated:.0%} of the region's pixels are as bright as they can be in {name}, so the pattern is gone "
            f"there, and {SATURATED:.0%} at most can be borne; expose less"
        )


def check_subset(image: npt.NDArray[Any], usable: Mask, subset_size: int) -> None:
    """Raise ValueError where subsets of a side [px] hold too few speckles to be told apart."""
    diameter = speckle_size(image, usable)
    if np.isfinite(diameter) and subset_size**2 < _SPECKLES * 0.5 * np.pi * diameter**2:
        raise ValueError(
            f"a subset of {subset_size} px holds fewer than {_SPECKLES:.0f} of these speckles of {diameter:.1f} px; "
            f"take a subset_size of {int(np.ceil(_ACROSS * diameter)) | 1} px or more"
        )
