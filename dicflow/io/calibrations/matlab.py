"""Calibrations of MATLAB's Computer Vision Toolbox, saved as a structure of plain arrays (.mat).

``IntrinsicMatrix`` and ``RotationOfCamera2`` are transposed, ``K`` and ``PoseCamera2`` are not. MATLAB counts pixels
from 1, so 1 is subtracted from the principal points.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dicflow.errors import InputError
from dicflow.io.calibrations.draft import Draft, DraftCamera, Source, needed
from dicflow.io.calibrations.mat5 import read_mat
from dicflow.io.text import printable

__all__ = ["PROGRAM", "parse", "recognises"]

PROGRAM = "MATLAB"

_EXPORT = """\
in MATLAB run
  c = @(p) struct('IntrinsicMatrix', p.IntrinsicMatrix, 'RadialDistortion', p.RadialDistortion, \
'TangentialDistortion', p.TangentialDistortion, 'ImageSize', p.ImageSize, \
'WorldUnits', p.WorldUnits);
  s = struct('CameraParameters1', c(stereoParams.CameraParameters1), \
'CameraParameters2', c(stereoParams.CameraParameters2), \
'RotationOfCamera2', stereoParams.RotationOfCamera2, 'TranslationOfCamera2', stereoParams.TranslationOfCamera2);
  save('calibration.mat', '-struct', 's', '-v7')"""
_UNITS = {"millimeters": 1.0, "mm": 1.0, "centimeters": 10.0, "cm": 10.0, "meters": 1000.0, "m": 1000.0}
_UNITS |= {"inches": 25.4, "in": 25.4}
_FROM_ONE = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
_LARGEST = 1e9
_MAX_NUMBERS = 100
_CAMERAS = ("CameraParameters1", "CameraParameters2")

Array = NDArray[np.float64]


def recognises(source: Source) -> bool:
    """Whether the file begins as MATLAB's files do."""
    return source.data.startswith(b"MATLAB ")


def parse(source: Source) -> Draft:
    """The rig that the file holds. Raises InputError with a remedy in MATLAB if it is an object."""
    values = _structure(source)
    needed(source.path, PROGRAM, values, _CAMERAS)
    left, right = (_camera(source, name, values[name]) for name in _CAMERAS)
    rotation, translation = _pose(source, values)
    unit = values[_CAMERAS[0]].get("WorldUnits")
    warnings = () if unit else ("no WorldUnits in the file; its translation is read in mm",)
    return Draft(PROGRAM, left, right, rotation, translation * _unit(source, unit), warnings)


def _structure(source: Source) -> Mapping[str, Any]:
    """The structure with the cameras, which may be a variable or the file itself."""
    if source.data.startswith(b"MATLAB 7.3"):
        raise InputError(str(source.path), "has version 7.3, expected plain arrays of version 7", _EXPORT)
    try:
        values = read_mat(source.data)
    except (ValueError, OverflowError) as error:
        raise InputError(str(source.path), f"is damaged ({printable(error)})", _EXPORT) from error
    for value in (values, *values.values()):
        if isinstance(value, dict) and _CAMERAS[0] in value:
            return value
    problem = f"holds no structure with {', '.join(_CAMERAS)} in plain arrays"
    raise InputError(str(source.path), problem, _EXPORT)


def _camera(source: Source, name: str, values: Any) -> DraftCamera:
    where = f"{source.path}: {name}"
    if not isinstance(values, Mapping):
        raise InputError(where, "is an object, not a structure of plain arrays", _EXPORT)
    name = "K" if "K" in values else "IntrinsicMatrix"
    given = _array(where, values, name, (3, 3))
    matrix = (given if name == "K" else given.T) - _FROM_ONE
    radial = _array(where, values, "RadialDistortion", (2,), (3,))
    tangential = (
        _array(where, values, "TangentialDistortion", (2,)) if "TangentialDistortion" in values else np.zeros(2)
    )
    k3 = radial[2] if radial.size == 3 else 0.0
    return DraftCamera(matrix, np.array([*radial[:2], *tangential, k3]), _size(where, values))


def _size(where: str, values: Mapping[str, Any]) -> tuple[int, int] | None:
    if np.size(values.get("ImageSize", ())) == 0:
        return None
    height, width = _array(where, values, "ImageSize", (2,))
    return int(width), int(height)


def _pose(source: Source, values: Mapping[str, Any]) -> tuple[Array, Array]:
    """From the first camera's frame to the second's."""
    where, pose = str(source.path), values.get("PoseCamera2")
    if pose is None:
        rotation = _array(where, values, "RotationOfCamera2", (3, 3)).T
        return rotation, _array(where, values, "TranslationOfCamera2", (3,))
    if isinstance(pose, Mapping) and "R" in pose:
        return _array(f"{where}: PoseCamera2", pose, "R", (3, 3)), _array(where, pose, "Translation", (3,))
    given = pose if isinstance(pose, Mapping) else {"A": pose}
    whole = _array(f"{where}: PoseCamera2", given, "A", (4, 4))
    return whole[:3, :3], whole[:3, 3]


def _unit(source: Source, unit: Any) -> float:
    """Factor from the unit of the translation to mm, which is also the unit of files that give none."""
    unit = str(unit or "mm")
    if unit.lower() not in _UNITS:
        problem = f"WorldUnits is '{printable(unit)}', expected millimeters"
        raise InputError(str(source.path), problem, "calibrate in millimeters")
    return _UNITS[unit.lower()]


def _array(where: str, values: Mapping[str, Any], name: str, *shapes: tuple[int, ...]) -> Array:
    """The numbers of a field in one of the shapes."""
    if name not in values:
        raise InputError(where, f"has no {name}", _EXPORT)
    if np.size(values[name]) > _MAX_NUMBERS:
        raise InputError(where, f"{name} has {np.size(values[name]):,} numbers", _EXPORT)
    try:
        found = np.squeeze(np.asarray(values[name], dtype=float))
    except (TypeError, ValueError) as error:
        raise InputError(where, f"{name} is not a plain array", _EXPORT) from error
    if found.shape not in shapes:
        expected = " or ".join(" × ".join(map(str, shape)) for shape in shapes)
        raise InputError(where, f"{name} is {' × '.join(map(str, found.shape))}, expected {expected}", _EXPORT)
    if not (np.abs(found) <= _LARGEST).all():
        raise InputError(where, f"{name} has numbers that are not finite, or beyond {_LARGEST:g}", _EXPORT)
    return found
