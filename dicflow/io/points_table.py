"""Tables of measured points, as dicflow and other programs write them.

A CSV file with one row per point and a line of names. The place in the left photograph at the first step,
displacement and strain are read, by the names that OpenCorr, MatchID, VIC-3D, the Stereo DIC Challenge and dicflow
use; other columns are ignored. A name may carry its unit in brackets, ``U [mm]``; dicflow writes units above,
``# U: mm``. The cells are separated by commas, semicolons or tabs (:mod:`dicflow.io.table`).
"""

from __future__ import annotations

import math
import re
from array import array
from collections.abc import Mapping, Sequence, Set
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.errors import InputError
from dicflow.io.table import Numbers, Table, read_table
from dicflow.io.text import printable

__all__ = ["PointTable", "read_points"]

_PLACES = (
    ("reference_x", "reference_y"),
    ("x_reference", "y_reference"),
    ("x_image", "y_image"),
    ("X_image", "Y_image"),
    ("Coordinates.Image X", "Coordinates.Image Y"),
    ("x_pic", "y_pic"),
    ("x", "y"),
)
_ENDS = tuple((f"tar_{axis}", f"ref_{axis}") for axis in "xyz")
_DISPLACEMENTS = (
    ("U", "V", "W"),
    ("disp.Horizontal Displacement U", "disp.Vertical Displacement V", "disp.Out-Of-Plane: W"),
)
_STRAINS = {
    "exx": ("exx", "εxx", "strain.Strain-global frame: Exx"),
    "eyy": ("eyy", "εyy", "strain.Strain-global frame: Eyy"),
    "gxy": ("gxy", "γxy"),
    "e1": ("e1", "ε1", "strain.Strain-major: E1"),
    "e2": ("e2", "ε2", "strain.Strain-minor: E2"),
}
_TENSOR_SHEARS = ("exy", "εxy", "strain.Strain-global frame: Exy")
_NOTE = re.compile(r"#\s*(\w+):\s*(\S+)")
_MAX_BYTES = 1_000_000_000
_MAX_POINTS = 1_500_000
_LARGEST = 1e9
_UNKNOWN = ("", "nan", "-nan")

Terms = tuple[tuple[str, float], ...]
"""A quantity as a sum: names of columns, each with its factor."""


class PointTable(NamedTuple):
    """Points that were measured at one step.

    xy : (n, 2) px, place in the left photograph at the first step
    values : quantity (U, V, W, exx, eyy, gxy, e1, e2) → (n,)
    sigmas : quantity → (n,), its standard deviation; empty if the table has none
    units : quantity → unit, for those whose unit the table gives
    """

    xy: NDArray[np.float64]
    values: Mapping[str, NDArray[np.float64]]
    sigmas: Mapping[str, NDArray[np.float64]]
    units: Mapping[str, str]


class _Choice(NamedTuple):
    """What is read from the columns of a table.

    xy : names of the columns of the places
    values : quantity → columns
    units : quantity → unit, for those whose unit the table gives
    """

    xy: tuple[str, str]
    values: Mapping[str, Terms]
    units: Mapping[str, str]


def read_points(path: Path) -> PointTable:
    """Read a table of points.

    Shear as a tensor component, exy, is returned as the angle gxy = 2 exy. Raises InputError, with file and line,
    for a table without places or without measured quantities, and for values that are not numbers.
    """
    table = read_table(Path(path), "a table of points", "such as x_image, y_image, U, V", _MAX_BYTES)
    names = [_without_unit(name) for name in table.names]
    units = {match[1]: match[2] for note in table.notes if (match := _NOTE.fullmatch(note))}
    units |= {name: _unit(given) for name, given in zip(names, table.names, strict=True) if given != name}
    chosen = _chosen(table.where, names, units)
    sigmas = {name: f"sigma_{name}" for name in chosen.values if f"sigma_{name}" in names}
    needed = {*chosen.xy, *sigmas.values(), *(name for terms in chosen.values.values() for name, _ in terms)}
    columns = _columns(table, names, needed | ({"sigma"} & set(names)))
    xy = np.stack([columns[name] for name in chosen.xy], axis=-1)
    values = {name: _combined(columns, terms) for name, terms in chosen.values.items()}
    if "sigma" in columns:
        values = {name: np.where(columns["sigma"] < 0, np.nan, column) for name, column in values.items()}
    return PointTable(xy, values, {name: columns[column] for name, column in sigmas.items()}, chosen.units)


