"""VIC-3D's calibrations: XML, alone or as ``project.xml`` inside a zipped project (.z3d).

A camera is ``cx cy fx fy skew k1 k2 k3`` with its orientation ``α β γ tx ty tz`` from the world, angles in degrees,
R = Rz(γ) · Ry(β) · Rx(α); newer files split the first line into ``intrinsics`` and ``distortion``.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path
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
    number,
    refuse_terms,
    relative,
    unpublished_law,
)
from dicflow.io.calibrations.xml import parse_xml
from dicflow.io.text import printable

__all__ = ["PROGRAM", "parse", "recognises"]

PROGRAM = "VIC-3D"

_ZIP = b"PK\x03\x04"
_MEMBER = "project.xml"
_ENTRY = b"PK\x01\x02"
"""Begins the entry of each file in the directory of an archive."""
_MAX_ENTRIES = 50_000
_MAX_BYTES = 5_000_000
_MOST_NUMBERS = 100
_SAVE = "save the project again"


def recognises(source: Source) -> bool:
    """Whether the file is a zip archive, or XML with the orientation of a camera."""
    if source.data.startswith(_ZIP):
        return True
    text = source.text
    return text.lstrip().startswith("<") and "<camera" in text and "<orientation" in text


def parse(source: Source) -> Draft:
    """The rig that the file holds. Raises InputError with file and camera."""
    path, data = source.path, source.data
    if data.startswith(_ZIP):
        path, data = Path(f"{path}/{_MEMBER}"), _project(source)
    root = parse_xml(path, data)
    calibration = root.find(".//calibration")
    cameras = {element.get("id"): element for element in (root if calibration is None else calibration).iter("camera")}
    if set(cameras) != {"0", "1"}:
        found = ", ".join(str(name) for name in cameras) or "none"
        problem = f"expected the cameras 0 and 1, found {printable(found)}"
        raise InputError(str(path), problem, "export the calibration of one pair")
    left, right = (_camera(path, cameras[name]) for name in ("0", "1"))
    rotation, translation = relative(*(_pose(path, cameras[name]) for name in ("0", "1")))
    return Draft(PROGRAM, left, right, rotation, translation, unpublished_law(left, right))


def _project(source: Source) -> bytes:
    """The project's XML in the archive, unpacked in memory up to the size of the largest calibration."""
    if source.data.count(_ENTRY) > _MAX_ENTRIES:
        raise InputError(str(source.path), f"the archive has more than {_MAX_ENTRIES:,} files", "save fewer in it")
    try:
        with zipfile.ZipFile(io.BytesIO(source.data)) as archive:
            data = _member(archive)
    except KeyError as error:
        remedy = "give a project as VIC-3D saves it (.z3d)"
        raise InputError(str(source.path), f"the archive holds no {_MEMBER}", remedy) from error
    except (zipfile.BadZipFile, zlib.error, EOFError, RuntimeError, OSError, ValueError, struct.error) as error:
        raise InputError(str(source.path), f"the archive is damaged ({printable(error, 200)})", _SAVE) from error
    if len(data) > _MAX_BYTES:
        raise InputError(str(source.path), f"{_MEMBER} unpacks to more than {_MAX_BYTES:,} bytes", _SAVE)
    return data


def _member(archive: zipfile.ZipFile) -> bytes:
    """The project's XML, up to one byte more than its limit. Raises RuntimeError for another packing than VIC-3D's."""
    info = archive.getinfo(_MEMBER)
    if info.compress_type not in (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED):
        raise RuntimeError("it is packed in another way than VIC-3D does")
    with archive.open(info) as member:
        return member.read(_MAX_BYTES + 1)


def _camera(path: Path, element: ElementTree.Element) -> DraftCamera:
    where = f"{path}: camera {element.get('id')}"
    if element.find("intrinsics") is None:
        values = _numbers(where, "its parameters", element.text, 8)
    else:
        values = _numbers(where, "intrinsics", element.findtext("intrinsics"), 5)
        values += _numbers(where, "distortion", element.findtext("distortion"), 3)
    names = ("cx", "cy", "fx", "fy", "fs", "k1", "k2", "k3")
    refuse_terms(where, {f"number {index + 1}": value for index, value in enumerate(values) if index >= len(names)})
    return camera(dict(zip(names, values, strict=False)))


def _pose(path: Path, element: ElementTree.Element) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    where = f"{path}: camera {element.get('id')}"
    values = _numbers(where, "orientation", element.findtext("orientation"), 6)
    return euler_deg(*values[:3]), np.array(values[3:6])


def _numbers(where: str, name: str, text: str | None, least: int) -> list[float]:
    """The numbers of an element; there may be more than are needed."""
    words = (text or "").replace(",", " ").split()
    most = least if "," in (text or "") else _MOST_NUMBERS
    if not least <= len(words) <= most:
        problem = f"{name} has {len(words):,} numbers, expected {least}"
        raise InputError(where, problem, "export the calibration again, with decimal points")
    return [number(where, name, word) for word in words]
