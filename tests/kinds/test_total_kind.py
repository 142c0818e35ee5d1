"""Totals: titles with their gauge, single precision of deviations, and what counts as known."""

from __future__ import annotations

import numpy as np
import pytest

from dicflow.kinds.kind import GRID
from dicflow.kinds.total import Gauge, Total, TotalFacts, field_means, named_with_unit

SHAPE = (3, 4)
TITLES = {"U": "displacement U", "exx": "Hencky strain εxx"}


def written(unit="mm", definition="precise", **further):
    fields = {name: np.full(SHAPE, 0.1 * k) for k, name in enumerate(("U", "V", "W", "exx", "eyy", "gxy", "sigma_exx"))}
    fields["xyz_reference"] = np.zeros((*SHAPE, 3))
    fields["xyz_reference"][0, 0] = np.nan
    fields["eyy"][1, 1] = np.nan
    status = np.zeros(SHAPE, np.uint8)
    return Total.read(Total.write(fields, status, TotalFacts(definition, unit, TITLES, further)))


def test_arrays_have_axes_units_and_titles():
    variables = written().product.variables
    assert all(variables[name].dims == GRID for name in ("U", "exx", "sigma_exx", "status"))
    assert [variables[name].units for name in ("U", "exx", "xyz_reference")] == ["mm", "1", "mm"]
    assert variables["sigma_exx"].values.dtype == np.float32
    assert variables["exx"].values.dtype == np.float64
    assert variables["sigma_exx"].long_name == "σ of the Hencky strain εxx"


def test_the_caption_of_a_strain_has_its_gauge():
    total = written(vsg_px=74.2, vsg_mm=5.31)
    assert total.gauge == Gauge(74.2, 5.31)
    assert total.caption("exx") == "Hencky strain εxx, VSG 74 px = 5.31 mm"
    assert total.caption("U") == "displacement U"
    assert written(vsg_px=74.2, vsg_mm=None).caption("exx").endswith("VSG 74 px")
    assert written().caption("exx") == "Hencky strain εxx"


def test_a_point_is_known_with_all_quantities_and_a_place():
    known = written().known()
    assert not known[0, 0]
    assert not known[1, 1]
    assert known.sum() == known.size - 2


@pytest.mark.parametrize(("definition", "follows"), [("precise", True), ("material", True), ("thesis", False)])
def test_only_the_thesis_has_a_grid_of_its_own_at_each_step(definition, follows):
    assert written(definition=definition).follows_material is follows


def test_means_and_names_carry_the_unit_of_length():
    fields = {name: np.array([1.0, 3.0, np.nan]) for name in ("U", "V", "W", "exx", "eyy")}
    means = field_means({**fields, "gxy": np.array([np.nan])}, "px")
    assert means == {"mean_U_px": 2.0, "mean_V_px": 2.0, "mean_W_px": 2.0, "mean_exx": 2.0, "mean_eyy": 2.0}
    assert named_with_unit("exx", "mm") == "exx"
