"""When the photographs of a series were taken: by their files, by numbers in their names, or by a table."""

from __future__ import annotations

import re
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path

from dicflow.engine.files import FilePart, Stamp, stamp
from dicflow.errors import InputError
from dicflow.io.images.formats import is_video
from dicflow.io.images.taken import time_taken, utc_offset_taken
from dicflow.io.images.video import video_of
from dicflow.io.table import Numbers, read_table
from dicflow.io.text import printable

__all__ = ["moment_of", "read_times", "utc_offset_of"]

_MAX_BYTES = 50_000_000
_MOST_S = 1e12
_NUMBER = re.compile(r"\d+(?:\.\d+)?")

File = Path | FilePart


def moment_of(file: File, in_names: bool = False, table: Mapping[str, float] | None = None) -> float | None:
    """When a photograph was taken [s]; None if unknown.

    in_names : whether the last number in the file's name is the time
    table : the times by names of files or numbers of pages, which count alone
    Raises InputError where the table has no row for the photograph, or its name no number.
    """
    if table is not None:
        return _in_table(file, table)
    path = file.path if isinstance(file, FilePart) else file
    if in_names:
        return _in_name(path)
    if isinstance(file, FilePart):
        return video_of(path).times[file.number - 1] if is_video(path) else None
    return _taken(path, stamp(path))


def utc_offset_of(file: File, in_names: bool = False, table: Mapping[str, float] | None = None) -> float | None:
    """What the clock of :func:`moment_of` shows more than UTC [s]; None if unknown, as of frames, names and tables."""
    return None if table is not None or in_names or isinstance(file, FilePart) else utc_offset_taken(file)


@lru_cache(maxsize=100_000)
def _taken(path: Path, unchanged: Stamp) -> float | None:
    """The time by the file's metadata, looked up once. unchanged : the stamp of the file"""
    return time_taken(path)


def read_times(path: Path) -> dict[str, float]:
    """The table of times: name of a photograph's file, or number of a page → time [s].

    A CSV file with the columns ``name`` or ``number``, and ``time`` or ``time_s``. Raises InputError, with file and
    line, if it is not such a table.
    """
    numbers = Numbers()
    table = read_table(path, "a table of times", "name, time", _MAX_BYTES)
    name, time = (
        _column(table.where, table.names, "name", "number"),
        _column(table.where, table.names, "time", "time_s"),
    )
    times: dict[str, float] = {}
    for where, cells in table.rows:
        if times.setdefault(cells[name], found := numbers.read(where, "time", cells[time], -_MOST_S, _MOST_S)) != found:
            raise InputError(where, f"'{printable(cells[name])}' has two times", "keep one row of them")
    numbers.settle()
    return times


def _column(where: str, names: list[str], *wanted: str) -> int:
    found = [k for k, name in enumerate(names) if name.lower() in wanted]
    if len(found) != 1:
        remedy = f"name one column {' or '.join(wanted)}"
        raise InputError(where, f"expected one column {' or '.join(wanted)}, found {len(found)}", remedy)
    return found[0]


def _in_table(file: File, table: Mapping[str, float]) -> float:
    path = Path(file)
    part = str(file.number) if isinstance(file, FilePart) else ""
    names = (f"{path.stem}_{part}", f"{path.name}#{part}", part) if part else (path.name, path.stem)
    for name in names:
        if name in table:
            return table[name]
    raise InputError(f"{file}: the table of times has no row '{names[-1]}'; add one, or leave the photograph out")


def _in_name(path: Path) -> float:
    found = _NUMBER.findall(path.stem)
    if not found:
        raise InputError(f"{path}: its name has no number that could be the time; give a table of times")
    return float(found[-1])
