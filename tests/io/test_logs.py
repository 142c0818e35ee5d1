"""Logs of machines: units, numbers, clocks, and where the rows stand."""

import numpy as np
import pytest

from dicflow.errors import InputError
from dicflow.io.logs.clocks import is_clock, is_date, read_clocks
from dicflow.io.logs.log import Selection, read_log
from dicflow.io.logs.numbers import NumberStyle, number_and_unit, style_of
from dicflow.io.logs.units import unit_named, without_unit
from tests.log_files import START, balance_log, logger_log, machine_log


def written(tmp_path, data):
    path = tmp_path / "log.csv"
    path.write_bytes(data if isinstance(data, bytes) else data.encode())
    return path


def read(tmp_path, data, **selection):
    return read_log(written(tmp_path, data), Selection(**selection))


@pytest.mark.parametrize(
    ("name", "value", "unit", "expected"),
    [
        ("kN", 2.5, "N", 2500.0),
        ("g", 118.53, "N", 0.11853 * 9.80665),
        ("kg", 1.0, "N", 9.80665),
        ("lbf", 1.0, "N", 4.4482216152605),
        ("mN", 1.0, "N", 1e-3),
        ("MN", 1.0, "N", 1e6),
        ("µm", 5.0, "mm", 5e-3),
        ("\u03bcm", 5.0, "mm", 5e-3),
        ("(in)", 1.0, "mm", 25.4),
        ("mm/min", 50.0, "mm/s", 50.0 / 60.0),
        ("K", 293.15, "°C", 20.0),
        ("°F", 212.0, "°C", 100.0),
        ("min", 2.0, "s", 120.0),
        ("%", 3.0, "1", 0.03),
    ],
)
def test_units(name, value, unit, expected):
    found = unit_named(name)
    assert found.name == unit
    assert found.convert(value) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize(
    ("title", "parts"),
    [
        ("Load (kN)", ("Load", "kN")),
        ("Standardkraft in N", ("Standardkraft", "N")),
        ("load_g", ("load", "g")),
        ("Zeit / s", ("Zeit", "s")),
        ("Extension, mm", ("Extension", "mm")),
        ("Speed [mm/min]", ("Speed", "mm/min")),
        ("Sensor A", ("Sensor A", "")),
        ("Load [foo]", ("Load [foo]", "")),
        ("Force", ("Force", "")),
    ],
)
def test_units_in_titles(title, parts):
    assert without_unit(title) == parts


@pytest.mark.parametrize(
    ("texts", "numbers"),
    [
        (["1.5", "2"], [1.5, 2.0]),
        (["59,95", "1.234,5"], [59.95, 1234.5]),
        (["1,234.5", "999"], [1234.5, 999.0]),
        (["1.234.567", "0,5"], [1234567.0, 0.5]),
        (["1 234,5", "1\u00a0000"], [1234.5, 1000.0]),
        (["1'234.50", "-7"], [1234.5, -7.0]),
        (["+ 12.3", "\u22124.5e-3"], [12.3, -4.5e-3]),
        (["1.234", "5.678"], [1.234, 5.678]),
        (["0,123", "1,234"], [0.123, 1.234]),
    ],
)
def test_numbers_of_every_style(texts, numbers):
    parsed = [number_and_unit(text) for text in texts]
    style = style_of([("", text) for text, _ in parsed])
    assert [style.read(text) for text, _ in parsed] == numbers


def test_a_number_and_its_unit_in_one_cell():
    assert number_and_unit("+   12.34 g") == ("+   12.34", "g")
    assert number_and_unit("12") == ("12", "")
    assert number_and_unit("stable") is None
    assert NumberStyle(",").read("12.34") is None


def test_commas_with_two_meanings_are_refused():
    assert style_of([("a:1", "1,234"), ("a:2", "2,500")]) == ("a:1", "1,234")
    assert style_of([("a:1", "0.5"), ("a:2", "59,95")]) == ("a:1", "0.5")


@pytest.mark.parametrize(
    ("cells", "seconds"),
    [
        (["10:15:00", "10:15:00.250"], [36900.0, 36900.25]),
        (["1:02:03 PM", "1:02:04,5 pm"], [46923.0, 46924.5]),
        (["2026-03-12 10:15:00", "2026-03-12T10:15:01.5Z"], [START, START + 1.5]),
        (["12.03.2026 10:15:00", "12.03.2026 10:15"], [START, START]),
        (["23:59:59", "0:00:01"], [86399.0, 86401.0]),
        (["12/31/2025 23:59:59", "01/01/2026 0:00:01"], [1767225599.0, 1767225601.0]),
        (["10:15:00", ""], [36900.0, np.nan]),
    ],
)
def test_clocks(cells, seconds):
    np.testing.assert_allclose(read_clocks(cells).seconds, seconds, rtol=0, atol=1e-6)


def test_clocks_that_say_how_far_they_are_from_utc():
    clock = read_clocks(["2026-03-12 10:15:00+01:00", "2026-03-12 04:15:01 -0500", ""])
    np.testing.assert_array_equal(clock.utc, [START - 3600.0, START - 3600.0 + 1.0, np.nan])
    assert read_clocks(["2026-03-12 10:15:00+01:00", "2026-03-12 10:15:01"]).utc is None


def test_a_date_that_may_be_two_is_not_used():
    clock = read_clocks(["03/05/2026 10:15:00", "03/05/2026 10:15:01"])
    assert not clock.has_date
    assert clock.seconds.tolist() == [36900.0, 36901.0]
    spread = read_clocks(["03/05/2026 10:15:00", "03/06/2026 10:15:00"])
    assert spread.has_date
    assert np.diff(spread.seconds).tolist() == [86400.0]


