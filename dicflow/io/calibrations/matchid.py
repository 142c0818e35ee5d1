"""MatchID's calibrations (.caldat): one ``name [unit]; number`` a line.

Also with tabs, colons or commas between them, without units, with decimal commas, in lower case, with the cameras
counted from 0 or 1. R = Rz(Psi) · Ry(Phi) · Rx(Theta) and T carry the first camera's frame into the second's.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dicflow.errors import InputError
from dicflow.io.calibrations.draft import Draft, Source, camera, decimal, euler_deg, needed, refuse_terms
from dicflow.io.table import Numbers
from dicflow.io.text import printable

__all__ = ["PROGRAM", "parse", "recognises"]

PROGRAM = "MatchID"

_NUMBER = re.compile(r"[-+]?(?:\d++[.,]?\d*+|[.,]\d++)(?:[eE][-+]?\d++)?", re.ASCII)
_WORD = re.compile(r"[^\s;:=,]++")
_LONGEST = 1_000
_NAME = re.compile(r"([A-Za-z][\w ]*+)\s*+(?:\[([^\]]*+)\])?")
_SIGNS = " \t;:=,"
_FIRST = re.compile(r"^[^\w\n]*+cam\d_fx\b(?!_px)", re.IGNORECASE | re.MULTILINE)
_ENTRY = re.compile(r"\s*(cam\d|[Tt][xyz]\b|theta|phi|psi)", re.IGNORECASE)
_CAMERA = re.compile(r"cam(\d)(\w+)")
_KNOWN = {"fx", "fy", "fs", "cx", "cy", "k1", "k2", "k3", "p1", "p2"}
_POSE = ("tx", "ty", "tz", "theta", "phi", "psi")
_UNITS = {"": 1.0, "mm": 1.0, "cm": 10.0, "m": 1000.0, "deg": 1.0, "°": 1.0, "rad": 180.0 / np.pi}


class _Entry(NamedTuple):
    """A number in pixels, mm, degrees or none, and the line that says it."""

    value: float
    line: int


def recognises(source: Source) -> bool:
    """Whether a line gives the focal length of a numbered camera."""
    return _FIRST.search(source.text) is not None


def parse(source: Source) -> Draft:
    """The rig that the file holds. Raises InputError with file and line."""
    path, entries = source.path, _entries(source)
    needed(path, PROGRAM, entries, _POSE)
    cameras = _cameras(path, entries)
    if len(cameras) != 2:
        problem = f"holds {len(cameras)} camera(s)"
        raise InputError(str(path), problem, f"export the calibration of a pair from {PROGRAM}")
    left, right = (cameras[index] for index in sorted(cameras))
    for index, values in sorted(cameras.items()):
        needed(path, PROGRAM, {f"Cam{index}_{name}": 0 for name in values}, [f"Cam{index}_{n}" for n in _SEEN])
    tx, ty, tz, theta, phi, psi = (entries[name].value for name in _POSE)
    return Draft(PROGRAM, camera(left), camera(right), euler_deg(theta, phi, psi), np.array([tx, ty, tz]))


_SEEN = ("fx", "fy", "cx", "cy")


def _entries(source: Source) -> dict[str, _Entry]:
    """Every number of the file by its name without spaces, underscores and capitals."""
    entries: dict[str, _Entry] = {}
    numbers = Numbers()
    for line, text in enumerate(re.sub("['\"]", "", source.text).split("\n"), start=1):
        where, found = f"{source.path}:{line}", _split(text)
        if found is None:
            if _ENTRY.match(text):
                problem = f"'{printable(text.strip())}', expected a name and a number"
                raise InputError(where, problem, "write it as 'Tx [mm];-180.6'")
            continue
        name, unit, value = found
        key = re.sub(r"[\s_]", "", name).lower()
        if key in entries:
            problem = f"{printable(name)} was given in line {entries[key].line}"
            raise InputError(where, problem, "leave out one of them")
        entries[key] = _Entry(decimal(numbers, where, printable(name), value) * _scale(where, key, unit), line)
    numbers.settle()
    return entries


def _split(text: str) -> tuple[str, str, str] | None:
    """Name, unit and number of a line; None for another line. A comma may separate, or be the number's."""
    words = [] if len(text) > _LONGEST else [word.span() for word in _WORD.finditer(text)]
    for start, _ in words[-2:]:
        value, name = text[start : words[-1][1]], _NAME.fullmatch(text[:start].strip(_SIGNS))
        if name is not None and _NUMBER.fullmatch(value):
            return name[1].strip(), (name[2] or "").strip(), value
    return None


def _scale(where: str, key: str, unit: str) -> float:
    """Factor to mm or degrees; the numbers of cameras are taken as they are."""
    if key not in _POSE:
        return 1.0
    if unit.lower() not in _UNITS:
        problem = f"the unit is '{printable(unit)}', expected mm for lengths and deg for angles"
        raise InputError(where, problem, "export it in these units")
    return _UNITS[unit.lower()]


def _cameras(path: Path, entries: dict[str, _Entry]) -> dict[int, dict[str, float]]:
    """Parameters of every camera by its number."""
    cameras: dict[int, dict[str, float]] = {}
    for key, entry in entries.items():
        found = _CAMERA.fullmatch(key)
        if found is None:
            continue
        name = found[2].replace("kappa", "k")
        if name not in _KNOWN:
            refuse_terms(f"{path}:{entry.line}", {found[2]: entry.value})
        cameras.setdefault(int(found[1]), {})[name] = entry.value
    return cameras
