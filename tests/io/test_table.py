"""Tables as spreadsheets write them, and cells that spreadsheets do not run."""

import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dicflow.errors import InputError
from dicflow.io.table import Numbers, cell_text, note_line, plain_text, read_table, row_text


def read(cells, least=-1e9, most=1e9):
    """The numbers of the cells of one table, each in a line of its own."""
    numbers = Numbers()
    found = [numbers.read(f"t.csv:{line}", "x", cell, least, most) for line, cell in enumerate(cells, start=1)]
    numbers.settle()
    return found


@pytest.mark.parametrize(
    ("cells", "expected"),
    [
        (["59.95", " -1.5 ", "1e3", ".5", "5."], [59.95, -1.5, 1000.0, 0.5, 5.0]),
        (["59,95", "1,234", "7"], [59.95, 1.234, 7.0]),
        (["0,004"], [0.004]),
        (["-0,125"], [-0.125]),
        (["1234,567"], [1234.567]),
        (["1,2345"], [1.2345]),
        (["1,5e-3", ",5"], [0.0015, 0.5]),
        (["1.234"], [1.234]),
        (["\u22121.5"], [-1.5]),
    ],
)
def test_decimal_points_and_decimal_commas(cells, expected):
    assert read(cells) == expected


@pytest.mark.parametrize(
    ("cells", "message"),
    [
        (["1,234"], r"t.csv:1: '1,234' may be 1.234 or 1234; write all numbers with a decimal point"),
        (["5", "12,500", "999,000"], "t.csv:2: '12,500' may be 12.500 or 12500"),
        (["59,95", "60.5"], "t.csv:1: has a comma in a number, but t.csv:2 a decimal point"),
        (["1.234,5"], "'1.234,5', expected a number"),
        (["1,234,567"], "expected a number"),
        (["1'234.5"], "expected a number"),
        (["1 234"], "expected a number"),
        (["1\u00a0234,5"], "expected a number"),
        (["1_000"], "expected a number"),
        (["inf"], "expected a number from -1,000,000,000 to 1,000,000,000"),
        (["nan"], "expected a number"),
        (["1e308"], "'1e308', expected a number from"),
        (["7" * 400], "expected a number"),
        (["7" * 90_000 + "x"], "expected a number"),
        (["=1+1"], "'=1\\+1', expected a number"),
        ([""], "x is '', expected a number"),
    ],
)
def test_numbers_without_a_clear_meaning_are_refused(cells, message):
    with pytest.raises(InputError, match=message):
        read(cells)


@pytest.mark.parametrize("separator", [",", ";", "\t"])
def test_separators_notes_and_blank_rows(tmp_path, separator):
    path = tmp_path / "t.csv"
    text = '# U: mm\n"# saved again, by a spreadsheet"\n\na,"b c",d\n1,2,3\n,,\n# note\n4,5,6\n'
    path.write_text(text.replace(",", separator))
    table = read_table(path, "a table", "a, b", 1000)
    assert table.names == ["a", "b c", "d"]
    assert table.notes[0] == "# U: mm"
    assert table.where == f"{path}:4"
    assert list(table.rows) == [(f"{path}:5", ["1", "2", "3"]), (f"{path}:8", ["4", "5", "6"])]


def test_a_line_that_names_the_separator(tmp_path):
    path = tmp_path / "t.csv"
    path.write_text("sep=;\na,1;b,2\n1;2\n")
    assert read_table(path, "a table", "a, b", 1000).names == ["a,1", "b,2"]


@pytest.mark.parametrize("name", ["=1+1", "+1-1", "-a", "@SUM(A1)", "\ta", "\r=1", " =1", "＝1", "'=1", "''@", "\n+x"])
def test_text_that_a_spreadsheet_would_run_gets_an_apostrophe(name):
    assert cell_text(name) == f"'{name}"
    assert plain_text(f"'{name}") == name


@pytest.mark.parametrize("name", ["-1.5", "+2e3", "a=b", "it's", "'quoted'", "", "1", "specimen -1"])
def test_other_text_stays(name):
    assert cell_text(name) == name == plain_text(name)


@given(st.lists(st.text(alphabet=st.sampled_from(list("=+-@'\"\t\r\n,;a1 .eε")), max_size=6), min_size=2))
def test_names_come_back_from_a_row_without_formulas(names):
    (row,) = csv.reader(io.StringIO(row_text(names), newline=""), strict=True)
    assert [plain_text(cell) for cell in row] == names
    assert not [cell for cell in row if cell[:1] in tuple("=+-@\t\r") and not _is_number(cell)]


def _is_number(text):
    try:
        float(text)
    except ValueError:
        return False
    return True


def test_notes_are_one_line_without_formulas():
    assert note_line("program: a,=cmd|'x'!A0;@b\n=1+1, -5") == "# program: a,'=cmd|'x'!A0;'@b =1+1, -5\n"
