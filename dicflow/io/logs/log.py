"""A log as columns of numbers in the units of channels, and the times of its rows."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from dicflow.errors import InputError
from dicflow.io.logs.clocks import Clock, is_clock, is_date, read_clocks
from dicflow.io.logs.lines import LogLines, read_lines
from dicflow.io.logs.numbers import MISSING, NumberStyle, number_and_unit, style_of
from dicflow.io.logs.units import in_brackets, known_units, unit_named, without_unit
from dicflow.io.text import printable

__all__ = ["RESERVED", "Log", "LogColumn", "Selection", "read_log"]

_ROLES: Mapping[str, tuple[str, re.Pattern[str]]] = {
    "force": ("N", re.compile(r"force|load|kraft|last|weight|mass|gewicht|masse|charge|carga|forza", re.I)),
    "crosshead": ("mm", re.compile(r"crosshead|extension|stroke|position|travers|weg|displacement|travel|hub", re.I)),
    "temperature": ("°C", re.compile(r"temp", re.I)),
}
"""Name of a channel → unit, and words in the titles of columns that mean it."""
_TIME = re.compile(r"(?:.*\b)?(?:time|zeit|elapsed|timestamp|uhrzeit|temps|tiempo)(?:\b.*)?|t", re.I)
_STEP = re.compile(r"(?:.*\b)?(?:step|image|picture|photo\w*|frame|bild|schritt|file|datei)(?:\b.*)?", re.I)
RESERVED = ("time", "step")
"""Names of the columns with the rows' times, and with the steps' names."""
_MOST, _MOST_S = 1e9, 5e9
"""Of a value in the unit of its channel, and of a time [s]."""
_CENTURY = (946_684_800.0, 4_102_444_800.0)
"""Seconds from 1970 to the years 2000 and 2100."""
_NAME = re.compile(r"[^a-z0-9]+")


class Selection(NamedTuple):
    """What is read from a log.

    columns : channel → title of its column, or number of it from 1; empty for all columns with a unit. ``time`` and
        ``step`` are the columns of the rows' times and of the steps' names
    units : channel → unit of its column, where the log gives none
    decimal : decimal sign; None to find it
    """

    columns: Mapping[str, str | int] = {}
    units: Mapping[str, str] = {}
    decimal: Literal[".", ","] | None = None


_ALL = Selection()


class LogColumn(NamedTuple):
    """One quantity. values : (row,), NaN where a cell is empty; unit : N, mm, s, °C …; title : as in the log"""

    values: np.ndarray
    unit: str
    title: str


class Log(NamedTuple):
    """A log.

    where : the file
    numbers : line of each row
    columns : channel → its column
    clock : times of the rows [s]; None if the log has none
    steps : name or number of the step of each row, as the log gives it; None if it has none
    remarks : sentences about what is left out
    """

    where: str
    numbers: Sequence[int]
    columns: Mapping[str, LogColumn]
    clock: Clock | None
    steps: Sequence[str] | None
    remarks: Sequence[str]


_STANDSTILL = 20
"""Times the median number of rows with one time above which a clock stands still."""


class _Columns(NamedTuple):
    """Titles, units and cells of all columns."""

    titles: list[str]
    units: list[str]
    cells: list[tuple[str, ...]]


def read_log(path: Path, selection: Selection = _ALL) -> Log:
    """Read a log.

    Raises InputError, with file and line, for a file that is not a log, a column that it lacks, an unknown unit, cells
    that are not numbers, and times that run backwards.
    """
    lines = read_lines(Path(path))
    columns = _columns_of(lines)
    chosen = {name: _find(path, columns, name, given) for name, given in selection.columns.items()}
    time = chosen.pop("time", None)
    time = _time_column(columns, set(chosen.values())) if time is None else time
    step = chosen.pop("step", None)
    step = _step_column(columns, {time, *chosen.values()}) if step is None else step
    reader = _Reader(Path(path), lines, columns, selection)
    remarks = list(lines.remarks)
    if not chosen:
        chosen, left_out = reader.all_with_units({time, step})
        remarks += left_out
    found = {name: reader.column(name, index) for name, index in chosen.items()}
    clock = None if time is None else reader.clock(time)
    if clock is not None:
        remarks += reader.standstill(clock.seconds)
    steps = None if step is None else columns.cells[step]
    return Log(str(path), lines.numbers, found, clock, steps, remarks)


def _columns_of(lines: LogLines) -> _Columns:
    """The columns; a column of units is left out, and its units go to the numbers before it."""
    cells = list(zip(*lines.rows, strict=True))
    titles, units = [], []
    for name, unit in zip(lines.names, lines.units, strict=True):
        title, own = (name.strip(), unit) if unit else without_unit(name)
        titles.append(title)
        units.append(own or in_brackets(name))
    for index in range(1, len(cells)):
        if _is_number_column(cells[index - 1]) and not units[index - 1] and _is_unit_column(cells[index]):
            cells[index - 1] = tuple(
                f"{value} {unit}" for value, unit in zip(*cells[index - 1 : index + 1], strict=True)
            )
            cells[index] = ("",) * len(cells[index])
    return _Columns(titles, units, cells)


def _is_number_column(cells: Sequence[str]) -> bool:
    return any(number_and_unit(cell) for cell in cells if cell)


def _is_unit_column(cells: Sequence[str]) -> bool:
    return all(unit_named(cell) is not None and not cell.isdigit() for cell in cells)


def _find(path: Path, columns: _Columns, name: str, given: str | int) -> int:
    """Index of the column of a channel."""
    if isinstance(given, int):
        if 1 <= given <= len(columns.titles):
            return given - 1
        raise InputError(str(path), f"has no column {given} for '{name}'", f"it has {len(columns.titles)}")
    wanted = _plain(given)
    found = [i for i, title in enumerate(columns.titles) if wanted == _plain(title)]
    found = found or [i for i, title in enumerate(columns.titles) if wanted == _plain(f"{title} [{columns.units[i]}]")]
    if len(found) == 1:
        return found[0]
    known = printable(", ".join(title or f"(column {i})" for i, title in enumerate(columns.titles, 1)), 400)
    if found:
        places = ", ".join(str(i + 1) for i in found)
        raise InputError(str(path), f"has {len(found)} columns '{given}'", f"name one by its number: {places}")
    raise InputError(str(path), f"has no column '{printable(given)}' for '{name}'", f"its columns are {known}")


def _plain(title: str) -> str:
    return re.sub(r"[\s\[\]()_/]+", " ", title).strip().casefold()


def _time_column(columns: _Columns, taken: set[int]) -> int | None:
    """The column with the times of the rows: of clocks, else with a title that says so, first with decimals."""
    free = [i for i in range(len(columns.titles)) if i not in taken]
    clocks = [i for i in free if any(map(is_clock, columns.cells[i]))]
    titled = [i for i in free if _TIME.fullmatch(columns.titles[i]) and _is_number_column(columns.cells[i])]
    timed = [i for i in titled if (unit := unit_named(columns.units[i])) is not None and unit.name == "s"]
    return next(iter((*timed, *clocks, *titled)), None)


def _step_column(columns: _Columns, taken: set[int | None]) -> int | None:
    """The column with the names of the steps; None without one."""
    free = [i for i, title in enumerate(columns.titles) if i not in taken and not columns.units[i]]
    return next((i for i in free if _STEP.fullmatch(columns.titles[i]) and any(columns.cells[i])), None)


class _Reader:
    """Reads the columns of one log."""

    def __init__(self, path: Path, lines: LogLines, columns: _Columns, selection: Selection) -> None:
        self.path, self.lines, self.columns, self.selection = path, lines, columns, selection
        self._style: NumberStyle | None = None

    def where(self, row: int) -> str:
        """``file:line`` of a row."""
        return f"{self.path}:{self.lines.numbers[row]}"

    @property
    def style(self) -> NumberStyle:
        """How the numbers of the log are written."""
        if self._style is None:
            found = NumberStyle(self.selection.decimal) if self.selection.decimal else style_of(self._numbers())
            if not isinstance(found, NumberStyle):
                where, text = found
                problem = f"'{printable(text)}' may have a decimal comma, or one that parts thousands"
                raise InputError(where, problem, "say which with decimal: ',' or decimal: '.'")
            self._style = found
        return self._style

    def _numbers(self) -> list[tuple[str, str]]:
        return [
            (self.where(row), parsed[0])
            for cells in self.columns.cells
            for row, cell in enumerate(cells)
            if ("," in cell or "." in cell) and not is_date(cell) and (parsed := number_and_unit(cell)) is not None
        ]

    def column(self, name: str, index: int) -> LogColumn:
        """The numbers of a column in the units of channels."""
        values, unit = self.numbers(name, index, self.selection.units.get(name) or self.columns.units[index])
        return LogColumn(values, unit, self.columns.titles[index] or name)

    def numbers(self, name: str, index: int, given: str) -> tuple[np.ndarray, str]:
        """Values (row,) and their unit; a cell may have its own unit behind the number."""
        values = np.full(len(self.lines.rows), np.nan)
        names: set[str] = set()
        for row, cell in enumerate(self.columns.cells[index]):
            if MISSING.fullmatch(cell):
                continue
            number, own = number_and_unit(cell) or ("", "")
            value, unit = self.style.read(number), unit_named(own or given)
            if value is None:
                raise InputError(
                    self.where(row), f"{name} is '{printable(cell)}', expected a number", "correct the cell"
                )
            if unit is None:
                raise self._unknown_unit(row, name, own or given)
            names.add(unit.name)
            values[row] = unit.factor * value + unit.shift
            if abs(values[row]) > (_MOST_S if unit.name == "s" else _MOST):
                problem = f"{name} is '{printable(cell)}', more than {_MOST:,.0f} {unit.name}"
                raise InputError(self.where(row), problem, "correct the cell, or its unit")
        if len(names) > 1:
            raise InputError(
                str(self.path), f"{name} has values in {' and in '.join(sorted(names))}", "choose a column"
            )
        return values, next(iter(names), "1")

    def _unknown_unit(self, row: int, name: str, unit: str) -> InputError:
        problem = f"{name} has the unknown unit '{printable(unit)}'" if unit else f"{name} has no unit"
        return InputError(self.where(row), problem, f"give it with units: {{{name}: …}}, one of {known_units()}")

    def all_with_units(self, taken: set[int | None]) -> tuple[dict[str, int], list[str]]:
        """Name → index of all columns of numbers with a known unit, and remarks on those without."""
        found: dict[str, int] = {}
        remarks = []
        for index, cells in enumerate(self.columns.cells):
            if index in taken or not _is_number_column(cells) or any(map(is_clock, cells)) or any(map(is_date, cells)):
                continue
            unit = unit_named(self._unit_of(index))
            if unit is None:
                title = self.columns.titles[index] or f"column {index + 1}"
                remarks.append(
                    f"{printable(title)} is left out, since it has no known unit; name it under columns and units"
                )
            else:
                found[_channel_name(self.columns.titles[index], unit.name, found)] = index
        return found, remarks

    def _unit_of(self, index: int) -> str:
        """Unit of a column, else that behind its first number."""
        behind = (parsed[1] for cell in self.columns.cells[index] if (parsed := number_and_unit(cell)) is not None)
        return self.columns.units[index] or next(behind, "")

    def clock(self, index: int) -> Clock:
        """Times of the rows. Raises InputError if they run backwards."""
        cells = self.columns.cells[index]
        if any(map(is_clock, cells)):
            dates = next((one for one in self.columns.cells if any(map(is_date, one))), None)
            clock = read_clocks(cells, dates)
        else:
            seconds, unit = self.numbers("time", index, self.selection.units.get("time") or self.columns.units[index])
            if unit != "s":
                raise self._unknown_unit(0, "time", unit)
            since_1970 = _is_since_1970(seconds)
            clock = Clock(seconds, since_1970, utc=seconds if since_1970 else None)
        self._check_forwards(clock.seconds)
        return clock

    def standstill(self, seconds: np.ndarray) -> list[str]:
        """A remark on the longest run of rows with one time, unless the clock is only coarser than the rows."""
        _, first, counts = np.unique(seconds[np.isfinite(seconds)], return_index=True, return_counts=True)
        if not counts.size or counts.max() < _STANDSTILL * np.median(counts):
            return []
        rows = np.flatnonzero(np.isfinite(seconds))[first[counts.argmax()] :]
        line, last = self.lines.numbers[rows[0]], self.lines.numbers[rows[counts.max() - 1]]
        return [f"its clock stands still from line {line} to {last}; of these {counts.max()} rows the mean counts"]

    def _check_forwards(self, seconds: np.ndarray) -> None:
        known = np.flatnonzero(np.isfinite(seconds))
        back = np.flatnonzero(np.diff(seconds[known]) < 0)
        if back.size:
            row, before = known[back[0] + 1], known[back[0]]
            raise InputError(
                self.where(int(row)),
                f"the time runs backwards, by {seconds[before] - seconds[row]:.4g} s",
                "cut the log there into two, one for each test, or correct the times below if its clock was set back",
            )


def _is_since_1970(seconds: np.ndarray) -> bool:
    """Whether seconds are those of a computer's clock in this century."""
    known = seconds[np.isfinite(seconds)]
    return bool(known.size) and _CENTURY[0] <= known[0] <= _CENTURY[1]


def _channel_name(title: str, unit: str, taken: Mapping[str, int]) -> str:
    """Name of a channel by the title of its column; numbered where that would stand twice."""
    role = next((name for name, (of, words) in _ROLES.items() if of == unit and words.search(title)), "")
    plain = _NAME.sub("_", title.lower()).strip("_")
    base = role or (
        plain if plain and plain[0].isalpha() else f"channel_{plain}" if plain else _BY_UNIT.get(unit, "value")
    )
    name, number = base, 2
    while name in taken or name in RESERVED:
        name, number = f"{base}_{number}", number + 1
    return name


_BY_UNIT = {"N": "force", "mm": "crosshead", "°C": "temperature"}
