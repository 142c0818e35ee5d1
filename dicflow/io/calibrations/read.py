"""Reading a calibration of any of the programs."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from dicflow.errors import ConfigurationError, InputError
from dicflow.io.calibrations import FORMATS
from dicflow.io.calibrations.draft import Calibration, Draft, Source, complete

__all__ = ["parse_calibration", "read_calibration"]


class _Format(Protocol):
    """A module that reads one program's files."""

    PROGRAM: str

    def recognises(self, source: Source) -> bool: ...
    def parse(self, source: Source) -> Draft: ...


_MAX_BYTES = 50_000_000


def read_calibration(path: Path, image_size: tuple[int, int] | None = None) -> Calibration:
    """The rig that a file holds, with warnings.

    image_size : (width, height) of the photographs to be measured [px]. It is used for
        files that do not give it, and must agree with those that do
    Raises InputError that names the file, the place in it and the remedy.
    """
    path = Path(path)
    return complete(path, parse_calibration(path), image_size)


def parse_calibration(path: Path) -> Draft:
    """The rig as a file gives it, not yet checked. Raises InputError for an unknown format, or for two that fit."""
    path = Path(path)
    source = Source(path, _bytes(path))
    formats, unusable = _formats()
    fitting = [known for known in formats if known.recognises(source)]
    specific = [known for known in fitting if not _is_general(known)] or fitting
    names = [known.PROGRAM for known in specific or formats]
    if len(specific) > 1:
        raise InputError(f"{path}: looks like a calibration of {' and of '.join(names)}; uninstall one of the plug-ins")
    if not specific:
        raise InputError(
            f"{path}: not a calibration of two cameras in a known format; expected a file of {', '.join(names)}; "
            "export the calibration as OpenCV YAML with cameraMatrix1, distCoeffs1, cameraMatrix2, distCoeffs2, R and T"
            + "".join(f"; {problem}" for problem in unusable)
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


def _bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: larger than any calibration ({_MAX_BYTES:,} bytes); name the calibration file")
        return path.read_bytes()
    except OSError as error:
        reason = (error.strerror or type(error).__name__).lower()
        raise InputError(f"{path}: the calibration cannot be read ({reason}); check the path") from error