def _combined(columns: Mapping[str, NDArray[np.float64]], terms: Terms) -> NDArray[np.float64]:
    (name, factor), *rest = terms
    first = columns[name] if factor == 1.0 else factor * columns[name]
    return first + _combined(columns, tuple(rest)) if rest else first


def _chosen(where: str, names: Sequence[str], units: Mapping[str, str]) -> _Choice:
    """The columns to read. Raises InputError if places or measured quantities are missing."""
    pairs = _PLACES[:-1] if "reference_X" in names else _PLACES  # x and y beside it are those of the step
    place = next((pair for pair in pairs if all(name in names for name in pair)), None)
    displacement = _displacement(names)
    values = {**displacement, **_strains(names)}
    if place is None or not values:
        lack = (
            "places in the first photograph (x_image, y_image; or MatchID's Coordinates.Image X and Y)"
            if place is None
            else "displacement (U, V, W) or strain (exx, eyy)"
        )
        problem = f"no columns with {lack} among {printable(', '.join(names), 500)}"
        raise InputError(where, problem, "export it in the format of the challenge")
    known = {name: units[column] for name, ((column, _), *rest) in displacement.items() if column in units and not rest}
    return _Choice(place, values, known)


def _displacement(names: Sequence[str]) -> dict[str, Terms]:
    """U, V and W, as columns or as differences of places."""
    given = next((three for three in _DISPLACEMENTS if three[0] in names), ())
    if given:
        return {quantity: ((name, 1.0),) for quantity, name in zip("UVW", given, strict=True) if name in names}
    if not all(end in names for pair in _ENDS for end in pair):
        return {}
    return {quantity: ((after, 1.0), (before, -1.0)) for quantity, (after, before) in zip("UVW", _ENDS, strict=True)}


def _strains(names: Sequence[str]) -> dict[str, Terms]:
    """Strains; shear is the angle."""
    spelled = {quantity: next((name for name in known if name in names), "") for quantity, known in _STRAINS.items()}
    found: dict[str, Terms] = {quantity: ((name, 1.0),) for quantity, name in spelled.items() if name}
    if "gxy" not in found and (name := next((name for name in _TENSOR_SHEARS if name in names), "")):
        found["gxy"] = ((name, 2.0),)
    return found


def _columns(table: Table, names: Sequence[str], needed: Set[str]) -> dict[str, NDArray[np.float64]]:
    """Columns by name, each (rows,); an empty cell, and the word nan, are NaN."""
    if twice := sorted(name for name in needed if names.count(name) > 1):
        raise InputError(table.where, f"has more than one column {twice[0]}", "leave one of them")
    places = {name: names.index(name) for name in sorted(needed)}
    columns, numbers = {name: array("d") for name in places}, Numbers()
    count = 0
    for count, (where, cells) in enumerate(table.rows, start=1):
        if count > _MAX_POINTS:
            raise InputError(where, f"has more than {_MAX_POINTS:,} points", "export fewer, with a larger step")
        for name, place in places.items():
            columns[name].append(_number(numbers, where, name, cells[place]))
    numbers.settle()
    if not count:
        raise InputError(table.where, "has no rows below the names", "export the points again")
    return {name: np.frombuffer(column) for name, column in columns.items()}


def _number(numbers: Numbers, where: str, name: str, cell: str) -> float:
    if cell.strip().lower() in _UNKNOWN:
        return math.nan
    return numbers.read(where, name, cell, -_LARGEST, _LARGEST)


def _without_unit(name: str) -> str:
    """A column's name without the unit in brackets behind it."""
    return name.rpartition("[")[0].rstrip() if name.endswith("]") and "[" in name else name


def _unit(name: str) -> str:
    """dicflow's name of the unit in brackets behind the name of a column."""
    unit = name.rpartition("[")[2].removesuffix("]").strip()
    return "px" if unit.lower() in ("pixel", "pixels") else unit
