"""pyvale's calibrations: a table ``name,number`` with cam0_fx_px … cam1_k3, tx_mm … and theta_deg, phi_deg, psi_deg.

The angles are those of MatchID: R = Rz(psi) · Ry(phi) · Rx(theta).
"""

from __future__ import annotations

import re

import numpy as np

from dicflow.errors import InputError
from dicflow.io.calibrations.draft import (
    Draft,
    DraftCamera,
    Source,
    camera,
    check_count,
    decimal,
    euler_deg,
    needed,
    rows,
)
from dicflow.io.table import Numbers
from dicflow.io.text import printable

__all__ = ["PROGRAM", "parse", "recognises"]

PROGRAM = "pyvale"

_LINE = re.compile(r"^[^\w\n]*+cam0_fx_px\W", re.MULTILINE)
_NAME = re.compile(r"cam[01]_\w+|t[xyz]_mm|(?:theta|phi|psi)_deg")
_PIXELS = ("fx", "fy", "fs", "cx", "cy")
_TERMS = ("k1", "k2", "p1", "p2", "k3")
_POSE = ("tx_mm", "ty_mm", "tz_mm", "theta_deg", "phi_deg", "psi_deg")


def recognises(source: Source) -> bool:
    """Whether a line gives the first camera's focal length by pyvale's name for it."""
    return _LINE.search(source.text) is not None


def parse(source: Source) -> Draft:
    """The rig that the file holds. Raises InputError with file and line."""
    values: dict[str, float] = {}
    numbers = Numbers()
    for where, name, cells in rows(source):
        if not _NAME.fullmatch(name):
            continue
        check_count(where, name, cells, 1)
        if name in values:
            raise InputError(where, f"{printable(name)} is given twice", "leave out one of them")
        values[name] = decimal(numbers, where, name, cells[0])
    numbers.settle()
    needed(source.path, PROGRAM, values, _POSE)
    tx, ty, tz, theta, phi, psi = (values[name] for name in _POSE)
    left, right = (_camera(source, values, index) for index in (0, 1))
    return Draft(PROGRAM, left, right, euler_deg(theta, phi, psi), np.array([tx, ty, tz]))


def _camera(source: Source, values: dict[str, float], index: int) -> DraftCamera:
    names = {f"cam{index}_{name}_px": name for name in _PIXELS} | {f"cam{index}_{name}": name for name in _TERMS}
    needed(source.path, PROGRAM, values, list(names))
    return camera({short: values[name] for name, short in names.items()})
