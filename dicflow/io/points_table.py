"""Tables of measured points, as dicflow and other programs write them.

A CSV file with one row per point and a line of names. The place in the left photograph at the first step,
displacement and strain are read, by the names that OpenCorr, MatchID, VIC-3D, the Stereo DIC Challenge and dicflow
use; other columns are ignored. A name may carry its unit in brackets, ``U [mm]``; dicflow writes units above,
``# U: mm``.
"""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from dicflow.errors import InputError

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
_UNIT = re.compile(r"\s*\[([^\]]*)\]\s*$")
_NOTE = re.compile(r"#\s*(\w+):\s*(\S+)\s*$")


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


def read_points(path: Path) -> PointTable:
    """Read a table of points.

    Shear as a tensor component, exy, is returned as the angle gxy = 2 exy. Raises InputError, with file and line,
    for a table without places or without measured quantities, and for values that are not numbers.
    """
    numbered = list(enumerate(_text(path).splitlines(), start=1))
    notes = {match[1]: match[2] for _, line in numbered if (match := _NOTE.match(line))}
    lines = [(number, line) for number, line in numbered if line.strip() and not line.lstrip().startswith("#")]
    if len(lines) < 2:
        raise InputError(f"{path}: has no rows; expected a line of names and one row per point")
    delimiter = max(",;\t", key=lines[0][1].count)
    header = [name.strip() for name in _cells(lines[0][1], delimiter)]
    table = _numbers(path, lines[1:], delimiter, len(header))
    columns = {_UNIT.sub("", name): table[:, place] for place, name in enumerate(header)}
    units = notes | {_UNIT.sub("", name): _unit(match[1].strip()) for name in header if (match := _UNIT.search(name))}
    return _chosen(f"{path}:{lines[0][0]}", columns, units)


def _chosen(where: str, columns: Mapping[str, NDArray[np.float64]], units: Mapping[str, str]) -> PointTable:
    pairs = _PLACES[:-1] if "reference_X" in columns else _PLACES  # x and y beside it are those of the step
    place = next((names for names in pairs if all(name in columns for name in names)), None)
    values, known = _measured(columns, units)
    if place is None or not values:
        lack = (
            "places in the first photograph (x_image, y_image; or MatchID's Coordinates.Image X and Y)"
            if place is None
            else "displacement (U, V, W) or strain (exx, eyy)"
        )
        raise InputError(
            f"{where}: no columns with {lack} among {', '.join(columns)}; export it in the format of the challenge"
        )
    sigmas = {name: columns[f"sigma_{name}"] for name in values if f"sigma_{name}" in columns}
    failed = columns["sigma"] < 0 if "sigma" in columns else np.zeros(len(columns[place[0]]), dtype=bool)
    blanked = {name: np.where(failed, np.nan, column) for name, column in values.items()}
    return PointTable(np.stack([columns[name] for name in place], axis=-1), blanked, sigmas, known)


def _measured(
    columns: Mapping[str, NDArray[np.float64]], units: Mapping[str, str]
) -> tuple[dict[str, NDArray[np.float64]], dict[str, str]]:
    """Displacement and strain by quantity, and their units if the table gives them."""
    values: dict[str, NDArray[np.float64]] = {}
    known: dict[str, str] = {}
    displacement = next((names for names in _DISPLACEMENTS if names[0] in columns), ())
    for quantity, name in zip("UVW", displacement, strict=False):
        if name in columns:
            values[quantity] = columns[name]
            known |= {quantity: units[name]} if name in units else {}
    if not values and all(end in columns for pair in _ENDS for end in pair):
        values = {
            quantity: columns[after] - columns[before] for quantity, (after, before) in zip("UVW", _ENDS, strict=True)
        }
    for quantity, names in _STRAINS.items():
        if name := next((name for name in names if name in columns), ""):
            values[quantity] = columns[name]
    if "gxy" not in values and (name := next((name for name in _TENSOR_SHEARS if name in columns), "")):
        values["gxy"] = 2.0 * columns[name]
    return values, known


def _unit(name: str) -> str:
    """dicflow's name of a unit."""
    return "px" if name.lower() in ("pixel", "pixels") else name


def _text(path: Path) -> str:
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except (OSError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: cannot be read as a table of points ({error}); give a CSV file in UTF-8") from error


def _cells(line: str, delimiter: str) -> list[str]:
    return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))


def _numbers(path: Path, lines: Sequence[tuple[int, str]], delimiter: str, width: int) -> NDArray[np.float64]:
    """(rows, columns); an empty cell is NaN."""
    rows = []
    for number, line in lines:
        cells = _cells(line, delimiter)
        if len(cells) != width:
            raise InputError(f"{path}:{number}: has {len(cells)} values for {width} columns; write one for each")
        try:
            rows.append([float(cell) if cell.strip() else np.nan for cell in cells])
        except ValueError as error:
            raise InputError(f"{path}:{number}: {error}; expected a number in every column, or nothing") from error
    return np.array(rows)
