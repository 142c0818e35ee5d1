"""Facts about files, kept while the files are unchanged.

A run with nothing to do must not read gigabytes of photographs. So a file's digest, the facts that a stage's
``check`` returns, and the syntax of a source file are kept with the file's size, times and inode.
"""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from stat import S_ISREG
from typing import Any, NamedTuple

from dicflow.engine.hashing import digest_file, digest_json
from dicflow.engine.stored_json import anything, fields, is_number, list_of, mapping_of, seal, stored
from dicflow.engine.whole_file import write_file
from dicflow.errors import InputError

__all__ = ["FACTS", "FileIndex", "FilePart", "Stamp", "part_digest", "stamp"]

FACTS = mapping_of(fields({"stamp": list_of(is_number), "facts": mapping_of(anything)}))
"""Form of the index's file: by path of a file its stamp and its facts, by purpose."""

_FRESH_NS = 2_000_000_000
"""A file changed more recently than the coarsest file system's clock ticks may change again within the same tick."""


@dataclass(frozen=True, order=True, slots=True)
class FilePart:
    """One of several parts of a file, such as a page; where a path is asked for, it stands for the whole file.

    number : from 1
    """

    path: Path
    number: int

    def __fspath__(self) -> str:
        return os.fspath(self.path)

    def __str__(self) -> str:
        return f"{self.path}#{self.number}"


class Stamp(NamedTuple):
    """Size [bytes], two times [ns] and inode of a file: equal stamps, unchanged file.

    mtime_ns : of the last change of the contents, which anybody may set to another time
    ctime_ns : of the last change of contents, name, owner or times, which the system alone sets
    """

    size: int
    mtime_ns: int
    ctime_ns: int
    inode: int


def stamp(path: Path | FilePart) -> Stamp:
    """The stamp of a file. Raises InputError that names a file that cannot be found, or is not a regular file."""
    try:
        status = os.stat(path)
    except OSError as error:
        raise _unreadable(path, error) from error
    if not S_ISREG(status.st_mode):
        raise InputError(f"{path}: cannot be read (not a regular file); name a file")
    return Stamp(status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino)


def part_digest(whole: str, number: int) -> str:
    """Digest of a part of a file, by that of the whole and the part's number."""
    return digest_json([whole, number])


class FileIndex:
    """Facts about files by path and stamp, kept in one JSON file.

    path : of the JSON file; a missing or damaged file is an empty index
    write : writes it
    """

    def __init__(self, path: Path, write: Callable[[Path, bytes], None] = write_file) -> None:
        self.path = path
        self._write = write
        self._entries = _read(path)
        self._new: dict[str, Any] = {}

    def fact(self, file: Path | FilePart, purpose: str, find: Callable[[Any], Any]) -> Any:
        """The JSON value ``find(file)``, which is called again only after the file has changed.

        purpose : name of the fact
        file : parts of one file need purposes of their own
        Raises InputError if the file cannot be read, and the errors of ``find``.
        """
        name, now = os.path.abspath(file), stamp(file)
        entry = self._entries.get(name)
        if entry is not None and entry["stamp"] == list(now) and purpose in entry["facts"]:
            return entry["facts"][purpose]
        try:
            value = find(file)
        except OSError as error:
            raise _unreadable(file, error) from error
        self._remember(name, now, purpose, value)
        return value

    def digest(self, file: Path) -> str:
        """Digest of the file's bytes. Raises InputError if it cannot be read."""
        return str(self.fact(file, "digest", digest_file))

    def save(self) -> None:
        """Write the facts found since, together with those that other processes have written.

        A store that is read-only or full is ignored here: the index only saves time.
        """
        if not self._new:
            return
        merged = {**_read(self.path), **self._new}
        with suppress(OSError):
            self._write(self.path, seal(merged))
        self._new = {}

    def _remember(self, name: str, now: Stamp, purpose: str, value: Any) -> None:
        if time.time_ns() - max(now.mtime_ns, now.ctime_ns) < _FRESH_NS:
            return
        entry = self._entries.get(name)
        if entry is None or entry["stamp"] != list(now):
            entry = {"stamp": list(now), "facts": {}}
        entry["facts"][purpose] = value
        self._entries[name] = self._new[name] = entry


def _read(path: Path) -> dict[str, Any]:
    return stored(path, FACTS) or {}


def _unreadable(path: Path | FilePart, error: OSError) -> InputError:
    reason = error.strerror or type(error).__name__
    return InputError(f"{path}: cannot be read ({reason.lower()}); check the path, or leave the file out")
