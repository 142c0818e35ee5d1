"""The table of quantities: complete, consistent with what core computes, and read the same by all."""

from __future__ import annotations

import pytest

from dicflow.core.strain.measures import DeformationMeasures, hencky_strain
from dicflow.errors import ConfigurationError
from dicflow.kinds import quantities as table
from dicflow.kinds.quantities import BASIC, MEASURES, QUANTITIES, is_signed, of_field, strain_function, unit_of


def test_it_has_what_core_computes_and_the_displacements():
    assert list(QUANTITIES) == [*"UVW", *DeformationMeasures._fields]
    assert set(BASIC) <= set(QUANTITIES)


def test_every_entry_is_complete_and_symbols_are_unique():
    assert all(name == quantity.name for name, quantity in QUANTITIES.items())
    assert all(quantity.symbol and quantity.title and quantity.definition for quantity in QUANTITIES.values())
    assert len({quantity.symbol for quantity in QUANTITIES.values()}) == len(QUANTITIES)
    assert all(measure.definition and measure.title for measure in MEASURES.values())


@pytest.mark.parametrize(
    ("name", "quantity", "signed", "unit"),
    [
        ("U", "U", True, "mm"),
        ("sigma_U", "U", False, "mm"),
        ("calibration_gxy", "gxy", False, "1"),
        ("angle", "angle", True, "deg"),
        ("von_mises", "von_mises", False, "1"),
        ("znssd", None, True, "1"),
        ("elongation", None, True, "mm"),
    ],
)
def test_an_array_belongs_to_its_quantity(name, quantity, signed, unit):
    found = of_field(name)
    assert (None if found is None else found.name) == quantity
    assert is_signed(name) is signed
    assert unit_of(name, "mm") == unit


def test_what_probes_read_has_the_sources_of_its_errors():
    for quantity in QUANTITIES.values():
        assert ("probes" in quantity.uses) == (quantity.sources is not None)
        assert quantity.sources is None or sum(quantity.sources) == pytest.approx(1.0)


def test_a_measure_is_its_function_of_the_stretch():
    assert strain_function("engineering") is None
    assert strain_function("hencky") is hencky_strain


@pytest.mark.parametrize("find", [table.strain_measure, table.further_quantity])
def test_an_unknown_name_is_refused_with_the_known_ones(find):
    with pytest.raises(ConfigurationError, match="'hencki'"):
        find("hencki")
    with pytest.raises(ConfigurationError, match="did you mean 'hencky'"):
        table.strain_measure("hencki")
