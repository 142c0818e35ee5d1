"""The rig as a file gives it, its checks, and the calibrated rig made from it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dicflow.core.cameras.camera import Camera, Rig
from dicflow.errors import InputError
from dicflow.io.table import Numbers
from dicflow.io.text import decoded, printable

__all__ = [
    "MAX_TEXT_BYTES",
    "Calibration",
    "Draft",
    "DraftCamera",
    "Source",
    "camera",
    "check_count",
    "complete",
    "decimal",
    "euler_deg",
    "needed",
    "number",
    "refuse_terms",
    "relative",
    "rows",
    "unpublished_law",
]

Array = NDArray[np.float64]

MAX_TEXT_BYTES = 5_000_000
_LARGEST = 1e9
_SHORTEST_PX, _LONGEST_PX = 1.0, 1e7
_LARGEST_SIDE_PX = 100_000
_FARTHEST_MM = 1e6
_EXPORT = "export the calibration again"
_AS_TAKEN = "use photographs as the camera gave them when it was calibrated"
_NO_ROTATION = 1e-3
"""Distance of R Rᵀ from the identity up to which R is a rounded rotation."""
_SHORT_MM = 2.0
_OFF_CENTRE = 0.25


@dataclass(frozen=True)
class Source:
    """A calibration file as it lies on the disk."""

    path: Path
    data: bytes

    @cached_property
    def text(self) -> str:
        """The file as text, lines ending in LF; empty if it is not text, or more than a calibration ever is."""
        if len(self.data) > MAX_TEXT_BYTES:
            return ""
        try:
            return decoded(self.path, self.data, western=True)
        except InputError:
            return ""


class DraftCamera(NamedTuple):
    """One camera as a file gives it.

    matrix : (3, 3) — pixel centres at integers from 0 [px]
    distortion : (5,) — k1, k2, p1, p2, k3 [-]
    size : (width, height) of its photographs, None if the file does not give it [px]
    """

    matrix: Array
    distortion: Array
    size: tuple[int, int] | None = None


class Draft(NamedTuple):
    """A rig as a file gives it.

    program : name of the program that wrote the file, for messages
    rotation, translation : (3, 3) and (3,) [mm] — X1 = rotation @ X0 + translation
    warnings : messages for the user
    covariance : (24, 24) of :data:`~dicflow.core.cameras.rig_parameters.PARAMETERS`; None if unknown
    """

    program: str
    left: DraftCamera
    right: DraftCamera
    rotation: Array
    translation: Array
    warnings: tuple[str, ...] = ()
    covariance: Array | None = None


class Calibration(NamedTuple):
    """A rig read from a file: see :class:`Draft`."""

    rig: Rig
    program: str
    warnings: tuple[str, ...] = ()
    covariance: Array | None = None


def decimal(numbers: Numbers, where: str, name: str, text: str) -> float:
    """A finite number, perhaps with a decimal comma as all of its file. Raises InputError for anything else."""
    return numbers.read(where, name, text, -_LARGEST, _LARGEST)


def rows(source: Source) -> Iterator[tuple[str, str, list[str]]]:
    """``file:line``, name and values of each line of a table; its cells are separated by tabs, semicolons or commas."""
    for line, text in enumerate(source.text.split("\n"), start=1):
        separator = next((sign for sign in "\t;," if sign in text), ",")
        name, *values = [part.strip(" \"'") for part in text.rstrip(" \t;,").split(separator)]
        yield f"{source.path}:{line}", name, values


_NUMBER = re.compile(r"[-+.\u2212]*+\d")
"""Beginning of a number."""


def check_count(where: str, name: str, values: Sequence[str], count: int) -> None:
    """Raise InputError for a line of fewer values, or of further numbers, which may be what follows decimal commas."""
    if len(values) < count or any(_NUMBER.match(value) for value in values[count:]):
        amount = "one value" if count == 1 else "one value for each camera"
        problem = f"{printable(name)} has {len(values)} value(s)"
        raise InputError(where, problem, f"write {amount}, with decimal points if commas separate them")


def number(where: str, name: str, text: Any) -> float:
    """A finite number. Raises InputError that names the place for anything else."""
    try:
        value = float(text)
    except (TypeError, ValueError, OverflowError):
        value = math.nan
    if not abs(value) <= _LARGEST:
        problem = f"{name} is '{printable(text, 40)}', expected a finite number up to {_LARGEST:g}"
        raise InputError(where, problem, _EXPORT)
    return value


def needed(path: Path, program: str, values: Mapping[str, Any], names: Sequence[str]) -> None:
    """Raise InputError that names what is missing."""
    missing = [name for name in names if name not in values]
    if missing:
        verb = "is" if len(missing) == 1 else "are"
        problem = f"expected a stereo calibration as {program} writes it, but {', '.join(missing)} {verb} missing"
        raise InputError(str(path), problem, "export the whole calibration again")


def refuse_terms(where: str, terms: Mapping[str, float]) -> None:
    """Raise InputError where a term of distortion that dicflow's cameras do not have is not zero."""
    used = [f"{name} = {value:g}" for name, value in terms.items() if value != 0.0]
    if used:
        problem = f"the distortion has the terms {', '.join(used)}, and dicflow knows k1, k2, k3, p1, p2 only"
        raise InputError(where, problem, "calibrate again without them")


