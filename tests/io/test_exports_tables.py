"""Tables for other programs give the numbers back."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from dicflow._version import __version__
from dicflow.engine.product import Product
from dicflow.errors import ConfigurationError, InputError
from dicflow.io.exports import FORMATS, beside
from dicflow.io.exports.items import Item, place
from dicflow.io.exports.points import in_space, principal_strains, quads
from dicflow.io.points_table import read_points
from dicflow.io.results import csv_text
from dicflow.io.table import EXACT, LOCALES, TableStyle, plain_text
from tests.io.exported_totals import COLS, FORMS, ROWS, hole, item, known, same, total

CHALLENGE = ["x_image", "y_image", "X", "Y", "Z", "U", "V", "W", "exx", "eyy", "exy", "e1", "e2"]


def written(form, items, folder, name="test"):
    FORMATS.load(form).write(items, folder, name)
    return sorted(path.name for path in folder.iterdir())


def read(path):
    """Comment lines, and the columns of a table by name."""
    lines = path.read_text(encoding="utf-8").splitlines()
    comments = [line for line in lines if line.startswith("#")]
    rows = list(csv.DictReader(line for line in lines if not line.startswith("#")))
    return comments, {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


@pytest.mark.parametrize("form", FORMS)
def test_csv(form, tmp_path):
    one = item(form)._replace(style=EXACT)
    assert written("csv", [one], tmp_path) == ["total_step_01.csv"]
    comments, table = read(tmp_path / "total_step_01.csv")
    fields = [name for name, variable in one.product.variables.items() if variable.dims == ("row", "col")]
    for name in fields:
        same(table[name], one.product[name].ravel())
    for index, axis in enumerate("XYZ"):
        same(table[axis], one.product["xyz"][..., index].ravel())
        same(table[f"reference_{axis}"], one.product["xyz_reference"][..., index].ravel())
    same(table["y"], one.product["xy"][..., 1].ravel())
    same(table["row"] * COLS + table["col"], np.arange(ROWS * COLS))
    assert f"# dicflow {__version__}" in comments
    assert "# U: mm" in comments
    assert "# exx is engineering strain εxx" in comments
    assert ("# vsg_px: 63.0" in comments) is (form != "thesis")


@pytest.mark.parametrize(("digits", "error"), [(6, 5e-6), (3, 5e-3)])
def test_numbers_of_a_csv_have_as_many_digits_as_asked_for(tmp_path, digits, error):
    one = item()._replace(style=TableStyle(digits))
    written("csv", [one], tmp_path)
    _, table = read(tmp_path / "total_step_01.csv")
    for name in ("U", "exx"):
        np.testing.assert_allclose(table[name], one.product[name].ravel(), rtol=error)
    cells = (tmp_path / "total_step_01.csv").read_text().splitlines()[-1].split(",")
    assert max(len(cell.partition("e")[0].replace(".", "").strip("-0")) for cell in cells) == digits
    assert item().style.digits == 6


def test_a_csv_for_a_spreadsheet_in_german_comes_back(tmp_path):
    rows = [{"probe": "a;b", "step": "-1,5", "U": -1.5}, {"probe": "=1", "step": "s", "U": 2.25}]
    text = csv_text(Product("probes", {}, {"rows": rows}), "probes", LOCALES["de"])
    assert text.splitlines()[-3:] == ["probe;step;U", '"a;b";"\'-1,5";-1,5', "'=1;s;2,25"]
    written("csv", [item()._replace(style=LOCALES["de"])], tmp_path)
    path = tmp_path / "total_step_01.csv"
    assert "." not in path.read_text().splitlines()[-1]
    _, table = read_german(path)
    np.testing.assert_allclose(table["exx"], item().product["exx"].ravel(), rtol=5e-6)


def read_german(path):
    lines = [line for line in path.read_text(encoding="utf-8").splitlines() if not line.startswith("#")]
    rows = list(csv.DictReader(lines, delimiter=";"))
    return lines, {name: np.array([float(row[name].replace(",", ".")) for row in rows]) for name in rows[0]}


def test_csv_of_chosen_quantities(tmp_path):
    written("csv", [item()._replace(quantities=("eyy", "sigma_exx"))], tmp_path)
    _, table = read(tmp_path / "total_step_01.csv")
    places = ["reference_x", "reference_y", "reference_X", "reference_Y", "reference_Z"]
    assert list(table) == ["row", "col", *places, "eyy", "sigma_exx"]
    for axis, name in enumerate(places[2:]):
        np.testing.assert_allclose(table[name], item().product["xyz_reference"][..., axis].ravel(), rtol=5e-6)


def test_chosen_quantities_of_points_without_a_place_in_the_product_get_the_one_that_is_known(tmp_path):
    written("csv", [item("thesis")._replace(quantities=("eyy",))], tmp_path)
    _, table = read(tmp_path / "total_step_01.csv")
    expected = item("thesis").places()[..., 1].ravel()
    np.testing.assert_allclose(table["reference_y"], expected, rtol=5e-6)


@pytest.mark.parametrize("form", FORMS)
def test_challenge(form, tmp_path):
    one = item(form)
    assert written("challenge", [one], tmp_path) == ["total_step_01.csv"]
    comments, table = read(tmp_path / "total_step_01.csv")
    assert (comments, list(table)) == ([], CHALLENGE)
    for name in ("U", "V", "W", "exx", "eyy"):
        same(table[name], known(one.product, name))
    same(table["exy"], known(one.product, "gxy") / 2.0)
    same(table["x_image"], known(total("precise"), "xy_reference")[:, 0])
    same(table["Z"], known(one.product, "xyz_reference")[:, 2])


@pytest.mark.parametrize("form", FORMS)
def test_matchid(form, tmp_path):
    one = item(form)
    assert written("matchid", [one], tmp_path) == ["total_step_01.csv"]
    comments, table = read(tmp_path / "total_step_01.csv")
    unit = "px" if form == "planar" else "mm"
    assert comments == []
    same(table["Coordinates.Image X [Pixel]"], one.places()[~hole()][:, 0])
    same(table[f"coor.Y [{unit}]"], known(one.product, "xyz_reference")[:, 1])
    same(table[f"disp.Horizontal Displacement U [{unit}]"], known(one.product, "U"))
    same(table[f"disp.Out-Of-Plane: W [{unit}]"], known(one.product, "W"))
    same(table["strain.Strain-global frame: Exx [ ]"], known(one.product, "exx"))
    same(table["strain.Strain-global frame: Exy [ ]"], known(one.product, "gxy") / 2.0)


def test_matchid_without_places_in_the_photograph_has_none(tmp_path):
    written("matchid", [item()._replace(places=None)], tmp_path)
    assert not [name for name in read(tmp_path / "total_step_01.csv")[1] if name.startswith("Coordinates")]
    with pytest.raises(InputError, match=r"no columns with places .* MatchID's Coordinates\.Image X and Y"):
        read_points(tmp_path / "total_step_01.csv")


def test_principal_strains_are_the_products_own_or_the_tensors(tmp_path):
    for form in ("precise", "thesis"):
        (tmp_path / form).mkdir()
        one = item(form)
        written("challenge", [one], tmp_path / form)
        _, table = read(tmp_path / form / "total_step_01.csv")
        exx, eyy, exy = (known(one.product, name) * half for name, half in (("exx", 1), ("eyy", 1), ("gxy", 0.5)))
        tensors = np.moveaxis(np.array([[exx, exy], [exy, eyy]]), -1, 0)
        low, high = np.linalg.eigvalsh(tensors).T
        np.testing.assert_allclose(principal_strains(exx, eyy, exy), (high, low), atol=1e-15)
        same(table["e1"], known(one.product, "e1") if form == "precise" else principal_strains(exx, eyy, exy)[0])


def test_columns_of_other_programs_are_theirs(tmp_path):
    for form in ("matchid", "challenge"):
        with pytest.raises(ConfigurationError, match=f"{form} .*--quantity"):
            written(form, [item()._replace(quantities=("exx",))], tmp_path)


def test_the_challenge_needs_places_in_the_first_photograph(tmp_path):
    with pytest.raises(ConfigurationError, match="no place in the first photograph"):
        written("challenge", [item()._replace(places=None)], tmp_path)


def test_cells_lie_between_known_corners():
    lost = hole()
    cells = quads(~lost)
    corners = np.argwhere(~lost)[cells]
    assert (np.ptp(corners, axis=1) == 1).all()
    whole = ~(lost[:-1, :-1] | lost[1:, :-1] | lost[:-1, 1:] | lost[1:, 1:])
    same(corners[:, 0], np.argwhere(whole))
    around = np.roll(corners, -1, axis=1) - corners
    assert (np.abs(around).sum(axis=-1) == 1).all()
    assert quads(np.zeros((1, 4), bool)).shape == (0, 4)


def test_places_of_a_plane_lie_at_height_zero():
    same(in_space(np.array([[1.0, 2.0]])), [[1.0, 2.0, 0.0]])


def test_two_products_never_share_a_file(tmp_path):
    one = Item("s", "a:b", Product("total"))
    place(tmp_path, f"{one.stem}.csv").write_text("")
    with pytest.raises(InputError, match="two products"):
        place(tmp_path, f"{one._replace(step='a?b').stem}.csv")


def test_every_format_has_its_module():
    names = [
        "challenge",
        "csv",
        "geojson",
        "hdf5",
        "json",
        "mat",
        "matchid",
        "material",
        "npz",
        "opencv",
        "vtu",
        "xlsx",
    ]
    assert list(FORMATS.names()) == names
    for name in names:
        assert {"DESCRIPTION", "KINDS", "write"} <= set(FORMATS.load(name).__all__)


def test_what_is_written_beside_a_whole_test():
    assert beside() == {
        "csv": ("comparison", "probes", "channels", "noise", "curve", "material"),
        "geojson": ("region",),
        "json": ("rig",),
        "material": ("material",),
    }


FORMULAS = ("=cmd|' /C calc'!A0", "+1+1", "-a", "@SUM(A1)", "\t=1", "a\r=1", "x, y", "-1.5", "'=1")


def test_names_of_probes_are_no_formulas_and_come_back():
    rows = [{"probe": name, "step": "step_01", "U": -1.5} for name in FORMULAS]
    product = Product("probes", {}, {"rows": rows, "verdict": "a\n=1,=2;@x", "note": "good, -0.3"})
    text = csv_text(product, "=1")
    lines = [line for line in text.split("\n") if line.startswith("#")]
    assert "# product: =1" in lines
    assert "# verdict: a =1,'=2;'@x" in lines
    table = list(csv.reader(io.StringIO(text[text.index("probe,step") :], newline=""), strict=True))
    assert [plain_text(row[0]) for row in table[1:]] == list(FORMULAS)
    assert [row[0] for row in table[1:] if row[0][:1] in tuple("=+-@\t\r")] == ["-1.5"]
    assert {row[2] for row in table[1:]} == {"-1.5"}


@pytest.mark.parametrize(
    ("stage", "step", "stem"),
    [
        ("total", "../../x", "total_.._.._x"),
        ("total", "a\\b:c\n", "total_a_b_c_"),
        ("con", None, "con_"),
        ("Aux.1", None, "Aux.1_"),
        ("com1", None, "com1_"),
        ("console", None, "console"),
        ("..", None, "__"),
        ("-rf", None, "_rf"),
    ],
)
def test_names_of_files_stay_in_their_folder_on_every_system(stage, step, stem):
    assert Item(stage, step, Product("total")).stem == stem


def test_a_file_of_a_whole_test_has_a_name_that_every_system_allows(tmp_path):
    assert written("hdf5", [item()], tmp_path, name="../a: 1") == ["_._a_ 1.h5"]


@pytest.mark.parametrize("name", ["../x.csv", "a/b.csv", "a\\b.csv", "..", "a\0.csv", "\x1b.csv", ".hidden"])
def test_no_file_is_placed_elsewhere(tmp_path, name):
    with pytest.raises(InputError, match="is not the name of a file"):
        place(tmp_path, name)


@pytest.mark.parametrize("form", ["csv", "hdf5", "mat", "npz", "vtu"])
@pytest.mark.parametrize("name", ["../x", "a/b", "=1", "a b", "<script>", ""])
def test_arrays_with_other_names_than_words_are_not_written(tmp_path, form, name):
    one = item()
    hostile = Product("total", {**one.product.variables, name: one.product.variables["U"]}, one.product.attrs)
    with pytest.raises(InputError, match="expected a word"):
        written(form, [one._replace(product=hostile)], tmp_path)
