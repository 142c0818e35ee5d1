import numpy as np
import pytest

from dicflow.core.strain.surface_strain import Strain
from dicflow.core.surfaces.displacement import Increment as IncrementField
from dicflow.kinds.increment import Increment, StrainIncrement
from tests.kinds.layouts import layouts, long_names, stored

DRAW = np.random.default_rng(6)
SHAPE = (3, 4)
XY = DRAW.normal(size=(*SHAPE, 2))
BEFORE, AFTER = DRAW.normal(size=(2, *SHAPE, 3))
STATUS = np.zeros(SHAPE, np.uint8)
FIELD = IncrementField(XY, BEFORE, AFTER, AFTER - BEFORE, STATUS)
STRAIN = Strain(*DRAW.normal(size=(3, *SHAPE)))
GRADIENT = DRAW.normal(size=(*SHAPE, 2, 2))


def write(definition="material", unit="mm"):
    return stored(Increment.write(FIELD, definition, 5.0, unit, {"measured_share": 1.0}))


def strained(definition="material", unit="mm", gradient=GRADIENT):
    increment = Increment.read(write(definition, unit))
    return stored(StrainIncrement.write(increment, STRAIN, gradient, STATUS, (9, 5)))


def test_displacements_come_back_bit_for_bit():
    increment = Increment.read(write())
    for name, expected in FIELD._asdict().items():
        np.testing.assert_array_equal(increment[name], expected)
    assert (increment.definition, increment.unit, increment.step_size) == ("material", "mm", 5.0)
    assert increment.summary == {"measured_share": 1.0}


@pytest.mark.parametrize(("definition", "follows"), [("material", True), ("thesis", False)])
def test_only_the_material_definition_follows_the_material(definition, follows):
    assert Increment.read(write(definition)).follows_material is follows
    assert StrainIncrement.read(strained(definition)).follows_material is follows


@pytest.mark.parametrize("unit", ["mm", "px"])
def test_lengths_of_an_increment_have_its_unit(unit):
    assert layouts(write(unit=unit)) == {
        "xy": ("row col image_component", "px"),
        "xyz_reference": ("row col component", unit),
        "xyz": ("row col component", unit),
        "displacement": ("row col component", unit),
        "status": ("row col", "1"),
    }


def test_smoothed_displacements_replace_the_measured_ones_alone():
    smooth = AFTER - BEFORE + 0.5
    changed = stored(Increment.read(write()).changed({"displacement": smooth}, (9, 5), {"change_rms_mm": 0.5}))
    np.testing.assert_array_equal(changed["displacement"], smooth)
    np.testing.assert_array_equal(changed["xyz"], AFTER)
    assert layouts(changed) == layouts(write())
    assert long_names(changed) == long_names(write())
    assert changed.attrs == {**write().attrs, "window_points": [9, 5], "summary": {"change_rms_mm": 0.5}}


@pytest.mark.parametrize("unit", ["mm", "px"])
def test_strains_are_stored_with_the_components_of_the_displacement(unit):
    product = strained(unit=unit)
    assert layouts(product) == {
        "xy": ("row col image_component", "px"),
        "xyz": ("row col component", unit),
        "xyz_reference": ("row col component", unit),
        **dict.fromkeys("UVW", ("row col", unit)),
        "gradient": ("row col out in", "1"),
        **dict.fromkeys(("exx", "eyy", "gxy"), ("row col", "1")),
        "status": ("row col", "1"),
    }
    for axis, name in enumerate("UVW"):
        np.testing.assert_array_equal(product[name], FIELD.displacement[..., axis])
    for name, expected in STRAIN._asdict().items():
        np.testing.assert_array_equal(product[name], expected)
    np.testing.assert_array_equal(product["gradient"], GRADIENT)


def test_strains_keep_definition_step_size_and_unit_of_the_increment():
    strain = StrainIncrement.read(strained("thesis", "px", None))
    assert (strain.definition, strain.step_size, strain.unit) == ("thesis", 5.0, "px")
    assert "gradient" not in strain
    assert strain.product.attrs["window_points"] == [9, 5]
