import numpy as np
import pytest

from dicflow.core.photographs.pattern import MAX_SATURATED_SHARE, check_pattern, check_subset
from dicflow.core.photographs.texture import speckle_size
from dicflow.core.synthetic.planar import planar_pair

GREY = planar_pair((160, 160), (0.0, 0.0)).reference
INSIDE = np.zeros(GREY.shape, dtype=bool)
INSIDE[20:-20, 20:-20] = True


def saturated(share):
    """The pattern with a share of the region saturated."""
    bright = GREY.copy()
    bright[20 : 20 + round(share * 120), 20:-20] = 255
    return bright


def test_a_good_pattern_passes():
    check_pattern(GREY, INSIDE, "it")
    check_subset(GREY, INSIDE, 21)


def test_only_the_region_counts():
    outside = np.where(INSIDE, GREY, 255).astype(np.uint8)
    check_pattern(outside, INSIDE, "it")


def test_too_much_light():
    check_pattern(saturated(MAX_SATURATED_SHARE - 0.05), INSIDE, "it")
    with pytest.raises(ValueError, match=r"30 % of the region .* in the first right photograph"):
        check_pattern(saturated(0.3), INSIDE, "the first right photograph")


def test_too_little_contrast():
    with pytest.raises(ValueError, match="too little texture in the left photograph: its mean intensity gradient is 0"):
        check_pattern((120.0 + 0.02 * GREY).astype(np.uint8), INSIDE, "the left photograph")


def test_too_small_a_subset():
    """Three discs of diameter D that cover half of a square need a side of √(3 π/2) D."""
    least = np.sqrt(1.5 * np.pi) * speckle_size(GREY, INSIDE)
    check_subset(GREY, INSIDE, int(np.ceil(least)))
    with pytest.raises(ValueError, match=f"a subset of {int(least)} px holds fewer than 3 speckles"):
        check_subset(GREY, INSIDE, int(least))
