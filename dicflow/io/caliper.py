"""Caliper tables: the length of the specimen at every step, as measured by hand.

A CSV file with the columns ``load_g`` and ``length_mm`` (or ``caliper_length_mm``), one row per step in the order of
the photographs. A column ``phase`` (loading or unloading) may be missing: then it follows from the loads. Other columns
and lines that start with ``#`` are ignored; the cells may also be separated by semicolons or tabs, with decimal commas
(:mod:`dicflow.io.table`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.core.channels.phases import phases_of
from dicflow.errors import InputError
from dicflow.io.table import Numbers, read_table
from dicflow.io.text import printable

__all__ = ["Caliper", "read_caliper"]

_LENGTHS = ("length_mm", "caliper_length_mm")
_MAX_BYTES = 5_000_000
_MOST_G = 1e9
_LEAST_MM, _MOST_MM = 1e-6, 1e6


class Caliper(NamedTuple):
    """A caliper table; one entry per step.

    phase : "loading" or "unloading"
    load_g : (step,) — mass of the weights [g]
    length_mm : (step,) — length of the region of interest [mm]
    """

    phase: tuple[str, ...]
    load_g: NDArray[np.float64]
    length_mm: NDArray[np.float64]


def read_caliper(path: Path) -> Caliper:
    """Read a caliper table.

    Raises InputError, with file and line, if it is not a caliper table.
    """
    numbers = Numbers()
    table = read_table(Path(path), "a caliper table", "load_g, length_mm, phase", _MAX_BYTES)
    phase, load, length = _columns(table.where, table.names)
    rows = [
        (
            "" if phase is None else _phase(where, cells[phase]),
            numbers.read(where, "load_g", cells[load], 0.0, _MOST_G),
            numbers.read(where, table.names[length], cells[length], _LEAST_MM, _MOST_MM),
        )
        for where, cells in table.rows
    ]
    numbers.settle()
    if not rows:
        raise InputError(table.where, "has no rows below the names", "write one row per step")
    phases, loads, lengths = zip(*rows, strict=True)
    return Caliper(phases_of(np.array(loads)) if phase is None else phases, np.array(loads), np.array(lengths))


def _columns(where: str, names: Sequence[str]) -> tuple[int | None, int, int]:
    """Places of phase, which may be missing, load and length."""
    needed = ("load_g", next((name for name in _LENGTHS if name in names), _LENGTHS[0]))
    wanted = ("phase", *needed) if "phase" in names else needed
    for name in wanted:
        if names.count(name) != 1:
            amount = "two columns" if name in names else "no column"
            problem = f"{amount} '{name}' among {printable(', '.join(names), 300)}"
            raise InputError(where, problem, f"name the columns {', '.join(wanted)}, each once")
    load, length = (names.index(name) for name in needed)
    return names.index("phase") if "phase" in names else None, load, length


def _phase(where: str, cell: str) -> str:
    word = cell.strip().lower()
    if word not in ("loading", "unloading"):
        raise InputError(where, f"the phase is '{printable(cell)}'", "write loading or unloading")
    return word
