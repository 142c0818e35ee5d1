"""A workbook gives numbers back as numbers and names as text, one sheet per table."""

from __future__ import annotations

import sys

import numpy as np
import pytest

from dicflow.core.status import Status
from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, InputError
from dicflow.io.exports import FORMATS, xlsx
from dicflow.io.exports.items import Item
from dicflow.io.table import EXACT
from tests.io.exported_totals import COLS, FORMS, ROWS, hole, item

FORMULAS = ("=1+1", "+1", "-a", "@SUM(A1)", "{=1}", "\x01bell")


def book_of(items, folder):
    openpyxl = pytest.importorskip("openpyxl")
    FORMATS.load("xlsx").write(items, folder, "test")
    assert [path.name for path in folder.iterdir()] == ["test.xlsx"]
    return openpyxl.load_workbook(folder / "test.xlsx")


def columns_of(sheet):
    header, *rows = sheet.iter_rows(values_only=True)
    return dict(zip(header, zip(*rows, strict=True), strict=True))


@pytest.mark.parametrize("form", FORMS)
def test_points_of_a_step_come_back_with_units_in_the_header(form, tmp_path):
    one = item(form)
    columns = columns_of(book_of([one._replace(style=EXACT)], tmp_path)["total_step_01"])
    unit = "px" if form == "planar" else "mm"
    assert {"U [mm]", "exx", f"X [{unit}]", "y [px]"} <= columns.keys()
    lost = hole().ravel()
    for name in ("exx", "U"):
        cells = columns[name if name == "exx" else "U [mm]"]
        assert [cell is None for cell in cells] == lost.tolist()
        known = [cell for cell in cells if cell is not None]
        np.testing.assert_allclose(known, one.product[name].ravel()[~lost], rtol=1e-15)
    assert "sigma_exx" in columns or form != "precise"
    assert not [name for name in columns if name.startswith("covariance")]
    assert np.asarray(columns["row"]) @ np.ones(ROWS * COLS) == sum(range(ROWS)) * COLS


def test_numbers_have_as_many_digits_as_those_of_other_tables(tmp_path):
    one = item()
    columns = columns_of(book_of([one], tmp_path)["total_step_01"])
    expected = [float(f"{value:.6g}") for value in one.product["U"].ravel()]
    np.testing.assert_array_equal([np.nan if cell is None else cell for cell in columns["U [mm]"]], expected)


def test_points_outside_of_the_region_have_no_row(tmp_path):
    one = item()
    status = one.product.variables["status"]
    lost = np.where(hole(), Status.OUTSIDE, status.values)
    product = Product("total", {**one.product.variables, "status": status._replace(values=lost)}, one.product.attrs)
    sheet = book_of([one._replace(product=product)], tmp_path)["total_step_01"]
    assert sheet.max_row == 1 + ROWS * COLS - hole().sum()


def test_selected_arrays_have_places_and_no_other_column(tmp_path):
    columns = columns_of(book_of([item()._replace(quantities=("eyy",))], tmp_path)["total_step_01"])
    places = ("reference_x [px]", "reference_y [px]", *(f"reference_{axis} [mm]" for axis in "XYZ"))
    assert tuple(columns) == ("row", "col", *places, "eyy")


def test_a_step_that_is_not_shown_has_its_row_of_the_summary_alone(tmp_path):
    items = [item(), item(step=2)._replace(whole=False)]
    book = book_of(items, tmp_path)
    assert book.sheetnames == ["summary", "total_step_01"]
    assert columns_of(book["summary"])["step"] == ("step_01", "step_02")


def test_a_summary_has_one_row_per_step(tmp_path):
    items = [
        item()._replace(step=step, product=Product("total", item().product.variables, {"summary": {"mean_eyy": value}}))
        for step, value in (("a", 0.25), ("b", 0.5))
    ]
    book = book_of(items, tmp_path)
    assert book.sheetnames == ["summary", "total_a", "total_b"]
    assert columns_of(book["summary"]) == {"stage": ("total",) * 2, "step": ("a", "b"), "mean_eyy": (0.25, 0.5)}


def test_names_are_text_and_never_formulas(tmp_path):
    rows = [{"probe": name, "=step": "s", "U": -1.5} for name in FORMULAS]
    sheet = book_of([Item("probes", None, Product("probes", {}, {"rows": rows}))], tmp_path)["probes"]
    kinds = {cell.data_type for row in sheet.iter_rows() for cell in row}
    assert kinds == {"s", "n"}
    assert columns_of(sheet)["probe"] == (*FORMULAS[:-1], "_bell")
    assert columns_of(sheet)["U"] == (-1.5,) * len(FORMULAS)


def test_names_of_sheets_are_short_and_different(tmp_path):
    rows = {"rows": [{"a": 1}]}
    stems = ["x" * 40, "x" * 40 + "y", "Summary", "a[1]:b"]
    items = [Item(stem, None, Product("probes", {}, rows)) for stem in stems]
    names = book_of(items, tmp_path).sheetnames
    assert names == ["x" * 31, "x" * 27 + " (2)", "Summary (2)", "a_1__b"]


def test_unknown_numbers_are_empty_cells(tmp_path):
    rows = [{"a": float("nan"), "b": float("inf"), "c": None, "d": 2}]
    sheet = book_of([Item("probes", None, Product("probes", {}, {"rows": rows}))], tmp_path)["probes"]
    assert [cell.value for cell in sheet[2]] == [None, None, None, 2]


def test_a_table_longer_than_a_sheet_is_refused_with_the_remedy(tmp_path, monkeypatch):
    pytest.importorskip("openpyxl")
    monkeypatch.setattr(xlsx, "_MOST_ROWS", ROWS * COLS)
    with pytest.raises(
        InputError, match=f"total_step_01: has {ROWS * COLS} points, a sheet {ROWS * COLS} rows; export"
    ):
        FORMATS.load("xlsx").write([item()], tmp_path, "test")


def test_without_the_library_the_message_has_the_command(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(ConfigurationError, match=r"pip install 'dicflow\[xlsx\]'"):
        FORMATS.load("xlsx").write([item()], tmp_path, "test")
