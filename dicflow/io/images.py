"""Photographs: PNG, TIFF, JPEG and BMP with 8 or 16 bits, colour or grey.

The check of a photograph and the stage that uses it call :func:`read_photograph`. Its first bytes say which format a
file has; a file of another format is handed to no library.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from dicflow.errors import InputError

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

__all__ = [
    "SUFFIXES",
    "Pairing",
    "Photograph",
    "natural_key",
    "pair_names",
    "probe",
    "read_grey",
    "read_photograph",
]

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")
_JPEG = b"\xff\xd8\xff"
_FIRST_BYTES = {
    b"\x89PNG\r\n\x1a\n": "PNG",
    _JPEG: "JPEG",
    b"BM": "BMP",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"II+\0": "TIFF",
    b"MM\0+": "TIFF",
}
_PNG_METADATA = (b"eXIf", b"tEXtRaw profile type exif", b"zTXtRaw profile type exif", b"iTXtXML:com.adobe.xmp")
"""Type and keyword of the chunks of a PNG file that may give its orientation."""
_ORIENTATION = 0x0112
_SILENT = 0
"""OpenCV's level of logging that prints nothing."""
_JPEG_SCAN, _JPEG_END = 0xDA, b"\xff\xd9"
"""Markers of JPEG (ITU-T T.81, table B.1): start of scan, end of image."""


def natural_key(name: str) -> tuple[tuple[int, int | str], ...]:
    """Sort key that reads runs of digits as numbers: a2 before a10.

    >>> sorted(["a10", "a2"], key=natural_key)
    ['a2', 'a10']
    """
    parts = re.findall(r"\d+|\D+", name)
    return tuple((0, int(part)) if part.isdigit() else (1, part.lower()) for part in parts)


class Photograph(NamedTuple):
    """A decoded photograph.

    grey : (row, col) uint8 or uint16; colour is weighted to luma (ITU-R BT.601)
    orientation : of EXIF, 1 … 8; 1 if the file does not give it. It is applied to a TIFF and to no other format
    """

    grey: np.ndarray
    orientation: int


def read_photograph(path: Path) -> Photograph:
    """Decode a photograph.

    Raises InputError that names the file if it is missing, has another format, is truncated or damaged, or does not
    hold integers of 8 or 16 bits.
    """
    from PIL import Image

    try:
        with Image.open(path, formats=(_format(path),)) as image:
            orientation = _orientation(path, image)
            return Photograph(_grey(path, image, orientation), orientation)
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; check the folder and the pattern") from error
    except PermissionError as error:
        raise InputError(f"{path}: may not be read; get the right to, or leave it out") from error
    except Image.DecompressionBombError as error:
        raise InputError(f"{path}: larger than any camera's photograph; cut it to the specimen") from error
    except (OSError, SyntaxError, ValueError) as error:
        raise InputError(
            f"{path}: the photograph is truncated or damaged; copy it again from the camera or leave it out"
        ) from error


def probe(path: Path) -> dict[str, int]:
    """Width and height [px], bits per grey level, and EXIF orientation of a photograph.

    Raises InputError as :func:`read_photograph` does.
    """
    grey, orientation = read_photograph(path)
    height, width = grey.shape
    return {"width": width, "height": height, "bits": 8 * grey.itemsize, "orientation": orientation}


def read_grey(path: Path) -> np.ndarray:
    """Grey levels of a photograph, (row, col) uint8 or uint16. Raises InputError as :func:`read_photograph` does."""
    return read_photograph(path).grey


def _format(path: Path) -> str:
    """Format of a photograph by its first bytes. Raises InputError if it is another one, and OSError."""
    with path.open("rb") as file:
        start = file.read(max(map(len, _FIRST_BYTES)))
    if not start:
        raise InputError(f"{path}: the photograph is empty; copy it again from the camera or leave it out")
    for first, form in _FIRST_BYTES.items():
        if start.startswith(first):
            return form
    raise InputError(
        f"{path}: not a photograph in PNG, TIFF, JPEG or BMP, or damaged at its start; "
        "save it in one of these formats, copy it again from the camera, or leave it out"
    )


def _orientation(path: Path, image: ImageFile) -> int:
    """EXIF orientation of a photograph that is open but not decoded; 1 if the file does not give it."""
    if image.format == "PNG" and not _has_exif(path.read_bytes()):
        return 1  # Pillow would decode the whole photograph to look for it
    return int(image.getexif().get(_ORIENTATION, 1))


