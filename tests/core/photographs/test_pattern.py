import numpy as np
import pytest

from dicflow.core.photographs.pattern import MAX_SATURATED_SHARE, check_pattern, checked_pattern, pattern_of
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
    assert checked_pattern(GREY, INSIDE, 21, "it") == pattern_of(GREY, INSIDE)


def test_figures_of_a_ramp():
    """A ramp of 2 grey levels per px over 101 columns: its levels are uniform, with σ = 2 √((101² − 1) / 12)."""
    ramp, region = np.tile(2 * np.arange(120, dtype=np.uint8), (120, 1)), np.zeros((120, 120), dtype=bool)
    region[10:111, 10:111] = True
    found = pattern_of(ramp, region)
    assert found.gradient == pytest.approx(2.0, abs=1e-4)
    assert found.contrast == pytest.approx(2.0 * np.sqrt((101**2 - 1) / 12) / 120.0)
    assert found.saturated == 0.0


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
    checked_pattern(GREY, INSIDE, int(np.ceil(least)), "it")
    with pytest.raises(ValueError, match=f"a subset of {int(least)} px holds fewer than 3 speckles"):
        checked_pattern(GREY, INSIDE, int(least), "it")
