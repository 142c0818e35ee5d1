"""The logo of a laboratory, small enough for the head of a page."""

from __future__ import annotations

import io
from pathlib import Path

from PIL import Image, UnidentifiedImageError

from dicflow.engine.whole_file import read_file
from dicflow.errors import InputError

__all__ = ["logo_png"]

_LARGEST_FILE = 5_000_000
_MOST_PIXELS = 25_000_000
_SIZE = (480, 144)
"""Width and height that it is reduced to [px], twice those on the screen."""
_REMEDY = "name a PNG or JPEG file of at most 5 MB and 25 million pixels"


def logo_png(folder: Path, name: str) -> bytes:
    """A picture below a folder as PNG without metadata, at most 480 × 144 px large.

    Raises InputError if it cannot be used, also for one that a link leads out of the folder.
    """
    path = folder / name
    if not path.resolve().is_relative_to(folder.resolve()):
        raise InputError(f"report.logo: {name}", "lies outside the pipeline file's folder", "copy it beside the file")
    try:
        return _reduced(read_file(path, _LARGEST_FILE))
    except (OSError, ValueError, SyntaxError, Image.DecompressionBombError) as error:
        problem = _problem(error)
        raise InputError(f"report.logo: {name}", problem, _REMEDY) from error


def _reduced(content: bytes) -> bytes:
    with Image.open(io.BytesIO(content), formats=("PNG", "JPEG")) as picture:
        if picture.width * picture.height > _MOST_PIXELS:
            raise ValueError(f"has {picture.width} × {picture.height} px")
        logo = picture.convert("RGBA")
    logo.thumbnail(_SIZE)
    buffer = io.BytesIO()
    logo.save(buffer, "PNG")
    return buffer.getvalue()


def _problem(error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return "does not exist"
    if isinstance(error, UnidentifiedImageError):
        return "is neither PNG nor JPEG"
    return f"cannot be used ({error})" if isinstance(error, ValueError) else f"cannot be read ({error})"
