"""Caliper tables: the length of the specimen at every step, as measured by hand.

A CSV file with the columns ``phase`` (loading or unloading), ``load_g`` and ``length_mm`` (or ``caliper_length_mm``),
one row per step in the order of the photographs. Other columns and lines that start with ``#`` are ignored.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.errors import InputError

__all__ = ["Caliper", "read_caliper"]

_LENGTHS = ("length_mm", "caliper_length_mm")


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
    numbered = list(enumerate(_text(path).splitlines(), start=1))
    lines = [(number, line) for number, line in numbered if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) < 2:
        raise InputError(f"{path}: has no rows; expected a header line 'phase,load_g,length_mm' and one row per step")
    records = [(number, next(csv.reader([line], skipinitialspace=True))) for number, line in lines]
    where, header = records[0]
    phase, load, length = _columns(f"{path}:{where}", [name.strip() for name in header])
    for number, row in records[1:]:
        if len(row) != len(header):
            raise InputError(f"{path}:{number}: has {len(row)} values for {len(header)} columns; write one for each")
    return Caliper(
        tuple(_phase(f"{path}:{number}", row[phase]) for number, row in records[1:]),
        np.array([_number(f"{path}:{number}", "load_g", row[load], 0.0) for number, row in records[1:]]),
        np.array([_number(f"{path}:{number}", header[length], row[length], 1e-6) for number, row in records[1:]]),
    )


def _text(path: Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a caliper table ({error}); give a CSV file in UTF-8") from error


def _columns(where: str, header: Sequence[str]) -> tuple[int, int, int]:
    """Places of phase, load and length."""
    needed = ("phase", "load_g", next((name for name in _LENGTHS if name in header), _LENGTHS[0]))
    for name in needed:
        if name not in header:
            raise InputError(
                f"{where}: no column '{name}' among {', '.join(header)}; the table needs {', '.join(needed)}"
            )
    phase, load, length = (header.index(name) for name in needed)
    return phase, load, length


def _phase(where: str, text: str) -> str:
    word = text.strip().lower()
    if word not in ("loading", "unloading"):
        raise InputError(f"{where}: the phase is '{text}'; write loading or unloading")
    return word


def _number(where: str, column: str, text: str, least: float) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not (math.isfinite(value) and value >= least):
        kind = "a positive number" if least > 0.0 else "0 or a positive number"
        raise InputError(f"{where}: {column} is '{text.strip()}'; expected {kind}")
    return value