def camera(values: Mapping[str, float], size: tuple[int, int] | None = None) -> DraftCamera:
    """A camera from its parameters by their usual names; what is absent beside fx, fy, cx, cy is zero."""
    skew = values.get("fs", 0.0)
    matrix = np.array([[values["fx"], skew, values["cx"]], [0.0, values["fy"], values["cy"]], [0.0, 0.0, 1.0]])
    return DraftCamera(matrix, np.array([values.get(name, 0.0) for name in ("k1", "k2", "p1", "p2", "k3")]), size)


def euler_deg(x: float, y: float, z: float) -> Array:
    """Rotation Rz(z) · Ry(y) · Rx(x) from angles [deg]."""
    (cx, cy, cz), (sx, sy, sz) = np.cos(np.radians([x, y, z])), np.sin(np.radians([x, y, z]))
    about_x = np.array([[1, 0, 0], [0, cx, -sx], [0, sx, cx]])
    about_y = np.array([[cy, 0, sy], [0, 1, 0], [-sy, 0, cy]])
    about_z = np.array([[cz, -sz, 0], [sz, cz, 0], [0, 0, 1]])
    return np.asarray(about_z @ about_y @ about_x)


def relative(first: tuple[Array, Array], second: tuple[Array, Array]) -> tuple[Array, Array]:
    """From the first camera's frame to the second's, each given as rotation and translation from the world."""
    rotation = second[0] @ first[0].T
    return rotation, second[1] - rotation @ first[1]


def unpublished_law(left: DraftCamera, right: DraftCamera) -> tuple[str, ...]:
    """The warning for a radial distortion whose law its program does not publish; empty without distortion."""
    shift_px = max(_corner_shift_px(left), _corner_shift_px(right))
    if not (left.distortion.any() or right.distortion.any()):
        return ()
    return (
        "the law of VIC-3D's radial distortion is not published; k1, k2, k3 are read as 1 + k1 r² + k2 r⁴ + k3 r⁶, "
        f"which moves the photograph's corner by {shift_px:.2g} px",
    )


def complete(
    path: Path, draft: Draft, image_size: tuple[int, int] | None, right_size: tuple[int, int] | None
) -> Calibration:
    """The calibrated rig of a draft.

    image_size, right_size : (width, height) of the left and right photographs to be measured; None if unknown
    Raises InputError if the numbers are not a rig, or not one for photographs of this size.
    """
    left = _complete_camera(f"{path}: left camera", draft.left, image_size)
    right = _complete_camera(f"{path}: right camera", draft.right, right_size)
    rig = Rig(left, right, _rotation(path, draft.rotation), _translation(path, draft.translation))
    warnings = (*draft.warnings, *_centre_warnings("left", left), *_centre_warnings("right", right))
    return Calibration(rig, draft.program, (*warnings, *_baseline_warnings(rig)), draft.covariance)


def _complete_camera(where: str, one: DraftCamera, image_size: tuple[int, int] | None) -> Camera:
    matrix = one.matrix
    if not (np.isfinite(matrix).all() and np.isfinite(one.distortion).all()):
        raise InputError(where, "has parameters that are not finite numbers", _EXPORT)
    if not (matrix[[1, 2, 2], [0, 0, 1]] == 0.0).all() or matrix[2, 2] != 1.0:
        problem = f"has the matrix {matrix.tolist()}, expected [[fx, skew, cx], [0, fy, cy], [0, 0, 1]]"
        raise InputError(where, problem, "transpose it")
    if not all(_SHORTEST_PX <= length <= _LONGEST_PX for length in (matrix[0, 0], matrix[1, 1])):
        problem = (
            f"has the focal lengths {matrix[0, 0]:g} and {matrix[1, 1]:g} px, expected positive ones from "
            f"{_SHORTEST_PX:g} to {_LONGEST_PX:,.0f}"
        )
        raise InputError(where, problem, _EXPORT)
    if max(np.abs(matrix[0, 1:]).max(), abs(matrix[1, 2])) > _LONGEST_PX or np.abs(one.distortion).max() > _LARGEST:
        problem = f"has a skew, principal point or distortion beyond {_LONGEST_PX:,.0f} px and {_LARGEST:g}"
        raise InputError(where, problem, _EXPORT)
    size = _agreed_size(where, one, image_size)
    if _corner_shift_px(one) > max(size) or np.abs(one.distortion[2:4]).max() > 1.0:
        problem = f"has the distortion {one.distortion.tolist()}, which moves the photograph's corner out of all bounds"
        raise InputError(where, problem, _EXPORT)
    if one.size is None and not (0.0 <= matrix[0, 2] < size[0] and 0.0 <= matrix[1, 2] < size[1]):
        problem = f"has its principal point outside photographs of {size[0]} × {size[1]} px, {_guessed(matrix)}"
        raise InputError(where, problem, _AS_TAKEN)
    return Camera(matrix, one.distortion, size)


