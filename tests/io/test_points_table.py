"""Tables of points in the words of several programs."""

import csv

import numpy as np
import pytest

from dicflow.errors import InputError
from dicflow.io.points_table import read_points


@pytest.fixture
def table(tmp_path):
    def written(text):
        path = tmp_path / "points.csv"
        path.write_text(text, encoding="utf-8")
        return read_points(path)

    return written


DIALECTS = {
    "challenge": "x_image,y_image,X,Y,Z,U,V,W,exx,eyy,exy,e1,e2\n10,20,1,2,3,0.1,0.2,0.3,0.01,0.02,0.004,0.02,0.01\n",
    "dicflow": "# U: mm\n# exx: 1\nrow,col,U,V,W,exx,eyy,gxy,sigma_U,x,y,reference_X,reference_x,reference_y\n"
    "0,0,0.1,0.2,0.3,0.01,0.02,0.008,0.5,99,99,1,10,20\n",
    "vic3d": "X;Y;Z;U;V;W;sigma;x;y;u;v;exx;eyy;exy\n1;2;3;0.1;0.2;0.3;0.01;10;20;7;8;0.01;0.02;0.004\n",
    "opencorr": "x,y,u,v,w,ref_x,ref_y,ref_z,tar_x,tar_y,tar_z,exx,eyy,exy\n"
    "10,20,5,5,5,1,2,3,1.1,2.2,3.3,0.01,0.02,0.004\n",
    "matchid": "Coordinates.Image X [Pixel]\tCoordinates.Image Y [Pixel]\tcoor.X [mm]\tcoor.Y [mm]\t"
    "disp.Horizontal Displacement U [mm]\tdisp.Vertical Displacement V [mm]\t"
    "disp.Out-Of-Plane: W [mm]\tstrain.Strain-global frame: Exx [ ]\tstrain.Strain-global frame: Eyy [ ]\t"
    "strain.Strain-global frame: Exy [ ]\n10\t20\t-3\t-4\t0.1\t0.2\t0.3\t0.01\t0.02\t0.004\n",
}


@pytest.mark.parametrize("dialect", DIALECTS)
def test_each_program_says_the_same(table, dialect):
    found = table(DIALECTS[dialect])
    np.testing.assert_array_equal(found.xy, [[10.0, 20.0]])
    expected = {"U": 0.1, "V": 0.2, "W": 0.3, "exx": 0.01, "eyy": 0.02, "gxy": 0.008}
    assert {name: found.values[name][0] for name in expected} == pytest.approx(expected)


def test_units_and_sigmas_where_the_table_says_them(table):
    own = table(DIALECTS["dicflow"])
    assert own.units["U"] == "mm"
    assert own.sigmas["U"].tolist() == [0.5]
    assert table(DIALECTS["matchid"]).units["W"] == "mm"
    assert table(DIALECTS["challenge"]).units == {}
    assert table("x,y,disp.Horizontal Displacement U [Pixel]\n1,2,3\n").units["U"] == "px"


def test_points_that_failed_and_empty_cells_have_no_value(table):
    found = table("x,y,U,V,W,sigma\n1,1,1,1,1,0.1\n2,1,0,0,0,-1\n3,1,,1,1,0.1\n")
    assert found.values["U"][0] == 1.0
    assert np.isnan(found.values["U"][1:]).all()
    assert np.isnan(found.values["V"]).tolist() == [False, True, False]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", ["no rows"]),
        ("x,y,U\n", ["no rows"]),
        ("a,b\n1,2\n", [":1:", "x_image", "a, b"]),
        ("x,y,colour\n1,2,3\n", [":1:", "displacement", "colour"]),
        ("x,y,U,reference_X\n1,2,3,4\n", [":1:", "x_image", "challenge"]),
        ("x,y,U\n1,2\n", [":2:", "2 values for 3"]),
        ("x,y,U\n1,2,many\n", [":2:", "many"]),
    ],
)
def test_what_is_no_table_of_points_is_said(table, text, words):
    with pytest.raises(InputError) as raised:
        table(text)
    assert all(word in str(raised.value) for word in words)


def test_a_real_table(shared_data):
    path = shared_data / "d_specimen/reference/points_0273.csv"
    found = read_points(path)
    with path.open() as file:
        rows = list(csv.DictReader(file))
    assert len(found.xy) == len(rows)
    assert found.values["V"][7] == pytest.approx(float(rows[7]["tar_y"]) - float(rows[7]["ref_y"]))
    assert found.values["gxy"][7] == pytest.approx(2 * float(rows[7]["exy"]))


@pytest.mark.parametrize("dialect", DIALECTS)
@pytest.mark.parametrize("separator", [";", "\t"])
def test_decimal_commas_say_the_same(tmp_path, dialect, separator):
    path = tmp_path / "points.csv"
    text = DIALECTS[dialect].replace("\t", ",").replace(";", ",").replace(",", separator)
    head, _, row = text.rstrip().rpartition("\n")
    path.write_bytes(f"{head}\n{row.replace('.', ',')}\n".encode("utf-16"))
    found, plain = read_points(path), DIALECTS[dialect]
    path.write_text(plain, encoding="utf-8")
    expected = read_points(path)
    np.testing.assert_array_equal(found.xy, expected.xy)
    for name, values in expected.values.items():
        np.testing.assert_array_equal(found.values[name], values)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("x;y;U\n1;2;1,234\n3;4;5,678\n", [":2:", "1.234 or 1234", "decimal point"]),
        ("x;y;U\n1;2;0,5\n3;4;0.5\n", [":2:", ":3", "decimal point"]),
        ("x;y;U\n1;2;1.234,5\n", [":2:", "1.234,5"]),
        ("x,y,U\n1,2,0,5\n", [":2:", "4 values for 3", "decimal points"]),
        ("x,y,U\n1,2,inf\n", [":2:", "U is 'inf'", "1,000,000,000"]),
        ("x,y,U\n1e308,2,3\n", [":2:", "x is '1e308'"]),
        ("x,y,U,U\n1,2,3,4\n", [":1:", "more than one column U"]),
        ("x,y,U\n1,2," + "1" * 100_000 + "\n", [":2:", "longer than"]),
    ],
)
def test_numbers_without_a_clear_meaning_are_refused(table, text, words):
    with pytest.raises(InputError) as raised:
        table(text)
    assert all(word in str(raised.value) for word in words), raised.value


def test_columns_that_are_not_read_may_hold_anything(table):
    found = table("note,x,y,U,sigma_V\n=cmd|'x'!A0,1,2,3,often\n,4,5,nan,\n")
    np.testing.assert_array_equal(found.values["U"], [3.0, np.nan])
