"""When a photograph was taken, by its EXIF metadata."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

from dicflow.errors import InputError
from dicflow.io.images.extras import heic_metadata
from dicflow.io.images.formats import format_of
from dicflow.io.images.libraries import library, opened, pillow
from dicflow.io.images.metadata import metadata

__all__ = ["time_taken"]

_EXIF = 34665
"""Tag of the directory of the camera's settings (EXIF 2.32)."""
_TIME, _FRACTION, _OFFSET = 36867, 37521, 36881
"""Tags DateTimeOriginal, SubSecTimeOriginal and OffsetTimeOriginal in it."""
_TIME_FORM = re.compile(r"(\d{4})[:/.-](\d\d)[:/.-](\d\d)[ T](\d\d):(\d\d):(\d\d)")
_FRACTION_FORM, _OFFSET_FORM = re.compile(r"\d{1,9}"), re.compile(r"([+-])(\d\d):?(\d\d)")


def time_taken(path: Path) -> float | None:
    """When a photograph was taken [s since 1970]; None if the file does not say it, or cannot be read.

    The moment and the fraction of a second are those of EXIF (DateTimeOriginal, SubSecTimeOriginal). Without an offset
    from UTC (OffsetTimeOriginal) the camera's clock counts as UTC; differences of its times are right all the same.
    """
    try:
        return next((time for tags in _settings(path) if (time := _moment(tags)) is not None), None)
    except (InputError, OSError, OverflowError, ValueError, pillow().DecompressionBombError):
        return None


def _settings(path: Path) -> Iterator[Mapping[int, Any]]:
    """The camera's settings, tag by tag, of each block of metadata that has some."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        form = format_of(file)
        if form == "TIFF":
            file.seek(0)
            with opened(file, form) as image, library():
                yield image.getexif().get_ifd(_EXIF)
        elif form == "HEIC":
            yield _directory(heic_metadata(path))
        elif form in ("PNG", "JPEG"):
            for block in metadata(file, form):
                yield _directory(block)


def _directory(block: bytes) -> Mapping[int, Any]:
    exif = pillow().Exif()
    try:
        with library():
            exif.load(block)
            return dict(exif.get_ifd(_EXIF))
    except ValueError:
        return {}


def _moment(tags: Mapping[int, Any]) -> float | None:
    """The moment that the settings of a camera give [s since 1970]."""
    time, fraction, offset = (_text(tags.get(tag)) for tag in (_TIME, _FRACTION, _OFFSET))
    found = _TIME_FORM.fullmatch(time)
    if found is None:
        return None
    year, month, day, hour, minute, second = map(int, found.groups())
    moment = datetime(year, month, day, hour, minute, second, tzinfo=UTC) - _from_utc(offset)
    return moment.timestamp() + (float(f"0.{fraction}") if _FRACTION_FORM.fullmatch(fraction) else 0.0)


def _from_utc(offset: str) -> timedelta:
    found = _OFFSET_FORM.fullmatch(offset)
    if found is None:
        return timedelta()
    sign = -1 if found[1] == "-" else 1
    return sign * timedelta(hours=int(found[2]), minutes=int(found[3]))


def _text(value: Any) -> str:
    return value.strip("\0 ") if isinstance(value, str) and value.isascii() else ""
