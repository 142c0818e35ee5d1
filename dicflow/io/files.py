"""Writing files for the user: whole or not at all."""

from __future__ import annotations

import os
from pathlib import Path

from dicflow.errors import InputError

__all__ = ["make_folder", "write_whole"]


def write_whole(path: Path, content: bytes) -> None:
    """Write a file, or replace it, as a whole; its folder is made where there is none.

    Raises InputError that names the file where it cannot be written; what stood there then still does.
    """
    part = path.with_name(f"{path.name}.{os.getpid()}.part")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            part.write_bytes(content)
            os.replace(part, path)
        except OSError:
            part.unlink(missing_ok=True)
            raise
    except OSError as error:
        raise _unwritable(path, error) from error


def make_folder(folder: Path) -> None:
    """Make a folder in which files can be written. Raises InputError that names it where that fails."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / f".{os.getpid()}.part"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise _unwritable(folder, error) from error


def _unwritable(path: Path, error: OSError) -> InputError:
    reason = (error.strerror or type(error).__name__).lower()
    if isinstance(error, FileExistsError | NotADirectoryError):
        reason = "a file stands where a folder should be"
    return InputError(f"{path}: cannot be written ({reason}); name another place, or free this one")
