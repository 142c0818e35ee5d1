"""Tables of stress and stretch, as papers and testing machines give them.

A CSV file with one row per point and a line of names: ``stretch``, or ``strain`` (λ − 1) or ``strain_pct``; and
``nominal_stress_MPa`` or ``true_stress_MPa``, also in Pa, kPa, N/mm2, psi. Further columns that are read: ``phase``
(loading or unloading), ``lateral_stretch``, ``u_stretch`` and ``u_nominal_stress_MPa`` (or of the true stress), the
standard uncertainties of single points. Others are ignored (:mod:`dicflow.io.table`).
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.errors import InputError
from dicflow.io.table import Numbers, read_table
from dicflow.io.text import printable

__all__ = ["StressTable", "read_stresses"]

_UNITS = {"MPa": 1.0, "kPa": 1e-3, "Pa": 1e-6, "GPa": 1e3, "N/mm2": 1.0, "N/mm²": 1.0, "psi": 6.894757293168e-3}
_STRESSES = ("nominal_stress", "true_stress")
_STRAINS = {"stretch": (1.0, 0.0), "strain": (1.0, 1.0), "strain_pct": (0.01, 1.0)}
_MAX_BYTES = 20_000_000
_MOST_ROWS = 100_000
_MOST_STRETCH, _MOST_STRESS = 1e3, 1e12


class StressTable(NamedTuple):
    """Points of one test, (n,) each; None for columns that the table lacks.

    stress : nominal, or true if ``is_true`` [MPa]
    """

    stretch: NDArray[np.float64]
    stress: NDArray[np.float64]
    is_true: bool
    phase: tuple[str, ...] | None
    lateral: NDArray[np.float64] | None
    u_stretch: NDArray[np.float64] | None
    u_stress: NDArray[np.float64] | None


class _Column(NamedTuple):
    """A column: its place, and factor and offset that make the quantity of it."""

    place: int
    factor: float = 1.0
    offset: float = 0.0


def read_stresses(path: Path) -> StressTable:
    """Read a table of stress and stretch. Raises InputError, with file and line, for any other table."""
    table = read_table(Path(path), "a table of stress and stretch", "stretch, nominal_stress_MPa", _MAX_BYTES)
    strain, stress, is_true = _strain_column(table.where, table.names), *_stress_column(table.where, table.names)
    columns = {"stretch": strain, "stress": stress, **_further(table.names, strain, is_true)}
    phase = table.names.index("phase") if "phase" in table.names else None
    numbers = Numbers()
    rows: list[list[float]] = []
    phases: list[str] = []
    for where, cells in table.rows:
        if len(rows) >= _MOST_ROWS:
            raise InputError(where, f"has more than {_MOST_ROWS:,} rows", "leave points out")
        rows.append([_number(numbers, where, table.names, cells, column) for column in columns.values()])
        phases.append("" if phase is None else _phase(where, cells[phase]))
    numbers.settle()
    if len(rows) < 2:
        raise InputError(table.where, f"has {len(rows)} rows below the names", "write two or more points")
    found = dict(zip(columns, np.array(rows).T, strict=True))
    _check(table.where, found)
    return StressTable(
        found["stretch"],
        found["stress"],
        is_true,
        tuple(phases) if phase is not None else None,
        found.get("lateral"),
        found.get("u_stretch"),
        found.get("u_stress"),
    )


def _strain_column(where: str, names: Sequence[str]) -> _Column:
    found = [name for name in names if name in _STRAINS]
    if len(found) != 1:
        amount = "no column" if not found else "several columns"
        problem = f"{amount} of the stretch among {printable(', '.join(names), 300)}"
        raise InputError(where, problem, "name one column stretch (1 at rest), strain (0 at rest) or strain_pct")
    return _Column(names.index(found[0]), *_STRAINS[found[0]])


def _stress_column(where: str, names: Sequence[str]) -> tuple[_Column, bool]:
    """The column of the stress, and whether it is the true one."""
    found = [name for name in names if "stress" in name and not name.startswith("u_")]
    remedy = f"name one column {_STRESSES[0]}_MPa or {_STRESSES[1]}_MPa; units: {', '.join(_UNITS)}"
    if len(found) != 1:
        amount = "no column" if not found else "several columns"
        raise InputError(where, f"{amount} of the stress among {printable(', '.join(names), 300)}", remedy)
    kind, _, unit = found[0].rpartition("_")
    if kind not in _STRESSES or unit not in _UNITS:
        unclear = "its unit" if kind in _STRESSES or found[0] in _STRESSES else "whether it is nominal or true"
        raise InputError(where, f"the column '{printable(found[0])}' does not say {unclear}", remedy)
    return _Column(names.index(found[0]), _UNITS[unit]), kind == "true_stress"


def _further(names: Sequence[str], strain: _Column, is_true: bool) -> dict[str, _Column]:
    """Columns of the lateral stretch and of uncertainties."""
    found = {}
    if "lateral_stretch" in names:
        found["lateral"] = _Column(names.index("lateral_stretch"))
    if (u_strain := f"u_{names[strain.place]}") in names:
        found["u_stretch"] = _Column(names.index(u_strain), strain.factor)
    for unit, factor in _UNITS.items():
        if (name := f"u_{_STRESSES[is_true]}_{unit}") in names:
            found["u_stress"] = _Column(names.index(name), factor)
    return found


def _number(numbers: Numbers, where: str, names: Sequence[str], cells: Sequence[str], column: _Column) -> float:
    value = numbers.read(where, names[column.place], cells[column.place], -_MOST_STRESS, _MOST_STRESS)
    return value * column.factor + column.offset


def _phase(where: str, cell: str) -> str:
    word = cell.strip().lower()
    if word not in ("loading", "unloading"):
        raise InputError(where, f"the phase is '{printable(cell)}'", "write loading or unloading")
    return word


def _check(where: str, found: dict[str, NDArray[np.float64]]) -> None:
    """Raise InputError for values that no specimen has."""
    for name in ("stretch", "lateral"):
        values = found.get(name, np.ones(1))
        if values.min() <= 0.0 or values.max() > _MOST_STRETCH:
            bad = values[(values <= 0.0) | (values > _MOST_STRETCH)][0]
            raise InputError(where, f"a stretch is {bad:g}", "write the length per first length, 1 at rest")
    for name in ("u_stretch", "u_stress"):
        if name in found and found[name].min() <= 0.0:
            raise InputError(where, "an uncertainty is not positive", "write standard uncertainties, or no column")
