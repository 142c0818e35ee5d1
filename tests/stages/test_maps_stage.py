"""Which steps of a long series are drawn."""

import numpy as np
import pytest
from looking import ran

from dicflow.engine.product import Product, Variable
from dicflow.kinds.maps import Maps as Table
from dicflow.stages.maps import Maps

ROWS, COLS = 4, 3


def total(value):
    fields = {name: np.full((ROWS, COLS), value) for name in ("U", "V", "eyy")}
    places = np.stack([*np.meshgrid(np.arange(3.0), np.arange(4.0)), np.zeros((ROWS, COLS))], axis=-1)
    variables = {name: Variable(("row", "col"), values) for name, values in fields.items()}
    return Product("total", {**variables, "xyz": Variable(("row", "col", "c"), places, "mm")}, {"unit": "mm"})


def drawn(values, **parameters):
    product = ran(Maps(quantities=("eyy",), **parameters), total=[total(value) for value in values])
    return list(Table.read(product).drawn), product


def test_a_short_series_is_drawn_whole():
    numbers, product = drawn([0.1] * 24)
    assert numbers == list(range(24))
    assert "drawn" not in product.attrs


def test_a_long_series_has_evenly_chosen_steps_and_the_extreme_ones():
    values = np.zeros(601)
    values[[127, 333]] = 0.9, -0.4
    numbers, _ = drawn(values)
    even = np.linspace(0, 600, 24).round().astype(int).tolist()
    assert numbers == sorted({*even, 127, 333})


@pytest.mark.parametrize(("pictures", "count"), [("all", 100), (2, 2), (5, 5)])
def test_the_number_of_steps_can_be_chosen(pictures, count):
    assert len(drawn(np.linspace(0.0, 1.0, 100), pictures=pictures)[0]) == count


def test_a_step_without_a_value_is_never_an_extreme():
    values = np.full(100, 0.2)
    values[50] = np.nan
    values[[20, 70]] = 0.1, 0.3
    assert {20, 70} <= set(drawn(values, pictures=3)[0])
