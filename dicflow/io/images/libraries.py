"""OpenCV and Pillow, silent: the error that names the file says enough."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING, Any, BinaryIO

from dicflow.errors import InputError
from dicflow.io.images.formats import Format
from dicflow.io.text import printable

if TYPE_CHECKING:
    from PIL.ImageFile import ImageFile

__all__ = ["library", "opencv", "opened", "pillow"]

_MOST_LETTERS = 200
"""Of what a library says about a file."""
_SILENT = 0
"""OpenCV's level of logging that prints nothing."""


@contextmanager
def opened(file: BinaryIO, form: Format) -> Iterator[ImageFile]:
    """A photograph that Pillow has opened, but not decoded. Raises ValueError if it cannot."""
    with library():
        image = pillow().open(file, formats=(form,))
    with image:
        yield image


@contextmanager
def library() -> Iterator[None]:
    """Turn any error of a library on a damaged file into ValueError, with a text of one line for a message."""
    try:
        yield
    except (MemoryError, InputError, pillow().DecompressionBombError):
        raise
    except Exception as error:
        raise ValueError(printable(" ".join(str(error).split()), _MOST_LETTERS)) from error


@cache
def opencv() -> Any:
    """OpenCV with its log switched off."""
    import cv2

    module: Any = cv2
    set_level = module.setLogLevel if hasattr(module, "setLogLevel") else module.utils.logging.setLogLevel
    set_level(_SILENT)
    return module


@cache
def pillow() -> Any:
    """Pillow without its warnings, with TIFF, which it would load all of its formats to find."""
    import logging
    import warnings

    from PIL import Image, TiffImagePlugin  # noqa: F401

    logging.getLogger("PIL").setLevel(logging.CRITICAL)
    warnings.filterwarnings("ignore", module=r"PIL\.")
    return Image
