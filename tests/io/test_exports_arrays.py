"""Files of arrays give the numbers back: HDF5, MAT, NPZ, VTU with PVD."""

from __future__ import annotations

import json
from xml.etree import ElementTree

import h5py
import meshio
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.io import loadmat

from dicflow.engine.product import Product, Variable
from dicflow.io.exports import FORMATS
from dicflow.io.exports.items import Item
from tests.io.exported_totals import FORMS, hole, item, known, same

NAMES = st.text(st.characters(codec="utf-8", exclude_categories=["Cs", "Cc"]), min_size=1, max_size=25)
TABLE = Product("comparison", {}, {"rows": [{"phase": "loading", "dic_strain": 0.1}]})


def write(form, items, folder, name="test"):
    FORMATS.load(form).write(items, folder, name)


@pytest.mark.parametrize("form", FORMS)
def test_hdf5(form, tmp_path):
    items = [item(form, step) for step in (2, 1)]
    write("hdf5", [*items, Item("comparison", None, TABLE)], tmp_path, "strip")
    with h5py.File(tmp_path / "strip.h5") as file:
        assert list(file["total"]) == ["step_02", "step_01"]
        for one in items:
            group = file["total"][one.step]
            assert group.attrs["kind"] == "total"
            assert json.loads(group["attributes"].asstr()[()]) == one.product.attrs
            for name, variable in one.product.variables.items():
                np.testing.assert_array_equal(group[name][:], variable.values)
                assert group[name].dtype == variable.values.dtype
                assert group[name].attrs["units"] == variable.units
                assert tuple(group[name].attrs["dims"]) == variable.dims
            meanings = group["status"].attrs["flag_meanings"].split()
            assert meanings[group["status"].attrs["flag_values"].tolist().index(10)] == "not_converged"
        assert json.loads(file["comparison"]["attributes"].asstr()[()]) == TABLE.attrs


@pytest.mark.parametrize("form", FORMS)
def test_mat(form, tmp_path):
    one = item(form)
    write("mat", [one], tmp_path)
    found = loadmat(tmp_path / "total_step_01.mat", simplify_cells=True)
    for name, variable in one.product.variables.items():
        np.testing.assert_array_equal(found[name], variable.values)
        assert found["units"][name] == variable.units
    codes = json.loads(found["attributes"])["status_codes"]
    assert "10 not converged" in codes.split(", ")
    assert json.loads(found["attributes"]) == {"kind": "total", **one.product.attrs, "status_codes": codes}


def test_mat_of_a_product_without_arrays(tmp_path):
    write("mat", [Item("comparison", None, TABLE)], tmp_path)
    found = loadmat(tmp_path / "comparison.mat", simplify_cells=True)
    assert json.loads(found["attributes"])["rows"] == TABLE.attrs["rows"]


@pytest.mark.parametrize("form", FORMS)
def test_npz(form, tmp_path):
    one = item(form)
    write("npz", [one], tmp_path)
    with np.load(tmp_path / "total_step_01.npz") as found:
        assert set(found) == {*one.product.variables, "attributes"}
        for name, variable in one.product.variables.items():
            np.testing.assert_array_equal(found[name], variable.values)
        attributes = json.loads(str(found["attributes"]))
        assert attributes["units"]["exx"] == "1"
        assert "1 filled" in attributes["status_codes"].split(", ")


@pytest.mark.filterwarnings("ignore:unclosed file:ResourceWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("form", FORMS)
def test_vtu(form, tmp_path):
    one = item(form)
    write("vtu", [one], tmp_path)
    mesh = meshio.read(tmp_path / "total_step_01.vtu")
    same(mesh.points, known(one.product, "xyz_reference"))
    for name, variable in one.product.variables.items():
        if variable.dims == ("row", "col"):
            same(mesh.point_data[name], known(one.product, name))
    same(mesh.point_data["displacement"], np.stack([known(one.product, axis) for axis in "UVW"], axis=-1))
    used = np.concatenate([block.data.ravel() for block in mesh.cells])
    cells = {block.type: len(block.data) for block in mesh.cells}
    assert cells == {"quad": 24 - 4 - 4, "vertex": 2}  # the corner, and the point at the edge beside the hole
    assert set(used) == set(range((~hole()).sum()))


def test_vtu_read_by_vtk(tmp_path):
    pyvista = pytest.importorskip("pyvista")
    one = item()
    write("vtu", [one], tmp_path)
    mesh = pyvista.read(tmp_path / "total_step_01.vtu")
    same(mesh.points, known(one.product, "xyz_reference"))
    same(mesh.point_data["exx"], known(one.product, "exx"))


def test_pvd_lists_the_steps_in_order(tmp_path):
    write("vtu", [item(step=step) for step in (3, 1, 12)], tmp_path)
    entries = ElementTree.parse(tmp_path / "total.pvd").getroot().findall("Collection/DataSet")
    names = [entry.get("file") for entry in entries]
    assert names == ["total_step_03.vtu", "total_step_01.vtu", "total_step_12.vtu"]
    assert [entry.get("timestep") for entry in entries] == ["3", "1", "12"]
    assert all((tmp_path / name).is_file() for name in names)


@pytest.mark.parametrize("form", ["csv", "hdf5", "mat", "npz", "vtu", "matchid", "challenge"])
def test_equal_products_give_equal_files(form, tmp_path):
    contents = []
    for name in ("first", "second"):
        folder = tmp_path / name
        folder.mkdir()
        write(form, [item()], folder)
        contents.append({path.name: path.read_bytes() for path in folder.iterdir()})
    assert contents[0] == contents[1]


@pytest.mark.slow
@given(stage=NAMES, step=NAMES)
def test_any_name_of_a_stage_and_a_step(tmp_path_factory, stage, step):
    folder = tmp_path_factory.mktemp("names")
    values = np.array([[1.5, np.nan]])
    product = Product("total", {"U": Variable(("row", "col"), values, "mm")}, {"unit": "mm"})
    for form in ("csv", "hdf5", "npz"):
        write(form, [Item(stage, step, product)], folder)
    assert len(list(folder.iterdir())) == 3
    with np.load(next(folder.glob("*.npz"))) as found:
        np.testing.assert_array_equal(found["U"], values)
    with h5py.File(folder / "test.h5") as file:
        found = []
        file.visititems(lambda name, node: found.append(node[:]) if getattr(node, "shape", ()) else None)
        np.testing.assert_array_equal(found[0], values)
