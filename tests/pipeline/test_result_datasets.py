"""Products of a result as groups of zarr's and as datasets of xarray, also of all steps at once."""

from __future__ import annotations

import dask.array
import numpy as np
import pytest
import xarray
import zarr

import dicflow
from dicflow.core.status import Status
from dicflow.engine import lazy
from dicflow.engine.references import load
from dicflow.errors import ConfigurationError


@pytest.fixture(scope="module")
def result(pipeline, measured):
    return dicflow.Pipeline.load(pipeline).result()


@pytest.mark.parametrize(("stage", "step"), [("total", "step_01"), ("photos", 0)])
def test_a_product_opens_as_a_group_of_zarr(result, stage, step):
    """Photographs are not kept here and are made again; totals are read where they lie."""
    group, product = result.open(stage, step), result.product(stage, step)
    assert isinstance(group, zarr.Group)
    assert group.attrs["kind"] == product.kind
    assert set(group.array_keys()) == set(product.variables)
    for name, variable in product.variables.items():
        np.testing.assert_array_equal(group[name][...], variable.values)
        assert group[name].metadata.dimension_names == variable.dims
        assert group[name].attrs["units"] == variable.units


def test_a_group_of_the_store_is_read_only(result):
    with pytest.raises(ValueError, match="read-only"):
        result.open("total", 0)["U"][...] = 0.0


def test_all_steps_are_one_lazy_dataset(result, monkeypatch):
    read = []
    monkeypatch.setattr(lazy, "load", lambda store, ref: read.append(ref.digest) or load(store, ref))
    whole = result.dataset("total", chunks="auto")
    assert list(whole.step_name.values) == list(result.steps("total"))
    assert whole.step.values.tolist() == [1, 2]
    assert isinstance(whole.U.data, dask.array.Array)
    assert whole.U.data.numblocks[0] == len(result.steps("total"))
    assert not read
    last = whole.U.isel(step=-1).values
    assert len(read) == 1
    np.testing.assert_array_equal(last, result.product("total", -1)["U"])
    assert (whole.U.attrs["units"], whole.U.dims) == ("mm", ("step", "row", "col"))


@pytest.mark.parametrize("chunks", [None, "auto"])
def test_the_status_says_what_its_codes_mean(result, chunks, tmp_path):
    """As conventions for climate and forecast data have it; it outlives a file of zarr's."""
    whole = result.dataset("total", None if chunks else 0, chunks=chunks)[["status"]]
    whole.drop_vars("step_name").drop_attrs(deep=False).to_zarr(tmp_path / "total.zarr", consolidated=False)
    for status in (whole.status, xarray.open_zarr(tmp_path / "total.zarr", consolidated=False).status):
        values, meanings = np.asarray(status.attrs["flag_values"]), status.attrs["flag_meanings"].split()
        assert values.tolist() == [*Status]
        assert meanings[Status.TOO_FEW_NEIGHBOURS] == "too_few_neighbours"
        assert set(np.unique(status)) <= set(values.tolist())


def test_chunks_along_a_dimension(result):
    whole = result.dataset("total", chunks={"row": 5})
    assert max(whole.U.chunksizes["row"]) == 5


def test_arrays_of_several_shapes_are_not_one_dataset(result):
    with pytest.raises(ConfigurationError, match="another shape at"):
        result.dataset("features", chunks="auto")


@pytest.mark.parametrize(("stage", "step"), [("total", 0), ("rig", None)])
def test_chunks_are_for_stages_with_steps(result, stage, step):
    with pytest.raises(ConfigurationError, match="leave out"):
        result.dataset(stage, step, chunks="auto")


def test_a_variant_has_its_name_of_the_command_line_or_an_index(copied):
    swept = dicflow.Pipeline.load(copied, settings=["smooth.degree=1,2"]).result()
    assert len(swept.values) == 2
    names, indices = (
        [swept.task("smooth", 0, name) for name in ("#1", "#2")],
        [swept.task("smooth", 0, k) for k in (0, 1)],
    )
    assert names == indices
    assert len(set(names)) == 2
    assert swept.variant("#2").values == [swept.values[1]]
    assert swept.source("strain", "increment", "#2") == "smooth"
    for wrong, said in (
        ("#3", "'#3'"),
        ("#0", "'#0'"),
        ("second", "'second'"),
        (2, "with index 2"),
        (-1, "with index -1"),
    ):
        with pytest.raises(ConfigurationError, match=f"no variant {said}: '#1' to '#2', or index 0 to 1"):
            swept.product("rig", variant=wrong)
