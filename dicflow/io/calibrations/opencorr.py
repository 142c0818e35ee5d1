"""OpenCorr's calibrations: a table ``name,left,right`` of Fx, Fy, Fs, Cx, Cy, K1 … K6, P1, P2, Tx … Tz, Rx … Rz.

Each camera's pose carries the world into its frame. OpenCorr turns by a rotation vector in radians (Rodrigues); tables
made for other readers of this format hold angles in degrees, R = Rz(Rz) · Ry(Ry) · Rx(Rx), and are recognised by their
size.
"""

from __future__ import annotations

import math
import re

import numpy as np
from numpy.typing import NDArray

from dicflow.core.cameras.camera import rotation_matrix
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
    refuse_terms,
    relative,
    rows,
)
from dicflow.io.table import Numbers

__all__ = ["PROGRAM", "parse", "recognises"]

PROGRAM = "OpenCorr"

_INTRINSICS = ("fx", "fy", "cx", "cy")
_POSE = ("tx", "ty", "tz", "rx", "ry", "rz")
_KNOWN = (*_INTRINSICS, "fs", *(f"k{index}" for index in range(1, 7)), "p1", "p2", *_POSE)
_QUARTER = math.pi / 2.0
_LINE = re.compile(r"^[^\w\n]*+fx\"?[ ]*+[,;\t][^,;\t\n]++[,;\t]", re.IGNORECASE | re.MULTILINE)


def recognises(source: Source) -> bool:
    """Whether a line gives the focal lengths of two cameras."""
    return _LINE.search(source.text) is not None


def parse(source: Source) -> Draft:
    """The rig that the file holds. Raises InputError with file and line."""
    left, right = _columns(source)
    in_degrees = max(_turn(left), _turn(right)) > _QUARTER
    warnings = (
        ("Rx, Ry, Rz are too large for the radians that OpenCorr writes, and are read as angles in degrees",)
        if in_degrees
        else ()
    )
    rotation, translation = relative(_pose(left, in_degrees), _pose(right, in_degrees))
    return Draft(PROGRAM, _camera(source, left), _camera(source, right), rotation, translation, warnings)


def _columns(source: Source) -> tuple[dict[str, float], dict[str, float]]:
    """Parameters of the left and the right camera."""
    left: dict[str, float] = {}
    right: dict[str, float] = {}
    numbers = Numbers()
    for where, name, values in rows(source):
        key = name.lower()
        if key not in _KNOWN:
            continue
        if key in left:
            raise InputError(where, f"{name} is given twice", "leave out one of them")
        check_count(where, name, values, 2)
        left[key], right[key] = (decimal(numbers, where, name, value) for value in values[:2])
    numbers.settle()
    needed(source.path, PROGRAM, left, (*_INTRINSICS, *_POSE))
    return left, right


def _turn(values: dict[str, float]) -> float:
    return math.hypot(values["rx"], values["ry"], values["rz"])


def _pose(values: dict[str, float], in_degrees: bool) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    turn = [values[name] for name in ("rx", "ry", "rz")]
    rotation = euler_deg(*turn) if in_degrees else rotation_matrix(turn)
    return rotation, np.array([values[name] for name in ("tx", "ty", "tz")])


def _camera(source: Source, values: dict[str, float]) -> DraftCamera:
    refuse_terms(str(source.path), {name: values.get(name, 0.0) for name in ("k4", "k5", "k6")})
    return camera(values)
