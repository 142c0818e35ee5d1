"""Reading and writing files as a whole. Only a regular file is read: a pipe or a device could hang, or never end."""

from __future__ import annotations

import errno
import os
import stat
from contextlib import suppress
from io import BufferedReader
from pathlib import Path

from dicflow.engine.drafts import draft_name

__all__ = ["LARGEST", "LARGEST_TEXT", "NO_WAIT", "NotRegularError", "file_size", "open_file", "read_file", "write_file"]

LARGEST, LARGEST_TEXT = 1 << 31, 1 << 29
"""Arrays and texts of the store above this size [bytes] are damage, and photographs above it are refused: to read one
could take all memory."""
NO_WAIT = getattr(os, "O_NONBLOCK", 0)
"""Flag with which opening a pipe does not wait."""


class NotRegularError(OSError):
    """Something else than a regular file, or an endless one, has the name of a file: a folder, a pipe, a device."""


def open_file(path: Path, largest: int | None = None) -> BufferedReader:
    """Open a regular file for reading; never waits.

    largest : most bytes that it may have
    Raises OSError, NotRegularError for anything but a file and for a larger one.
    """

    def opened(name: str, flags: int) -> int:
        return _opened(name, flags, largest)

    return open(path, "rb", opener=opened)


def read_file(path: Path, largest: int = LARGEST) -> bytes:
    """Contents of a regular file of limited size. Raises as :func:`open_file` does."""
    with open_file(path, largest) as file:
        return file.read()


def write_file(path: Path, content: bytes, draft: Path | None = None, durable: bool = False) -> None:
    """Write a file, or replace it. No process ever reads half of it, and a killed one leaves only the draft.

    draft : where the content is written before it is renamed, on the same file system; beside the file by default
    durable : wait until the file is on the disk, so that it survives a power failure
    Raises OSError. An existing file is then left untouched, and the draft is deleted.
    """
    draft = draft or path.with_name(f"{path.name}.{draft_name()}.part")
    try:
        draft.write_bytes(content)
        if durable:
            _sync(draft, os.O_RDWR)
        os.replace(draft, path)
        if durable:
            _sync_folder(path.parent)
    except BaseException:
        with suppress(OSError):
            draft.unlink(missing_ok=True)
        raise


def file_size(path: Path) -> int | None:
    """Size of a regular file [bytes]; None if it is missing, or something else has its name. Raises OSError."""
    try:
        status = os.stat(path)
    except (FileNotFoundError, NotADirectoryError):
        return None
    return status.st_size if stat.S_ISREG(status.st_mode) else None


def _sync_folder(folder: Path) -> None:
    """Wait until the names in a folder are on the disk, where the system can."""
    if os.name == "posix":
        _sync(folder, os.O_RDONLY)


def _sync(path: Path, flags: int) -> None:
    descriptor = os.open(path, flags)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def _opened(path: str, flags: int, largest: int | None) -> int:
    try:
        descriptor = os.open(path, flags | NO_WAIT)
    except OSError as error:
        if error.errno == errno.ENXIO:  # a socket
            raise NotRegularError(errno.EINVAL, "not a regular file", path) from error
        raise
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode):
        os.close(descriptor)
        raise NotRegularError(errno.EINVAL, "not a regular file", path)
    if largest is not None and status.st_size > largest:
        os.close(descriptor)
        raise NotRegularError(errno.EFBIG, f"larger than {largest} bytes", path)
    return descriptor
