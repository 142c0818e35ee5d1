"""Tables in text files, as programs and spreadsheets write them: a line of names, and rows.

Cells are separated by commas, semicolons or tabs, whichever the line of names has most of. Lines that begin with ``#``
are notes. Where the separator is another one, numbers may have a decimal comma: it is recognised if some number of the
table cannot have a separator of thousands there (``59,95``, ``0,004``), and refused if all could (``1,234``).

Text that a spreadsheet would run as a formula is written with an apostrophe before it, which is no part of the text.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

from dicflow.errors import InputError
from dicflow.io.text import numbered_lines, printable

__all__ = [
    "EXACT",
    "LOCALES",
    "Numbers",
    "Table",
    "TableStyle",
    "cell_text",
    "cells_of",
    "note_line",
    "plain_text",
    "read_table",
    "row_text",
]

_SEPARATORS = ",;\t"
_SEPARATOR_LINE = re.compile(r"sep=([,;\t])")
"""The first line by which a table names its separator to Excel."""
_LINES_ABOVE = 10_000
_WITH_COMMA = re.compile(r"[-+]?(?:\d++,\d*+|,\d++)(?:[eE][-+]?\d++)?", re.ASCII)
_NUMBER = re.compile(r"[-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?", re.ASCII)
_THOUSANDS = re.compile(r"[-+]?[1-9]\d{0,2},\d{3}", re.ASCII)
_FORMULA = re.compile(r"'*[\s\0]*[=+\-@＝＋－＠]|'*[\t\r]")
"""What spreadsheets take for a formula, or may after they have cut off what is before it."""
_QUOTED = re.compile(r'[",\r\n]')
_POINT = "write all numbers with a decimal point, and none with a separator of thousands"


class Table(NamedTuple):
    """A table, open at its first row.

    where : ``file:line`` of the line of names
    names : of the columns
    notes : lines above them that begin with ``#``
    rows : ``file:line`` and cells of each row, as many as there are names
    """

    where: str
    names: list[str]
    notes: list[str]
    rows: Iterator[tuple[str, list[str]]]


def read_table(path: Path, what: str, columns: str, most_bytes: int) -> Table:
    """Open a table. Rows are read one by one.

    what, columns : noun such as "a caliper table" and its usual columns, for messages
    Raises InputError, with file and line, if it cannot be read or has no line of names; and at a row with another
    number of cells.
    """
    lines, notes, separator = numbered_lines(path, what, most_bytes), [], ""
    for number, line in lines:
        if number > _LINES_ABOVE:
            break
        if _is_note(line):
            notes.append(line.strip(' \t;,"'))
        elif found := _SEPARATOR_LINE.fullmatch(line):
            separator = found[1]
        elif line.strip():
            separator = separator or max(_SEPARATORS, key=line.count)
            names = [plain_text(name.strip()) for name in cells_of(line, separator)]
            return Table(f"{path}:{number}", names, notes, _rows(path, lines, separator, len(names)))
    raise InputError(
        str(path), f"has no rows, expected {what}", f"write a line of names, {columns}, and one row per line"
    )


class Numbers:
    """Reads the numbers of one table, and finds out whether they have decimal commas."""

    def __init__(self) -> None:
        self._point = self._comma = ""
        self._unclear = ("", "")
        self._is_decimal = False

    def read(self, where: str, name: str, cell: str, least: float, most: float) -> float:
        """The number in a cell. Raises InputError for another text, and beyond ``least`` and ``most``."""
        value = self._value(where, cell.strip().replace("\u2212", "-"))
        if value is None or not least <= value <= most:
            problem = f"{name} is '{printable(cell.strip())}', expected a number from {least:,.10g} to {most:,.10g}"
            raise InputError(where, problem, "correct it, with a decimal point and no separator of thousands")
        return value

    def settle(self) -> None:
        """Raise InputError if commas in the numbers that were read have no clear meaning."""
        if self._comma and self._point:
            raise InputError(self._comma, f"has a comma in a number, but {self._point} a decimal point", _POINT)
        where, cell = self._unclear
        if where and not self._is_decimal:
            raise InputError(where, f"'{cell}' may be {cell.replace(',', '.')} or {cell.replace(',', '')}", _POINT)

    def _value(self, where: str, text: str) -> float | None:
        if "," in text:
            return self._with_comma(where, text)
        try:
            value = None if "_" in text else float(text)
        except ValueError:
            return None
        if not self._point and "." in text:
            self._point = where
        return value

    def _with_comma(self, where: str, text: str) -> float | None:
        if not _WITH_COMMA.fullmatch(text):
            return None
        self._comma = self._comma or where
        if not _THOUSANDS.fullmatch(text):
            self._is_decimal = True
        elif not self._unclear[0]:
            self._unclear = (where, text)
        return float(text.replace(",", "."))


class TableStyle(NamedTuple):
    """How numbers stand in a table.

    digits : significant ones of a number that is not whole; with 17 it comes back exactly
    separator : between cells
    decimal : sign before the decimals
    """

    digits: int = 6
    separator: str = ","
    decimal: str = "."

    def number(self, value: float) -> str:
        """A number of a cell."""
        text = str(value) if self.digits >= _ALL_DIGITS else f"{value:.{self.digits}g}"
        return text.replace(".", self.decimal)

    def cell(self, value: object) -> str:
        """A cell: a number, or text that no spreadsheet runs as a formula; None is empty."""
        if isinstance(value, float):
            return self.number(value)
        text = "" if value is None else cell_text(str(value))
        is_quoted = self.separator in text or _QUOTED.search(text)
        return '"' + text.replace('"', '""') + '"' if is_quoted else text


_ALL_DIGITS = 17
EXACT = TableStyle(_ALL_DIGITS)
LOCALES = {"en": TableStyle(), "de": TableStyle(separator=";", decimal=",")}
"""Styles of the spreadsheets of a language."""


def row_text(values: Iterable[object], style: TableStyle = EXACT) -> str:
    """A row of a table; None is an empty cell."""
    return style.separator.join(map(style.cell, values)) + "\n"


def cell_text(text: str) -> str:
    """Text for a cell: what a spreadsheet would run as a formula gets an apostrophe before it; numbers are left."""
    return f"'{text}" if _FORMULA.match(text) and not _NUMBER.fullmatch(text.strip(" ")) else text


def note_line(text: str) -> str:
    """A note as one line, of which no part is a formula, whichever separator a spreadsheet splits it at."""
    line = "# " + re.sub(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]", " ", text)
    return "".join(cell_text(part) for part in re.split(r"([,;])", line)) + "\n"


def plain_text(cell: str) -> str:
    """The text in a cell, without the apostrophe that :func:`cell_text` puts before it."""
    return cell[1:] if cell.startswith("'") and _FORMULA.match(cell[1:]) else cell


def _is_note(line: str) -> bool:
    """Whether a line is a note, which spreadsheets may have put into quotes."""
    return line.lstrip(' \t"').startswith("#")


def _rows(path: Path, lines: Iterable[tuple[int, str]], separator: str, width: int) -> Iterator[tuple[str, list[str]]]:
    name = str(path)
    for number, line in lines:
        if _is_note(line) or not line.strip(' \t;,"'):
            continue
        cells, where = cells_of(line, separator), f"{name}:{number}"
        if len(cells) != width:
            problem = f"has {len(cells)} values for {width} columns"
            raise InputError(where, problem, "write one for each, and decimal points if commas separate them")
        yield where, cells


def cells_of(line: str, separator: str) -> list[str]:
    """The cells of a line, without the quotes around them."""
    if '"' not in line:
        return line.split(separator)
    return next(csv.reader([line], delimiter=separator, skipinitialspace=True))
