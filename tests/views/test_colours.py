import numpy as np
import pytest

from dicflow.errors import ConfigurationError
from dicflow.views.colour_tables import TABLES
from dicflow.views.colours import _colours_of_matplotlib, look, palette


@pytest.mark.parametrize(
    ("low", "high", "shown", "table"),
    [
        (0.0, 2.0, (0.0, 2.0), "viridis"),
        (-3.0, -1.0, (-3.0, -1.0), "viridis"),
        (-1.0, 4.0, (-4.0, 4.0), "RdBu_r"),
        (-4.0, 0.4, (-4.0, 4.0), "RdBu_r"),
        (-0.39, 4.0, (-0.39, 4.0), "viridis"),
    ],
)
def test_signed_values_have_zero_in_the_middle(low, high, shown, table):
    chosen = look("exx", "Hencky exx", "1", low, high)
    assert (chosen.range, chosen.table) == (shown, table)


def test_a_table_that_is_asked_for_keeps_the_range():
    chosen = look("exx", "Hencky exx", "1", -1.0, 4.0, "jet")
    assert (chosen.range, chosen.table) == ((-1.0, 4.0), "jet")


@pytest.mark.parametrize(("unit", "label"), [("1", "U [–]"), ("mm", "U [mm]")])
def test_labels_have_the_unit(unit, label):
    assert look("U", "U", unit, 0, 1).label == label


def test_a_palette_runs_from_end_to_end():
    grey = palette("gray", 254)
    assert grey.shape == (254, 3)
    assert grey.dtype == np.uint8
    np.testing.assert_array_equal(grey[[0, -1]], [[0, 0, 0], [255, 255, 255]])
    assert (np.diff(grey[:, 0].astype(int)) >= 0).all()


@pytest.mark.parametrize("table", TABLES)
@pytest.mark.parametrize("count", [2, 7, 224, 254, 256, 300])
def test_the_tables_are_those_of_matplotlib(table, count):
    np.testing.assert_array_equal(palette(table, count), _colours_of_matplotlib(table, count))


def test_the_sequential_palette_grows_lighter():
    lightness = palette("viridis") @ np.array([0.2126, 0.7152, 0.0722])
    assert (np.diff(lightness) > -0.5).all()


def test_an_unknown_table_is_named():
    with pytest.raises(ConfigurationError, match="no colour map 'virids', did you mean 'viridis'"):
        palette("virids")
