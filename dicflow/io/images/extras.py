"""Photographs that need a decoder of their own: HEIC from phones, and cameras' raw files."""

from __future__ import annotations

from importlib import import_module
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from dicflow.engine.whole_file import read_file
from dicflow.errors import InputError
from dicflow.io.images.libraries import library, opencv, pillow
from dicflow.io.images.orientation import turned_upright

__all__ = ["heic_metadata", "read_heic", "read_raw"]

_SAVE_JPEG = "let the phone save JPEG ('most compatible'), or save it as PNG or TIFF"
_ORIENTATION = 274
"""Tag of the orientation in EXIF."""
_INVERSE = {1: 1, 2: 2, 3: 3, 4: 4, 5: 5, 6: 8, 7: 7, 8: 6}
"""Orientation → the one that undoes it."""
_FLIPS = {0: 1, 3: 3, 5: 8, 6: 6}
"""Flip of a raw file by its decoder → orientation (LibRaw, data structures)."""


def read_heic(path: Path) -> tuple[np.ndarray, int]:
    """Grey levels (row, col) uint8 of a HEIC photograph as the sensor lies, and its orientation.

    Raises InputError without the file's name where the decoder is missing or cannot read it, and OSError.
    """
    heif = _decoder("pi_heif", "pi-heif", "a HEIC photograph", _SAVE_JPEG)
    data = BytesIO(read_file(path))
    try:
        levels, orientation = _decoded(heif, data)
    except ValueError as error:
        raise InputError(f"a HEIC photograph that its decoder cannot read ({error}); {_SAVE_JPEG}") from error
    grey = levels if levels.ndim == 2 else opencv().cvtColor(levels[..., :3], opencv().COLOR_RGB2GRAY)
    return turned_upright(grey, _INVERSE.get(orientation, 1)), orientation if orientation in _INVERSE else 1


def _decoded(heif: Any, data: BytesIO) -> tuple[np.ndarray, int]:
    """Samples as a viewer shows them, and the orientation that was applied. Raises ValueError for damage."""
    with library():
        image = heif.open_heif(data, convert_hdr_to_8bit=True)
        exif = pillow().Exif()
        exif.load(image.info.get("exif") or b"")
        return np.array(image), int(exif.get(_ORIENTATION, 1))


def heic_metadata(path: Path) -> bytes:
    """The EXIF metadata of a HEIC photograph; empty without any, or without its decoder."""
    try:
        heif = import_module("pi_heif")
    except ImportError:
        return b""
    with library():
        found: bytes = heif.open_heif(BytesIO(read_file(path))).info.get("exif") or b""
    return found


def read_raw(path: Path) -> tuple[np.ndarray, int]:
    """Grey levels (row, col) uint16 of a camera's raw file as the sensor lies, and its orientation.

    They are proportional to the light: without a tone curve, and with the camera's white balance. Raises as
    :func:`read_heic`.
    """
    rawpy = _decoder("rawpy", "rawpy", "a camera's raw file", "develop it to TIFF with 16 bits")
    data = BytesIO(read_file(path))
    try:
        return _developed(rawpy, data)
    except ValueError as error:
        raise InputError(
            f"a camera's raw file that its decoder cannot read ({error}); develop it to TIFF with 16 bits"
        ) from error


def _developed(rawpy: Any, data: BytesIO) -> tuple[np.ndarray, int]:
    """Grey levels and orientation of a raw file. Raises ValueError for one that cannot be decoded."""
    with library(), rawpy.imread(data) as raw:
        orientation = _FLIPS.get(int(raw.sizes.flip), 1)
        levels = raw.postprocess(
            gamma=(1, 1),
            no_auto_bright=True,
            use_camera_wb=True,
            output_bps=16,
            user_flip=0,
            output_color=rawpy.ColorSpace.raw,
        )
    grey: np.ndarray = opencv().cvtColor(levels, opencv().COLOR_RGB2GRAY)
    return grey, orientation


def _decoder(module: str, package: str, what: str, otherwise: str) -> Any:
    """A decoder that is installed on its own. Raises InputError that says how."""
    try:
        return import_module(module)
    except ImportError as error:
        raise InputError(
            f"{what} needs a decoder of its own; install it with 'pip install {package}', or {otherwise}"
        ) from error
