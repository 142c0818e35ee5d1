"""DICe's calibrations: XML in the form of a Teuchos ParameterList.

Angles are in degrees, R = Rz(GAMMA) · Ry(BETA) · Rx(ALPHA), or R is given as a matrix. The pose of a camera carries the
world into its frame, or camera 0's frame where ``extrinsics_relative_camera_to_camera`` says so.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple
from xml.etree import ElementTree

import numpy as np
from numpy.typing import NDArray

from dicflow.errors import InputError
from dicflow.io.calibrations.draft import (
    Draft,
    DraftCamera,
    Source,
    camera,
    euler_deg,
    needed,
    number,
    refuse_terms,
    relative,
    unpublished_law,
)
from dicflow.io.calibrations.xml import parse_xml
from dicflow.io.text import printable

__all__ = ["PROGRAM", "parse", "recognises"]

PROGRAM = "DICe"

_SYSTEMS = ("GENERIC_SYSTEM", "OPENCV", "VIC3D", "DICE")
_NONE = ("NONE", "NO_LENS_DISTORTION", "NO_DIS_MODEL")
_OPENCV = ("OPENCV_DIS", "OPENCV_LENS_DISTORTION")
_VIC3D = ("VIC3D_DIS", "VIC3D_LENS_DISTORTION")
_RADIAL = "K1R3_K2R5_K3R7"
"""The radius r becomes r + k1 r³ + k2 r⁵ + k3 r⁷: the radial part of OpenCV's model."""
_TERMS = ("K1", "K2", "K3", "K4", "K5", "K6", "P1", "P2", "S1", "S2", "S3", "S4", "T1", "T2")
_USES = {_NONE: (), _OPENCV: ("K1", "K2", "K3", "P1", "P2"), _VIC3D: ("K1", "K2", "K3"), (_RADIAL,): ("K1", "K2", "K3")}
_ANGLES, _PLACE = ("ALPHA", "BETA", "GAMMA"), ("TX", "TY", "TZ")
_AGREEMENT = 1e-4
"""Greatest difference of two forms of one rotation that comes from rounding in the file."""


class _Camera(NamedTuple):
    """The sublist of one camera: its entries as text, and the rows of its rotation, empty if it has none."""

    where: str
    entries: dict[str, str]
    rows: list[str]

    def value(self, name: str) -> float:
        """A number; 0 if the file does not give it."""
        return number(self.where, name, self.entries[name]) if name in self.entries else 0.0


def recognises(source: Source) -> bool:
    """Whether the file is a ParameterList with cameras."""
    return "<ParameterList" in source.text and "CAMERA 0" in source.text


def parse(source: Source) -> Draft:
    """The rig that the file holds. Raises InputError with file and camera."""
    path, root = source.path, parse_xml(source.path, source.data)
    entries = _entries(root)
    system = entries.get("system_type_3D", "")
    if system.upper() not in _SYSTEMS:
        problem = f"system_type_3D is '{printable(system)}', expected one of {', '.join(_SYSTEMS)}"
        raise InputError(str(path), problem, "export the calibration as one of them")
    lists = {element.get("name", ""): element for element in root.findall("ParameterList")}
    needed(path, PROGRAM, lists, ("CAMERA 0", "CAMERA 1"))
    if "CAMERA 2" in lists:
        raise InputError(str(path), "holds more than two cameras", "export the calibration of one pair")
    left, right = (_sublist(f"{path}: {name}", lists[name]) for name in ("CAMERA 0", "CAMERA 1"))
    rotation, translation = _between(path, entries, _pose(left), _pose(right))
    drafts = _camera(left), _camera(right)
    unpublished = [_model(one) in _VIC3D for one in (left, right)]
    return Draft(PROGRAM, *drafts, rotation, translation, unpublished_law(*drafts) if any(unpublished) else ())


def _entries(element: ElementTree.Element) -> dict[str, str]:
    return {one.get("name", ""): one.get("value", "").strip() for one in element.findall("Parameter")}