def test_what_is_neither_date_nor_clock():
    assert is_date("12.03.2026")
    assert is_clock("10:15")
    assert not any(map(is_date, ["1.5", "32.13.2026", "2026"]))
    assert not any(map(is_clock, ["1.5", "S: D", "10:15:00,1.5"]))


def test_a_machines_export(tmp_path):
    seconds = np.arange(0.0, 2000.0, 7.5)
    log = read(tmp_path, machine_log(seconds, 2.0 * seconds, 0.25 * seconds))
    assert {name: (column.unit, column.title) for name, column in log.columns.items()} == {
        "crosshead": ("mm", "Extension"),
        "force": ("N", "Load"),
    }
    np.testing.assert_allclose(log.columns["force"].values, 2.0 * seconds)
    np.testing.assert_allclose(log.clock.seconds, seconds)
    assert not log.clock.has_date
    assert log.numbers[0] == 12


def test_a_balances_lines(tmp_path):
    seconds = np.arange(0.0, 20.0, 0.5)
    log = read(tmp_path, balance_log(seconds, 4.0 * seconds - 30.0))
    assert list(log.columns) == ["force"]
    np.testing.assert_allclose(log.columns["force"].values, (4.0 * seconds - 30.0) * 9.80665e-3)
    np.testing.assert_allclose(log.clock.seconds, START + seconds)
    assert log.clock.has_date


def test_a_loggers_file(tmp_path):
    seconds = np.arange(0.0, 20.0, 0.5)
    log = read(tmp_path, logger_log(seconds, 20.0 + seconds / 4.0, 1e-3 * seconds))
    np.testing.assert_allclose(log.columns["temperature"].values, 20.0 + seconds / 4.0, atol=0.006)
    np.testing.assert_allclose(log.columns["force"].values, seconds, atol=1e-9)
    np.testing.assert_allclose(log.clock.seconds, START + seconds)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "cp1252"])
def test_encodings_and_a_line_of_units(tmp_path, encoding):
    text = "Prüfung;latex\n\nZeit;Kraft;Temperatur\ns;kN;°C\n0;0,001;20,5\n1;0,002;20,6\n"
    log = read(tmp_path, text.encode(encoding))
    assert log.columns["force"].values.tolist() == [1.0, 2.0]
    assert log.columns["temperature"].unit == "°C"
    assert log.clock.seconds.tolist() == [0.0, 1.0]


def test_values_that_were_not_measured_are_unknown(tmp_path):
    log = read(tmp_path, "time [s],force [N],temp [°C]\n0,1,OL\n1,---,20\n2,3,\n")
    np.testing.assert_array_equal(log.columns["force"].values, [1.0, np.nan, 3.0])
    np.testing.assert_array_equal(log.columns["temperature"].values, [np.nan, 20.0, np.nan])


def test_notes_and_a_cut_line_are_left_out_and_named(tmp_path):
    text = "time [s];force [N];temp [°C]\n0;1;20\n1;2;20\noperator: paused\n2;3;20\nMaximum;3;;\n3;4"
    log = read(tmp_path, text)
    assert log.columns["force"].values.tolist() == [1.0, 2.0, 3.0]
    assert "first line 4" in log.remarks[0]
    assert "last line, 7, is cut off" in log.remarks[1]


def test_columns_by_title_and_number_and_units_that_are_given(tmp_path):
    text = "t,A,A,cycle\n0,1.5,2,7\n1,2.5,3,7\n"
    columns = {"time": "t", "force": 2, "count": "cycle"}
    log = read(tmp_path, text, columns=columns, units={"time": "ms", "force": "kg", "count": "1"})
    np.testing.assert_allclose(log.columns["force"].values, np.array([1.5, 2.5]) * 9.80665)
    assert log.columns["count"].unit == "1"
    assert log.clock.seconds.tolist() == [0.0, 0.001]


@pytest.mark.parametrize(
    ("text", "selection", "message"),
    [
        ("nothing\nbut words\n", {}, r"log\.csv: no line of it has a number"),
        ("", {}, r"log\.csv: no line"),
        ("a [N],b [N]\n1,2\n1,2\n3,4,5\n", {}, r"log\.csv:4: has 3 values for 2 columns"),
        ("a [N],b [N]\n1,2\n", {"columns": {"force": 3}}, "no column 3 for 'force'"),
        ("a [N],b [mm]\n1,2\n", {"columns": {"force": "c"}}, "no column 'c' for 'force'; its columns are a, b"),
        ("a,b [mm]\n1 N,2\n1 mm,3\n", {"columns": {"x": "a"}}, "x has values in N and in mm"),
        ("a [kN],b [mm]\n1e9,2\n", {}, r"log\.csv:2: force|log\.csv:2: a is '1e9'"),
        ("time [N],b [mm]\n1,2\n", {"columns": {"time": "time"}}, "time has the unknown unit 'N'"),
    ],
)
def test_what_is_wrong_is_named(tmp_path, text, selection, message):
    with pytest.raises(InputError, match=message):
        read(tmp_path, text, **selection)


@pytest.mark.parametrize(
    ("times", "remarks"),
    [
        (
            np.minimum(np.arange(60.0), 30.0),
            ["its clock stands still from line 42 to 71; of these 30 rows the mean counts"],
        ),
        (np.arange(60.0) // 10, []),
    ],
)
def test_a_clock_that_stands_still_is_told_from_a_coarse_one(tmp_path, times, remarks):
    path = tmp_path / "log.csv"
    path.write_bytes(machine_log(times, times, times))
    assert list(read_log(path).remarks) == remarks
