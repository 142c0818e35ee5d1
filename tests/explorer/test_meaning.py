"""What ± means is said where something has an uncertainty."""

import pytest

from dicflow.explorer.meaning import meaning


def quantities(*parts):
    return [{"errors": dict.fromkeys(parts, (0.0, 1.0))}, {"errors": {}}]


def test_without_uncertainty_nothing_is_said():
    assert meaning(quantities(), "mm") == []


def test_u_is_defined_with_its_coverage_factor_and_contents():
    definition, contents = meaning(quantities("u", "sigma", "bias", "share"), "mm")
    assert "coverage factor 1" in definition
    assert "68 %" in definition
    assert "bias" in contents
    assert "not the calibration (its share stands beside it)" in contents


def test_an_unknown_share_of_the_calibration_is_said():
    assert "(its share is unknown, since the rig came" in meaning(quantities("u", "sigma", "bias"), "mm")[1]


@pytest.mark.parametrize("unit", ["mm", "px"])
def test_sigma_alone_is_called_so(unit):
    definition, contents = meaning(quantities("sigma"), unit)
    assert definition.startswith("± is the standard deviation σ")
    assert contents.startswith("It contains the noise of the photographs alone, not")
    assert ("calibration" in contents) == (unit == "mm")
