"""Tables of stress and stretch, as papers and testing machines give them.

A CSV file with one row per point and a line of names: ``stretch``, or ``strain`` (λ − 1) or ``strain_pct``; and
``nominal_stress_MPa`` or ``true_stress_MPa``, also in Pa, kPa, N/mm2, psi. Further columns that are read: ``phase``
(loading or unloading), ``lateral_stretch``, ``u_stretch`` and ``u_nominal_stress_MPa`` (or of the true stress), the
standard uncertainties of single points, and ``common_stretch`` and ``common_nominal_stress_MPa``, those that all points
share. Of both stresses the nominal one counts. Others are ignored (:mod:`dicflow.io.table`). A point whose stretch or
stress is empty is unknown. So the exported table of a curve is read as well.
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
    """Points of one test, (n,) each, NaN where unknown; None for columns that the table lacks.

    stress : nominal, or true if ``is_true`` [MPa]
    common_stress, common_stretch : uncertainties that all points share, relative to the stresses and stretches
    """

    stretch: NDArray[np.float64]
    stress: NDArray[np.float64]
    is_true: bool
    phase: tuple[str, ...] | None
    lateral: NDArray[np.float64] | None
    u_stretch: NDArray[np.float64] | None
    u_stress: NDArray[np.float64] | None
    common_stress: float | None
    common_stretch: float | None


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
        _share(found, "stress"),
        _share(found, "stretch"),
    )


def _share(found: dict[str, NDArray[np.float64]], name: str) -> float | None:
    """The common uncertainty of a quantity, relative to it; None without its column."""
    if (common := found.get(f"common_{name}")) is None:
        return None
    size = np.abs(found[name])
    known = np.isfinite(size) & (size > 0.0)
    return float(np.median(common[known] / size[known])) if known.any() else 0.0


def _strain_column(where: str, names: Sequence[str]) -> _Column:
    found = [name for name in names if name in _STRAINS]
    if len(found) != 1:
        amount = "no column" if not found else "several columns"
        problem = f"{amount} of the stretch among {printable(', '.join(names), 300)}"
        raise InputError(where, problem, "name one column stretch (1 at rest), strain (0 at rest) or strain_pct")
    return _Column(names.index(found[0]), *_STRAINS[found[0]])


def _stress_column(where: str, names: Sequence[str]) -> tuple[_Column, bool]:
    """The column of the stress, and whether it is the true one."""
    stresses = [name for name in names if "stress" in name and not name.startswith(("u_", "common_"))]
    nominal = [name for name in stresses if name.startswith(_STRESSES[0])]
    found = nominal if len(nominal) == 1 else stresses
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
    for share in ("u", "common"):
        if (name := f"{share}_{names[strain.place]}") in names:
            found[f"{share}_stretch"] = _Column(names.index(name), strain.factor)
        for unit, factor in _UNITS.items():
            if (name := f"{share}_{_STRESSES[is_true]}_{unit}") in names:
                found[f"{share}_stress"] = _Column(names.index(name), factor)
    return found


def _number(numbers: Numbers, where: str, names: Sequence[str], cells: Sequence[str], column: _Column) -> float:
    if not cells[column.place].strip():
        return float("nan")
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
        if (bad := values[(values <= 0.0) | (values > _MOST_STRETCH)]).size:
            raise InputError(where, f"a stretch is {bad[0]:g}", "write the length per first length, 1 at rest")
    known = np.isfinite(found["stretch"]) & np.isfinite(found["stress"])
    signs = {name: found[name][known] for name in found if name.startswith(("u_", "common_"))}
    if any(not (one > 0.0 if name == "u_stress" else one >= 0.0).all() for name, one in signs.items()):
        problem = "an uncertainty is empty, negative, or that of a stress 0"
        raise InputError(where, problem, "write standard uncertainties, or no column")
