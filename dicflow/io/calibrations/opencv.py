"""OpenCV's calibrations: what ``cv2.stereoCalibrate`` gives, kept in YAML, JSON or XML.

Matrices stand as ``!!opencv-matrix`` or as plain lists. The entries have many names: cameraMatrix1 and 2, K1 and K2, M1
and M2, or counted from 0, or called left and right, with distCoeffs or D. X2 = R · X1 + T.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray

from dicflow.core.cameras.camera import Rig, rotation_matrix
from dicflow.errors import InputError
from dicflow.io.calibrations.draft import Draft, DraftCamera, Source, number, refuse_terms
from dicflow.io.calibrations.xml import parse_xml
from dicflow.io.files import write_whole
from dicflow.io.text import printable
from dicflow.io.yaml_text import compose

__all__ = ["GENERAL", "PROGRAM", "opencv_text", "parse", "recognises", "write_opencv"]

PROGRAM = "OpenCV (YAML, XML)"
GENERAL = True
"""Its entries have so many names that it also recognises files of other formats."""

_PAIRS = (("1", "2"), ("0", "1"), ("left", "right"), ("l", "r"))
_MATRIX = ("cameramatrix", "intrinsicmatrix", "intrinsics", "k", "m", "mtx")
_DISTORTION = ("distcoeffs", "distcoeff", "distortioncoefficients", "distortion", "dist", "d")
_ROTATION, _TRANSLATION = ("r", "rotation", "rotationmatrix", "rot"), ("t", "translation", "translationvector", "trans")
_SIZE, _SIDES = ("imagesize", "size"), (("imagewidth", "imageheight"), ("width", "height"))
_EXTRA = ("k4", "k5", "k6", "s1", "s2", "s3", "s4", "tau_x", "tau_y")
_OTHER_LENSES = ("fisheye", "equidistant", "omni")
_HEADER = re.compile(r"\A\s*+%YAML[^\n]*+")
_NAME = re.compile(r"^[ \t{,]*+[\"']?([A-Za-z][\w ]*+)[\"']?[ \t]*+:", re.MULTILINE)
_MAX_NUMBERS = 100
_MAX_VALUES = 250_000
"""Values in a file, with those of board corners that many programs add: so many at full length fill 5 MB."""
_MATRIX_TAG = "tag:yaml.org,2002:opencv-matrix"
_EXPECTED = "cameraMatrix1, distCoeffs1, cameraMatrix2, distCoeffs2, R and T"

Array = NDArray[np.float64]


def recognises(source: Source) -> bool:
    """Whether the file holds matrices of two cameras by one of their names."""
    text = source.text.lstrip()
    if text.startswith("<"):
        return "<opencv_storage" in text
    names = {_plain(name) for name in _NAME.findall(text)}
    return text.startswith("%YAML") or any(_pair_of(names, _MATRIX))


def parse(source: Source) -> Draft:
    """The rig that the file holds. Raises InputError that names the file and the entry."""
    given = _read(source)
    entries = {_plain(name): value for name, value in given}
    if len(entries) < len(given):
        raise InputError(
            str(source.path), "has two entries of one name, but for signs and capitals", "leave one of them"
        )
    _refuse_other_lenses(source.path, entries)
    matrices, lenses = _pair_of(entries, _MATRIX), _pair_of(entries, _DISTORTION)
    turn, shift = _named(entries, _ROTATION), _named(entries, _TRANSLATION)
    if not (matrices and lenses and turn and shift):
        found = ", ".join(entries) or "nothing"
        problem = f"expected {_EXPECTED} of a stereo calibration, found {printable(found, 200)}"
        raise InputError(str(source.path), problem, "write intrinsics and extrinsics into one file")
    left, right = (
        DraftCamera(
            _array(source.path, entries, matrix, (3, 3)),
            _coefficients(source.path, entries, lens),
            _size(source.path, entries, side),
        )
        for matrix, lens, side in zip(matrices, lenses, ("1", "2"), strict=True)
    )
    rotation = np.squeeze(_array(source.path, entries, turn, (3, 3), (3, 1), (1, 3), (3,)))
    if rotation.shape == (3,):
        rotation = rotation_matrix(rotation)
    translation = _array(source.path, entries, shift, (3, 1), (1, 3), (3,)).reshape(3)
    return Draft(PROGRAM, left, right, rotation, translation)


def opencv_text(rig: Rig) -> str:
    """The rig as YAML that ``cv2.FileStorage`` reads; the numbers come back bit for bit."""
    matrices = {
        "cameraMatrix1": rig.left.matrix,
        "distCoeffs1": rig.left.distortion.reshape(1, 5),
        "cameraMatrix2": rig.right.matrix,
        "distCoeffs2": rig.right.distortion.reshape(1, 5),
        "R": rig.rotation,
        "T": rig.translation.reshape(3, 1),
    }
    sizes = {"imageSize": rig.left.size}
    if rig.left.size != rig.right.size:
        sizes = {"imageSize1": rig.left.size, "imageSize2": rig.right.size}
    lines = ["%YAML:1.0", "---", *(f"{name}: [ {width}, {height} ]" for name, (width, height) in sizes.items())]
    for name, matrix in matrices.items():
        rows, cols = matrix.shape
        numbers = ", ".join(repr(float(value)) for value in matrix.ravel())
        lines += [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {cols}", "   dt: d"]
        lines.append(f"   data: [ {numbers} ]")
    return "\n".join(lines) + "\n"


def write_opencv(path: Path, rig: Rig) -> None:
    """Write the rig to a YAML file as OpenCV does. Raises InputError where it cannot be written."""
    write_whole(Path(path), opencv_text(rig).encode())


def _read(source: Source) -> list[tuple[str, Any]]:
    """Name and value of each entry at the top of the file; a matrix is a mapping of rows, cols and data, or lists."""
    text = source.text
    if text.lstrip().startswith("<"):
        return list(_from_xml(parse_xml(source.path, source.data)))
    text = _HEADER.sub("", text).replace("\t", " ")
    root = compose(text, str(source.path), InputError, (_MATRIX_TAG,), aliases=False, most_nodes=_MAX_VALUES)
    if not isinstance(root, yaml.MappingNode):
        raise InputError(str(source.path), f"expected {_EXPECTED} by name", "write the entries by name")
    return [(str(key.value), _value(item)) for key, item in root.value]


def _value(node: yaml.Node) -> Any:
    """Numbers as text, lists, and mappings."""
    if isinstance(node, yaml.SequenceNode):
        return [_value(item) for item in node.value]
    if isinstance(node, yaml.MappingNode):
        return {str(key.value): _value(item) for key, item in node.value}
    return node.value


def _from_xml(root: Any) -> Iterator[tuple[str, Any]]:
    for element in root:
        if len(element):
            inner = {child.tag: child.text or "" for child in element}
            yield element.tag, {**inner, "data": inner.get("data", "").split()}
        else:
            words = (element.text or "").split()
            yield element.tag, words if len(words) > 1 else "".join(words)


def _plain(name: str) -> str:
    return re.sub(r"[\s_-]", "", name).lower()


def _pair_of(names: Any, stems: tuple[str, ...]) -> tuple[str, str] | tuple[()]:
    """Names of an entry of both cameras; empty if it is missing."""
    for first, second in _PAIRS:
        for stem in stems:
            for pair in ((stem + first, stem + second), (first + stem, second + stem)):
                if all(name in names for name in pair):
                    return pair
    return ()


def _named(entries: Mapping[str, Any], names: tuple[str, ...]) -> str:
    return next((name for name in names if name in entries), "")


def _array(path: Path, entries: Mapping[str, Any], name: str, *shapes: tuple[int, ...]) -> Array:
    """The numbers of an entry, in one of the shapes."""
    value, where = entries[name], f"{path}: {name}"
    given: tuple[int, ...] | None = None
    if isinstance(value, dict):
        given = tuple(int(number(where, side, value.get(side))) for side in ("rows", "cols"))
        value = value.get("data")
    elif isinstance(value, list) and value and all(isinstance(row, list) for row in value):
        given = (len(value), len(value[0]))
        value = [one for row in value for one in row]
    if isinstance(value, list) and len(value) > _MAX_NUMBERS:
        raise InputError(where, f"has {len(value):,} numbers", f"write {_EXPECTED} by these names")
    numbers = np.array([number(where, "a value", one) for one in (value if isinstance(value, list) else [value])])
    given = given or (numbers.size,)
    if numbers.size != math.prod(given) or (shapes and given not in shapes):
        expected = " or ".join(" × ".join(map(str, shape)) for shape in shapes) or "rows × cols numbers"
        problem = f"has {numbers.size} numbers as {' × '.join(map(str, given))}, expected {expected}"
        raise InputError(where, problem, "write it again")
    return numbers.reshape(given)


def _coefficients(path: Path, entries: Mapping[str, Any], name: str) -> Array:
    values = _array(path, entries, name).ravel()
    if values.size not in (4, 5, 8, 12, 14):
        problem = f"{name} has {values.size} numbers, expected k1, k2, p1, p2, k3"
        raise InputError(str(path), problem, "write them, or zeros without distortion")
    refuse_terms(f"{path}: {name}", dict(zip(_EXTRA, values[5:].tolist(), strict=False)))
    return np.concatenate([values, np.zeros(1)])[:5]


def _size(path: Path, entries: Mapping[str, Any], side: str) -> tuple[int, int] | None:
    """Size of one camera's photographs, None if the file does not give it."""
    name = _named(entries, tuple(stem + side for stem in _SIZE) + _SIZE)
    if name:
        width, height = _array(path, entries, name, (2,), (1, 2), (2, 1)).ravel().tolist()
        return int(width), int(height)
    for names in _SIDES:
        if all(name in entries for name in names):
            width, height = (number(f"{path}: {name}", "the size", entries[name]) for name in names)
            return int(width), int(height)
    return None


def _refuse_other_lenses(path: Path, entries: Mapping[str, Any]) -> None:
    for name, value in entries.items():
        text = f"{name} {value}".lower() if isinstance(value, str) else ""
        if "model" in name and any(lens in text for lens in _OTHER_LENSES):
            problem = f"{name} is {printable(value)}, and dicflow's cameras have the terms k1, k2, p1, p2, k3"
            raise InputError(str(path), problem, "calibrate with them")
