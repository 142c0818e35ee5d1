"""Reading a calibration of any of the programs."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from dicflow.errors import ConfigurationError, InputError
from dicflow.io.calibrations import FORMATS
from dicflow.io.calibrations.draft import MAX_TEXT_BYTES, Calibration, Draft, Source, complete
from dicflow.io.text import read_bytes

__all__ = ["parse_calibration", "read_calibration"]


class _Format(Protocol):
    """A module that reads one program's files."""

    PROGRAM: str

    def recognises(self, source: Source) -> bool: ...
    def parse(self, source: Source) -> Draft: ...


_MAX_BYTES = 50_000_000


def read_calibration(
    path: Path, image_size: tuple[int, int] | None = None, right_size: tuple[int, int] | None = None
) -> Calibration:
    """The rig that a file holds, with warnings.

    image_size : (width, height) of the photographs to be measured [px]. It is used for
        files that do not give it, and must agree with those that do
    right_size : the same of the right camera, where it differs
    Raises InputError that names the file, the place in it and the remedy.
    """
    path = Path(path)
    return complete(path, parse_calibration(path), image_size, right_size or image_size)


def parse_calibration(path: Path) -> Draft:
    """The rig as a file gives it, not yet checked. Raises InputError for an unknown format, or for two that fit."""
    path = Path(path)
    source = Source(path, read_bytes(path, "a calibration", _MAX_BYTES))
    formats, unusable = _formats()
    fitting = [known for known in formats if known.recognises(source)]
    specific = [known for known in fitting if not _is_general(known)] or fitting
    names = [known.PROGRAM for known in specific or formats]
    if len(specific) > 1:
        problem = f"looks like a calibration of {' and of '.join(names)}"
        raise InputError(str(path), problem, "uninstall one of the plug-ins")
    if not specific and len(source.data) > MAX_TEXT_BYTES:
        problem = f"is larger ({len(source.data):,} bytes) than a calibration in text ever is"
        raise InputError(str(path), problem, "name the calibration file")
    if not specific:
        raise InputError(
            str(path),
            f"not a calibration of two cameras in a known format, expected a file of {', '.join(names)}",
            "export the calibration as OpenCV YAML with cameraMatrix1, distCoeffs1, cameraMatrix2, distCoeffs2, R and T"
            + "".join(f"; {problem}" for problem in unusable),
        )
    return specific[0].parse(source)


def _formats() -> tuple[list[_Format], list[str]]:
    """The formats, general ones last, and a message for each plug-in that cannot be used."""
    found: list[_Format] = []
    unusable: list[str] = []
    for name in FORMATS.names():
        try:
            found.append(FORMATS.load(name))
        except ConfigurationError as error:
            unusable.append(str(error))
    return sorted(found, key=_is_general), unusable


def _is_general(known: _Format) -> bool:
    """Whether a more specific format is preferred if both recognise a file."""
    return bool(getattr(known, "GENERAL", False))
