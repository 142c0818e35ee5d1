"""Reading a calibration, whatever program wrote it."""

from __future__ import annotations

from pathlib import Path
from typing import Protocol

from dicflow.errors import InputError
from dicflow.io.calibrations import dice, dicflow_json, matchid, matlab, opencorr, opencv, pyvale, vic3d
from dicflow.io.calibrations.draft import Calibration, Draft, Source, complete

__all__ = ["parse_calibration", "read_calibration"]


class _Format(Protocol):
    """A module of this package that reads one program's files."""

    PROGRAM: str

    def recognises(self, source: Source) -> bool: ...
    def parse(self, source: Source) -> Draft: ...


_FORMATS: tuple[_Format, ...] = (matlab, vic3d, dice, dicflow_json, pyvale, matchid, opencorr, opencv)
"""The specific ones before OpenCV's, whose entries have many names."""
_MAX_BYTES = 50_000_000


def read_calibration(path: Path, image_size: tuple[int, int] | None = None) -> Calibration:
    """The rig that a file holds, and what its user should know.

    image_size : (width, height) of the photographs to be measured [px]. It completes formats that do not say it, and
        is checked against those that do
    Raises InputError that names the file, the place in it and the remedy.
    """
    path = Path(path)
    return complete(path, parse_calibration(path), image_size)


def parse_calibration(path: Path) -> Draft:
    """What a file says of a rig, not yet checked. Raises InputError where it is no calibration of a known format."""
    path = Path(path)
    source = Source(path, _bytes(path))
    for known in _FORMATS:
        if known.recognises(source):
            return known.parse(source)
    names = ", ".join(known.PROGRAM for known in _FORMATS)
    raise InputError(
        f"{path}: is no calibration of two cameras that dicflow knows; expected a file of {names}; "
        "export the calibration as OpenCV YAML with cameraMatrix1, distCoeffs1, cameraMatrix2, distCoeffs2, R and T"
    )


def _bytes(path: Path) -> bytes:
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise InputError(f"{path}: larger than any calibration ({_MAX_BYTES:,} bytes); name the calibration file")
        return path.read_bytes()
    except OSError as error:
        reason = (error.strerror or type(error).__name__).lower()
        raise InputError(f"{path}: the calibration cannot be read ({reason}); check the path") from error