def _has_exif(png: bytes) -> bool:
    """Whether a chunk of a PNG file holds metadata that may give the orientation."""
    place = 8
    while place < len(png) and not png.startswith(_PNG_METADATA, place + 4):
        place += 12 + int.from_bytes(png[place : place + 4], "big")
    return place < len(png)


def _grey(path: Path, image: ImageFile, orientation: int) -> np.ndarray:
    """Grey levels of an open photograph. Raises ValueError or OSError if it is truncated or damaged."""
    if image.mode == "F":
        raise InputError(f"{path}: holds numbers with fractions; save it as PNG or TIFF with 8 or 16 bits")
    if image.format == "TIFF":
        tiles: Any = image.tile
        image.load()  # OpenCV passes over damage in a compressed TIFF
        if tiles[0][3][0] == "L" and orientation == 1:  # grey levels of 8 bits, which OpenCV expands to colour and back
            return np.array(image)
    return _decoded(path, path.read_bytes())


def _decoded(path: Path, data: bytes) -> np.ndarray:
    """Grey levels by OpenCV. Raises ValueError if the file is truncated or cannot be decoded."""
    if data.startswith(_JPEG) and not _is_whole_jpeg(data):
        raise ValueError("no end-of-image marker")  # OpenCV 4.10 fills the rest with grey
    cv2 = _opencv()
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        grey: np.ndarray | None = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    except cv2.error as error:
        raise ValueError(str(error)) from error
    if grey is None:
        raise ValueError("OpenCV cannot decode it")
    if grey.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: expected grey levels of 8 or 16 bits; save the photograph as PNG or TIFF")
    return grey


@cache
def _opencv() -> Any:
    """OpenCV with its log switched off: the error that names the file says enough."""
    import cv2

    opencv: Any = cv2
    set_level = opencv.setLogLevel if hasattr(opencv, "setLogLevel") else opencv.utils.logging.setLogLevel
    set_level(_SILENT)
    return opencv


def _is_whole_jpeg(data: bytes) -> bool:
    """Whether an end-of-image marker follows the first scan; a preview inside the header has markers of its own."""
    place = 2
    while place + 4 <= len(data) and data[place] == 0xFF and data[place + 1] != _JPEG_SCAN:
        filled = data[place + 1] == 0xFF
        place += 1 if filled else 2 + int.from_bytes(data[place + 2 : place + 4], "big")
    return data.rfind(_JPEG_END) >= place


class Pairing(NamedTuple):
    """Partners among two lists of names.

    pairs : (left, right) names in the order of the left ones
    by : "name" or "order"
    """

    pairs: tuple[tuple[str, str], ...]
    by: str


def pair_names(left: Sequence[str], right: Sequence[str]) -> Pairing:
    """Pair the photographs of two cameras: by the numbers in their names if these agree, else in the order given.

    Of each name the numbers that vary within its side are compared, so ``cam0_step07`` finds ``cam1_step07``
    and ``ImageLeft7`` finds ``ImageRight7``.

    Raises InputError that names the photographs without a partner.
    """
    keys_left, keys_right = _keys(left), _keys(right)
    shared = keys_left.keys() & keys_right.keys()
    if len(shared) == len(left) == len(right):
        return Pairing(tuple((keys_left[key], keys_right[key]) for key in keys_left), "name")
    if len(left) == len(right) and not shared:
        return Pairing(tuple(zip(left, right, strict=True)), "order")
    alone = [
        f"{side} {name}"
        for side, keys in (("left", keys_left), ("right", keys_right))
        for name in sorted((keys[key] for key in keys.keys() - shared), key=natural_key)
    ]
    named = ", ".join(alone[:5]) + (f" and {len(alone) - 5} more" if len(alone) > 5 else "")
    raise InputError(
        f"{len(left)} left and {len(right)} right photographs; without a partner: {named}; "
        "add the missing ones or move these away"
    )


def _keys(names: Sequence[str]) -> dict[tuple[int, ...] | str, str]:
    """Names by the numbers that vary among them; by their stems if the names do not have one form."""
    stems = [Path(name).stem for name in names]
    numbers = [tuple(int(digits) for digits in re.findall(r"\d+", stem)) for stem in stems]
    if len({len(row) for row in numbers}) == 1:
        varying = [column for column in zip(*numbers, strict=True) if len(set(column)) > 1]
        keys = list(zip(*varying, strict=True)) or [()] * len(names)
        if len(set(keys)) == len(names):
            return dict(zip(keys, names, strict=True))
    return dict(zip(stems, names, strict=True))
