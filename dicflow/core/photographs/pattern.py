"""Checks of the speckle pattern in a photograph: texture, exposure, and speckles per subset."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Grey, Mask
from dicflow.core.photographs.texture import MIN_TEXTURE, mean_intensity_gradient, saturated_share, speckle_size

__all__ = ["MAX_SATURATED_SHARE", "check_pattern", "check_subset"]

MAX_SATURATED_SHARE = 0.25
"""Largest share of saturated pixels in the region."""
_MIN_SPECKLES_PER_SUBSET, _SPECKLES_PER_SIDE = 3.0, 3.0
"""Least number of speckles in a subset, and recommended number along its side."""


def check_pattern(image: Grey, usable: Mask, name: str) -> None:
    """Raise ValueError where the region of a photograph has too little texture or is overexposed.

    image : (rows, cols) grey; usable : (rows, cols) bool — the region in it
    name : of the photograph, as in "the first left photograph"
    """
    texture, saturated = mean_intensity_gradient(image, usable), saturated_share(image, usable)
    if texture < MIN_TEXTURE:
        raise ValueError(
            f"the region has too little texture in {name}: its mean intensity gradient is {texture:.2f} grey levels "
            f"per px, expected at least {MIN_TEXTURE}; check light, exposure and focus"
        )
    if saturated > MAX_SATURATED_SHARE:
        raise ValueError(
            f"{100 * saturated:.0f} % of the region is overexposed in {name} "
            f"(limit {100 * MAX_SATURATED_SHARE:.0f} %); reduce the exposure"
        )


def check_subset(image: Grey, usable: Mask, subset_size: int) -> None:
    """Raise ValueError where subsets of a side ``subset_size`` [px] hold too few speckles to be distinguished."""
    diameter = speckle_size(image, usable)
    if np.isfinite(diameter) and subset_size**2 < _MIN_SPECKLES_PER_SUBSET * 0.5 * np.pi * diameter**2:
        raise ValueError(
            f"a subset of {subset_size} px holds fewer than {_MIN_SPECKLES_PER_SUBSET:.0f} speckles of "
            f"{diameter:.1f} px; use a subset_size of {int(np.ceil(_SPECKLES_PER_SIDE * diameter)) | 1} px or more"
        )
