import numpy as np
import pytest

from dicflow.errors import InputError
from dicflow.io.caliper import read_caliper


def written(tmp_path, text):
    path = tmp_path / "lengths.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_table(tmp_path):
    path = written(tmp_path, "phase,load_g,length_mm\nloading,0,59.95\nLoading, 68.53, 64.4\nunloading,0,60\n")
    table = read_caliper(path)
    assert table.phase == ("loading", "loading", "unloading")
    assert np.array_equal(table.load_g, [0.0, 68.53, 0.0])
    assert np.array_equal(table.length_mm, [59.95, 64.4, 60.0])


def test_without_a_column_of_phases_they_follow_from_the_loads(tmp_path):
    table = read_caliper(written(tmp_path, "load_g,length_mm\n0,60\n100,70\n200,80\n90,72\n0,60\n"))
    assert table.phase == ("loading",) * 3 + ("unloading",) * 2


def test_comments_blank_lines_a_mark_and_other_columns(tmp_path):
    text = "\ufeff# specimen 3\n\nlength, caliper_length_mm ,phase,load_g\n# at rest\na,59.95,loading,0\n\n"
    assert read_caliper(written(tmp_path, text)).length_mm.tolist() == [59.95]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "has no rows"),
        ("phase,load_g,length_mm\n", "has no rows"),
        ("phase,load_g,size\nloading,0,1\n", r"lengths\.csv:1: no column 'length_mm' among phase, load_g, size"),
        ("# a\nphase,length_mm\nloading,1\n", r"lengths\.csv:2: no column 'load_g'"),
        ("phase,load_g,length_mm\nloading,0,1\nloading,1\n", r"lengths\.csv:3: has 2 values for 3 columns"),
        (
            "phase,load_g,length_mm\nloading,0,59;9\n",
            r"lengths\.csv:2: length_mm is '59;9', expected a number",
        ),
        ("phase,load_g,length_mm\nloading,0,0\n", r"lengths\.csv:2: length_mm is '0'"),
        ("phase,load_g,length_mm\nloading,-1,5\n", r"lengths\.csv:2: load_g is '-1', expected a number from 0"),
        ("phase,load_g,length_mm\nloading,nan,5\n", r"lengths\.csv:2: load_g is 'nan'"),
        (
            "phase,load_g,length_mm\nresting,0,5\n",
            r"lengths\.csv:2: the phase is 'resting'; write loading or unloading",
        ),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_caliper(written(tmp_path, text))


def test_a_missing_or_binary_file_is_named(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_caliper(tmp_path / "absent.csv")
    path = tmp_path / "picture.csv"
    path.write_bytes(b"\xff\xd8\xff\xe0\x00\x10JFIF\x00")
    with pytest.raises(InputError, match=r"picture\.csv:1:5: holds the control character U\+0000"):
        read_caliper(path)


TABLE = "phase,load_g,length_mm\nloading,0,59.95\nLoading,68.53,64.4\nunloading,0,60\n"


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "cp1252"])
@pytest.mark.parametrize("separator", [";", "\t"])
def test_tables_of_a_spreadsheet_with_decimal_commas(tmp_path, separator, encoding):
    path = tmp_path / "lengths.csv"
    text = TABLE.replace(",", separator).replace(".", ",").replace("\n", "\r\n")
    path.write_bytes(f"# Prüfung{separator}{separator}\r\n{text}{separator}{separator}\r\n".encode(encoding))
    table = read_caliper(path)
    assert table.load_g.tolist() == [0.0, 68.53, 0.0]
    assert table.length_mm.tolist() == [59.95, 64.4, 60.0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TABLE.replace(",", ";").replace("59.95", "1,234"), r"lengths\.csv:2: has a comma in a number"),
        ("phase;load_g;length_mm\nloading;5;1,234\n", r"lengths\.csv:2: '1,234' may be 1\.234 or 1234"),
        (TABLE.replace("59.95", "59,95"), r"lengths\.csv:2: has 4 values for 3 columns; .*decimal points"),
        (TABLE.replace("68.53", "1e308"), r"lengths\.csv:3: load_g is '1e308', .*1,000,000,000"),
        (TABLE.replace("64.4", "inf"), r"lengths\.csv:3: length_mm is 'inf', .*1,000,000"),
        (TABLE.replace("loading,0", "\x1b[2J,0", 1), r"lengths\.csv:2:1: .*U\+001B"),
        (TABLE.replace("phase,", "phase,phase,", 1), r"lengths\.csv:1: two columns 'phase'"),
    ],
)
def test_numbers_without_a_clear_or_a_possible_meaning_are_refused(tmp_path, text, message):
    with pytest.raises(InputError, match=message):
        read_caliper(written(tmp_path, text))
