"""When a photograph was taken, and by which camera, by its EXIF metadata."""

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

__all__ = ["camera_model", "time_taken", "utc_offset_taken"]

_EXIF = 34665
"""Tag of the directory of the camera's settings (EXIF 2.32)."""
_TIME, _FRACTION, _OFFSET = 36867, 37521, 36881
"""Tags DateTimeOriginal, SubSecTimeOriginal and OffsetTimeOriginal in it."""
_MAKE, _MODEL = 271, 272
"""Tags Make and Model of TIFF 6.0."""
_TIME_FORM = re.compile(r"(\d{4})[:/.-](\d\d)[:/.-](\d\d)[ T](\d\d):(\d\d):(\d\d)")
_FRACTION_FORM, _OFFSET_FORM = re.compile(r"\d{1,9}"), re.compile(r"([+-])(\d\d):?(\d\d)")


def time_taken(path: Path) -> float | None:
    """When a photograph was taken [s since 1970]; None if the file does not say it, or cannot be read.

    The moment and the fraction of a second are those of EXIF (DateTimeOriginal, SubSecTimeOriginal). Without an offset
    from UTC (OffsetTimeOriginal) the camera's clock counts as UTC; differences of its times are right all the same.
    """
    moment = _moment_and_offset(path)
    return None if moment is None else moment[0]


def utc_offset_taken(path: Path) -> float | None:
    """What the clock shows more than UTC [s] by which a photograph was taken; None if the file does not say it."""
    moment = _moment_and_offset(path)
    return None if moment is None else moment[1]


def _moment_and_offset(path: Path) -> tuple[float, float | None] | None:
    try:
        return next((found for tags in _tags(path) if (found := _moment(tags)) is not None), None)
    except (InputError, OSError, OverflowError, ValueError, pillow().DecompressionBombError):
        return None


def camera_model(path: Path) -> str:
    """Make and model of the camera, as ``Apple iPhone 12``; empty if the file does not say it, or cannot be read."""
    try:
        return next((name for tags in _tags(path) if (name := _name(tags))), "")
    except (InputError, OSError, ValueError, pillow().DecompressionBombError):
        return ""


def _tags(path: Path) -> Iterator[Mapping[int, Any]]:
    """Tags of the file and of the camera's settings, of each block of metadata that has some."""
    if not path.is_file():
        return
    with path.open("rb") as file:
        form = format_of(file)
        if form == "TIFF":
            file.seek(0)
            with opened(file, form) as image, library():
                yield _values(image.getexif())
        elif form == "HEIC":
            yield _loaded(heic_metadata(path))
        elif form in ("PNG", "JPEG"):
            for block in metadata(file, form):
                yield _loaded(block)


def _loaded(block: bytes) -> Mapping[int, Any]:
    exif = pillow().Exif()
    try:
        with library():
            exif.load(block)
            return _values(exif)
    except ValueError:
        return {}


def _values(exif: Any) -> Mapping[int, Any]:
    return {**exif, **exif.get_ifd(_EXIF)}


def _name(tags: Mapping[int, Any]) -> str:
    """Make and model; the make once, where the model begins with it."""
    make, model = (_text(tags.get(tag)) for tag in (_MAKE, _MODEL))
    return model if model.lower().startswith(make.lower()) else f"{make} {model}".strip()


def _moment(tags: Mapping[int, Any]) -> tuple[float, float | None] | None:
    """The moment that the settings of a camera give [s since 1970], and its clock's offset from UTC [s]."""
    time, fraction, offset = (_text(tags.get(tag)) for tag in (_TIME, _FRACTION, _OFFSET))
    found = _TIME_FORM.fullmatch(time)
    if found is None:
        return None
    year, month, day, hour, minute, second = map(int, found.groups())
    from_utc = _from_utc(offset)
    moment = datetime(year, month, day, hour, minute, second, tzinfo=UTC) - (from_utc or timedelta())
    seconds = moment.timestamp() + (float(f"0.{fraction}") if _FRACTION_FORM.fullmatch(fraction) else 0.0)
    return seconds, None if from_utc is None else from_utc.total_seconds()


def _from_utc(offset: str) -> timedelta | None:
    found = _OFFSET_FORM.fullmatch(offset)
    if found is None:
        return timedelta() if offset == "Z" else None
    sign = -1 if found[1] == "-" else 1
    return sign * timedelta(hours=int(found[2]), minutes=int(found[3]))


def _text(value: Any) -> str:
    return value.strip("\0 ") if isinstance(value, str) and value.isascii() else ""