def _agreed_size(where: str, one: DraftCamera, image_size: tuple[int, int] | None) -> tuple[int, int]:
    """Size of the photographs by the file or by the photographs; the two must agree."""
    size = one.size or image_size
    if size is None:
        raise InputError(where, "the file does not give the size of the photographs", "name their stage as 'images'")
    if not 1 <= min(size) <= max(size) <= _LARGEST_SIDE_PX:
        problem = f"the size of the photographs is {size[0]} × {size[1]} px, expected 1 to {_LARGEST_SIDE_PX:,}"
        raise InputError(where, problem, "write the size in pixels")
    if image_size is not None and size != tuple(image_size):
        factor, other = image_size[0] / size[0], image_size[1] / size[1]
        same = abs(factor / other - 1.0) < 0.01
        found = f"these are {factor:.4g} times as large: " if same else "these have "
        problem = (
            f"was calibrated on photographs of {size[0]} × {size[1]} px, but {found}{image_size[0]} × "
            f"{image_size[1]} px"
        )
        raise InputError(where, problem, f"{_AS_TAKEN}, or set offset if the window of its sensor is smaller since")
    return size


def _centre_warnings(side: str, one: Camera) -> tuple[str, ...]:
    """A warning if the principal point does not fit the size of the photographs."""
    centre, size = one.matrix[:2, 2], np.array(one.size)
    if (np.abs(centre - (size - 1.0) / 2.0) <= _OFF_CENTRE * size).all():
        return ()
    return (
        f"the {side} camera's principal point is far from the middle of photographs of {size[0]} × {size[1]} px, "
        f"{_guessed(one.matrix)}; unless they were cropped, it was calibrated on photographs of another size",
    )


def _guessed(matrix: Array) -> str:
    """The principal point, and the size of photographs that have it in the middle."""
    x, y = matrix[:2, 2]
    return f"at ({x:.1f}, {y:.1f}) as for photographs of about {2 * x + 1:.0f} × {2 * y + 1:.0f} px"


def _baseline_warnings(rig: Rig) -> tuple[str, ...]:
    baseline = float(np.linalg.norm(rig.translation))
    if baseline >= _SHORT_MM:
        return ()
    return (f"the baseline is {baseline:.3g} mm; if the file is in metres, multiply its translation by 1000",)


def _rotation(path: Path, rotation: ArrayLike) -> Array:
    """The rotation nearest to the given one, which is rounded to the digits of its file (Schönemann 1966)."""
    given = np.asarray(rotation, dtype=float)
    if not np.isfinite(given).all() or np.abs(given @ given.T - np.eye(3)).max() > _NO_ROTATION:
        raise InputError(str(path), f"R = {given.tolist()} is not a rotation", _EXPORT)
    if np.linalg.det(given) < 0.0:
        raise InputError(str(path), "R mirrors, expected a rotation of determinant 1", _EXPORT)
    if np.abs(given @ given.T - np.eye(3)).max() < 1e-14:
        return given
    left, _, right = np.linalg.svd(given)
    return np.asarray(left @ right)


def _translation(path: Path, translation: ArrayLike) -> Array:
    given = np.asarray(translation, dtype=float)
    if not np.abs(given).max() <= _FARTHEST_MM or not given.any():
        problem = (
            f"T = {given.tolist()}, expected the right camera at a distance from the left one, "
            f"up to {_FARTHEST_MM:,.0f} mm"
        )
        raise InputError(str(path), problem, "export the calibration of both cameras together")
    return given


def _corner_shift_px(one: DraftCamera) -> float:
    """How far distortion moves the photograph's corner (0, 0)."""
    matrix = one.matrix
    with np.errstate(all="ignore"):  # a draft may hold any numbers
        r2 = np.sum((matrix[:2, 2] / matrix[[0, 1], [0, 1]]) ** 2)
        k1, k2, _, _, k3 = one.distortion
        return float(abs(r2 * (k1 + r2 * (k2 + r2 * k3))) * np.hypot(*matrix[:2, 2]))
