"""Which settings are tried: around the speckles, with gauges on one ladder, and those of the file."""

from __future__ import annotations

import pytest

from dicflow.core.strain.gauge_kernel import GaugeSetting
from dicflow.tuning.candidates import Region, candidates

PRESENT = GaugeSetting(31, 7, "affine", 7, 1)


@pytest.mark.parametrize("speckle", [2.5, 4.5, 7.0])
@pytest.mark.parametrize("side", [150.0, 400.0, 1500.0])
def test_settings_suit_pattern_and_region(speckle, side):
    found = candidates(PRESENT, Region(speckle, side))
    assert found[0] == PRESENT
    assert len(found) == len(set(found))
    assert len(found) <= 150
    for setting in found[1:]:
        assert setting.subset_size % 2 == setting.window_points % 2 == 1
        assert setting.subset_size >= min(3 * speckle, PRESENT.subset_size)
        assert setting.side_px <= 0.6 * side
        assert (side / setting.step_size) ** 2 <= max(40_000, (side / PRESENT.step_size) ** 2)
        assert setting.degree == 1


def test_each_shape_function_has_the_same_gauges():
    found = candidates(PRESENT, Region(4.5, 500.0))
    affine = {setting for setting in found if setting.shape_function == "affine"} - {PRESENT}
    quadratic = {setting._replace(shape_function="affine") for setting in found if setting not in affine} - {PRESENT}
    assert affine <= quadratic | {PRESENT}


def test_a_cubic_window_has_five_points_at_least():
    found = candidates(PRESENT._replace(degree=3), Region(4.5, 500.0))
    assert min(setting.window_points for setting in found) == 5
