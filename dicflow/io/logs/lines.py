"""Where the rows of a log stand in its file, and how their cells are separated.

Machines write a block of facts first, of any form: the rows are the longest run of lines that have the same number of
cells and values in them. Names of columns stand right above, and perhaps a line of units. Cells are separated by tabs,
semicolons, commas or spaces, whichever gives most values.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from dicflow.errors import InputError
from dicflow.io.logs.clocks import is_clock, is_date
from dicflow.io.logs.numbers import MISSING, number_and_unit
from dicflow.io.logs.units import unit_named
from dicflow.io.table import cells_of
from dicflow.io.text import numbered_lines

__all__ = ["LogLines", "read_lines"]

_MAX_BYTES = 200_000_000
_SEPARATORS = ("\t", ";", ",", " ")
_SAMPLE = 1500
"""Lines from which the separator is found."""
_LONGEST = 2000
_MOST_COLUMNS = 500
_SIGN_APART = re.compile(r"(?<![^\s,;])([-+])\s+(?=[\d.])")
_SPACES = re.compile(r"\s+")
_REMEDY = "export the test as a table of text: a line of names with units, and one row per line"


class LogLines(NamedTuple):
    """The cells of a log.

    names : of the columns, empty texts where the log has none
    units : from a line of units below the names; empty texts otherwise
    numbers : of the line of each row
    rows : cells of each row, as many as there are names
    remarks : sentences about lines that are left out
    """

    names: Sequence[str]
    units: Sequence[str]
    numbers: Sequence[int]
    rows: Sequence[Sequence[str]]
    remarks: Sequence[str]


class _Line(NamedTuple):
    number: int
    cells: list[str]


def read_lines(path: Path) -> LogLines:
    """The rows of a log.

    Raises InputError, with file and line, if it cannot be read, holds no rows of values, or has one with other cells.
    """
    lines = [(number, line) for number, line in numbered_lines(path, "a log", _MAX_BYTES) if line.strip()]
    separator = _separator([line for _, line in lines[:_SAMPLE]])
    split = [_Line(number, _split(line, separator)) for number, line in lines]
    start, width = _block(split[:_SAMPLE])
    if not width:
        raise InputError(str(path), "no line of it has a number in a column of its own", _REMEDY)
    if width > _MOST_COLUMNS:
        raise InputError(f"{path}:{split[start].number}", f"has {width} columns", f"export {_MOST_COLUMNS} at most")
    start = _first_row(split, start)
    names, units = _header(split[:start], width)
    rows, remarks = _rows(path, split[start:], width)
    return LogLines(names, units, [row.number for row in rows], [row.cells for row in rows], remarks)


def _separator(lines: Sequence[str]) -> str:
    """The separator by which most cells of the rows hold values."""
    return max(_SEPARATORS, key=lambda separator: _score([_split(line, separator) for line in lines]))


def _score(lines: Sequence[Sequence[str]]) -> float:
    return max((score for _, _, score in _runs(lines)), default=0.0)


def _block(lines: Sequence[_Line]) -> tuple[int, int]:
    """Index of the first row, and how many cells rows have; 0 without rows."""
    runs = list(_runs([line.cells for line in lines]))
    start, width, score = max(runs, key=lambda run: run[2], default=(0, 0, 0.0))
    return (start, width) if score > 0 else (0, 0)


def _runs(lines: Sequence[Sequence[str]]) -> Iterator[tuple[int, int, float]]:
    """Start, number of cells and score of each run of lines with equally many cells and a value in each line."""
    start, width, score = 0, 0, 0.0
    for index, cells in enumerate(lines):
        values = sum(map(_is_value, cells[:_LONGEST]))
        if not values or len(cells) != width:
            if width:
                yield start, width, score
            start, width, score = index, len(cells) if values else 0, 0.0
        if values:
            score += values - 0.5 * sum(1 for cell in cells if cell.strip() and not _is_value(cell))
    if width:
        yield start, width, score


def _split(line: str, separator: str) -> list[str]:
    """Cells without spaces around them."""
    line = line.lstrip("\ufeff")
    if separator == " ":
        return _SPACES.split(_SIGN_APART.sub(r"\1", line.strip()))
    return [cell.strip() for cell in cells_of(line, separator)]


def _is_value(cell: str) -> bool:
    if not cell or not (cell[0].isdigit() or cell[0] in "+-.,\u2212"):
        return False
    return number_and_unit(cell) is not None or is_clock(cell) or is_date(cell)


def _header(lines: Sequence[_Line], width: int) -> tuple[list[str], list[str]]:
    """Names and units of the columns from the last lines above the rows."""
    names, units = [""] * width, [""] * width
    for line in reversed(lines[-3:]):
        cells = _as_header(line.cells, width)
        if cells is None:
            break
        if _are_units(cells) and not any(units):
            units = [cell.strip("[]()").strip() for cell in cells]
        else:
            return cells, units
    return names, units


def _as_header(cells: Sequence[str], width: int) -> list[str] | None:
    """The cells of a line of names or units; None for a line with other cells than the rows.

    The line may begin with a comment's sign, and lack cells at its end, which are left out where they are empty.
    """
    plain = [cell.lstrip("#%").strip() if index == 0 else cell for index, cell in enumerate(cells)]
    if plain and not plain[0] and len(plain) == width + 1:
        plain = plain[1:]
    if len(plain) > width or (len(plain) < width - 1 and len(plain) < 2) or any(map(_is_value, plain)):
        return None
    return [*plain, *[""] * (width - len(plain))]


def _are_units(cells: Sequence[str]) -> bool:
    """Whether all cells are units, in brackets or known ones."""
    given = [cell for cell in cells if cell]
    bracketed = [cell[0] + cell[-1] in ("[]", "()") for cell in given]
    return bool(given) and all(mark or unit_named(cell) for mark, cell in zip(bracketed, given, strict=True))


def _first_row(lines: Sequence[_Line], start: int) -> int:
    """Index of the first row: shorter lines above the run count if their values stand in the same columns."""
    pattern = _pattern(lines[start].cells)
    while start and 1 <= len(lines[start - 1].cells) < len(pattern):
        cells = lines[start - 1].cells
        if not _is_value(cells[0]) or _pattern(cells) != pattern[: len(cells)]:
            break
        start -= 1
    return start


def _pattern(cells: Sequence[str]) -> list[bool]:
    """Which cells hold values, or a word for a missing one."""
    return [_is_value(cell) or MISSING.fullmatch(cell) is not None for cell in cells]


def _rows(path: Path, lines: Sequence[_Line], width: int) -> tuple[list[_Line], list[str]]:
    """The rows, empty cells added where the last ones are left out, and remarks on lines that are left out.

    A line without values, such as an operator's note, is left out. After one, rows go on only where lines hold values
    in the same columns as the first row; what else follows is a summary of the test.
    """
    pattern = _pattern(lines[0].cells)
    rows: list[_Line] = []
    notes: list[int] = []
    for line in lines:
        if not any(map(_is_value, line.cells)) or (notes and _pattern(line.cells) != pattern[: len(line.cells)]):
            notes.append(line.number)
        elif len(line.cells) > width:
            problem = f"has {len(line.cells)} values for {width} columns"
            raise InputError(f"{path}:{line.number}", problem, "correct it; decimal commas need another separator")
        else:
            rows.append(line)
    remarks = (
        [f"{len(notes)} lines below its first row are no rows and left out, first line {notes[0]}"] if notes else []
    )
    if len(rows) > 1 and len(rows[-1].cells) < min(len(row.cells) for row in rows[:-1]):
        remarks.append(f"its last line, {rows.pop().number}, is cut off and left out")
    return [row._replace(cells=[*row.cells, *[""] * (width - len(row.cells))]) for row in rows], remarks
