"""Photographs: PNG, TIFF, JPEG and BMP with 8 or 16 bits, colour or grey."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dicflow.errors import InputError

__all__ = ["SUFFIXES", "Pairing", "natural_key", "pair_names", "probe", "read_grey"]

SUFFIXES = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".bmp")
_EXIF_ORIENTATION = 0x0112


def natural_key(name: str) -> tuple[tuple[int, int | str], ...]:
    """Sort key that reads runs of digits as numbers: a2 before a10.

    >>> sorted(["a10", "a2"], key=natural_key)
    ['a2', 'a10']
    """
    parts = re.findall(r"\d+|\D+", name)
    return tuple((0, int(part)) if part.isdigit() else (1, part.lower()) for part in parts)


def probe(path: Path) -> dict[str, int]:
    """Decode one photograph and describe it.

    Returns width, height [px], bits per channel and the EXIF orientation (1 where there is none).
    Raises InputError that names the file where it is missing, of no known format, or truncated.
    """
    from PIL import Image, UnidentifiedImageError

    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: not a photograph that dicflow reads; expected one of {', '.join(SUFFIXES)}")
    try:
        with Image.open(path) as image:
            orientation = int(image.getexif().get(_EXIF_ORIENTATION, 1))
            image.load()
            if image.mode == "F":
                raise InputError(f"{path}: holds numbers with fractions; save it as PNG or TIFF with 8 or 16 bits")
            bits = 16 if image.mode.startswith("I") else 8
            return {"width": image.width, "height": image.height, "bits": bits, "orientation": orientation}
    except FileNotFoundError as error:
        raise InputError(f"{path}: no such file; check the folder and the pattern") from error
    except PermissionError as error:
        raise InputError(f"{path}: may not be read; get the right to, or leave it out") from error
    except Image.DecompressionBombError as error:
        raise InputError(f"{path}: larger than any camera's photograph; cut it to the specimen") from error
    except (UnidentifiedImageError, OSError, SyntaxError, ValueError) as error:
        reason = "empty" if path.stat().st_size == 0 else "truncated or damaged"
        raise InputError(
            f"{path}: the photograph is {reason}; copy it again from the camera or leave it out"
        ) from error


def read_grey(path: Path) -> np.ndarray:
    """Grey levels of one photograph as it lies on the sensor, whatever its EXIF orientation says.

    Returns (row, col) uint8 or uint16; colour is weighted to luma (ITU-R BT.601).
    Raises InputError where the file cannot be decoded.
    """
    import cv2

    data = np.fromfile(path, dtype=np.uint8)
    flags = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    grey: np.ndarray | None = cv2.imdecode(data, flags) if data.size else None
    if grey is None or grey.dtype not in (np.uint8, np.uint16):
        raise InputError(f"{path}: expected grey levels of 8 or 16 bits; save the photograph as PNG or TIFF")
    return grey


class Pairing(NamedTuple):
    """Partners among two lists of names.

    pairs : (left, right) names in the order of the left ones
    by : "name" or "order"
    """

    pairs: tuple[tuple[str, str], ...]
    by: str


def pair_names(left: Sequence[str], right: Sequence[str]) -> Pairing:
    """Pair the photographs of two cameras: by the numbers in their names where these agree, else in the order given.

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
    """Names by the numbers that vary among them; by their stems where the names have no common form."""
    stems = [Path(name).stem for name in names]
    numbers = [tuple(int(digits) for digits in re.findall(r"\d+", stem)) for stem in stems]
    if len({len(row) for row in numbers}) == 1:
        varying = [column for column in zip(*numbers, strict=True) if len(set(column)) > 1]
        keys = list(zip(*varying, strict=True)) or [()] * len(names)
        if len(set(keys)) == len(names):
            return dict(zip(keys, names, strict=True))
    return dict(zip(stems, names, strict=True))