def _sublist(where: str, element: ElementTree.Element) -> _Camera:
    rows: list[str] = []
    for inner in element.findall("ParameterList"):
        if inner.get("name") == "rotation_3x3_matrix":
            rows = [value for _, value in sorted(_entries(inner).items())]
    return _Camera(where, _entries(element), rows)


def _between(
    path: object,
    entries: Mapping[str, str],
    first: tuple[NDArray[np.float64], NDArray[np.float64]],
    second: tuple[NDArray[np.float64], NDArray[np.float64]],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """From camera 0's frame to camera 1's."""
    relative_to_camera_0 = entries.get("extrinsics_relative_camera_to_camera", "").lower()
    first_is_world = not first[1].any() and bool((first[0] == np.eye(3)).all())
    if first_is_world:
        return second
    if relative_to_camera_0 == "false":
        return relative(first, second)
    if relative_to_camera_0 == "true":
        raise InputError(str(path), "the pose of CAMERA 1 is relative to CAMERA 0, which has one too", "remove one")
    remedy = "write extrinsics_relative_camera_to_camera, true or false"
    raise InputError(str(path), "does not give the frame of the poses", remedy)


def _pose(one: _Camera) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    place = np.array([one.value(name) for name in _PLACE])
    by_angles = euler_deg(*(one.value(name) for name in _ANGLES))
    if not one.rows:
        return by_angles, place
    rows = [_vector(one.where, "rotation_3x3_matrix", row) for row in one.rows]
    if [len(row) for row in rows] != [3, 3, 3]:
        problem = f"rotation_3x3_matrix has {printable(rows)}, expected three rows of three numbers"
        raise InputError(one.where, problem, "export the calibration again")
    rotation = np.array(rows)
    if any(name in one.entries for name in _ANGLES) and np.abs(rotation - by_angles).max() > _AGREEMENT:
        raise InputError(one.where, "the angles and rotation_3x3_matrix are different rotations", "remove one of them")
    return rotation, place


def _vector(where: str, name: str, text: str) -> list[float]:
    """Numbers in braces: ``{ 1200, 1920 }``."""
    return [number(where, name, word) for word in text.strip("{} ").split(",")]


def _model(one: _Camera) -> str:
    return one.entries.get("LENS_DISTORTION_MODEL", _NONE[0]).upper()


def _camera(one: _Camera) -> DraftCamera:
    needed_here = ("FX", "FY", "CX", "CY")
    missing = [name for name in needed_here if name not in one.entries]
    if missing:
        raise InputError(one.where, f"{', '.join(missing)} missing", "export the whole calibration again")
    model, values = _model(one), {name: one.value(name) for name in (*_TERMS, "FS")}
    uses = next((used for names, used in _USES.items() if model in names), ())
    if not any(model in names for names in _USES) and any(values[name] for name in _TERMS):
        problem = f"LENS_DISTORTION_MODEL {printable(model)} is unknown to dicflow"
        raise InputError(one.where, problem, "calibrate with OPENCV_DIS")
    unused = {name: values[name] for name in (*_TERMS, *(() if model in _VIC3D else ("FS",))) if name not in uses}
    if model in _OPENCV:
        refuse_terms(one.where, {name: value for name, value in unused.items() if name != "FS"})
    if any(unused.values()):
        found = ", ".join(f"{name} = {value:g}" for name, value in unused.items() if value)
        problem = f"has {found}, which the model {printable(model)} does not use"
        raise InputError(one.where, problem, "set it to 0, or name another model")
    names = {name: one.value(name) for name in needed_here}
    return camera({name.lower(): value for name, value in {**values, **names}.items()}, _size(one))


def _size(one: _Camera) -> tuple[int, int] | None:
    """Size of the photographs; None if unknown."""
    if "IMAGE_HEIGHT_WIDTH" not in one.entries:
        return None
    sides = _vector(one.where, "IMAGE_HEIGHT_WIDTH", one.entries["IMAGE_HEIGHT_WIDTH"])
    if len(sides) != 2:
        problem = f"IMAGE_HEIGHT_WIDTH has {len(sides)} numbers"
        raise InputError(one.where, problem, "write height and width")
    height, width = (int(side) for side in sides)
    return (width, height) if min(width, height) > 0 else None
