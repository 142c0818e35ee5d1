"""The packed index of a store: what every key came to, so that a plan of many tasks need not open its records.

One line per action, all of one length, in hexadecimal::

    <key> <digest of the product> <form> <digest of the code> <CRC-32 of what stands before>

The index saves time and is never the truth; the records and manifests are. A line that is torn, damaged or lost on a
full disk is a key that the index does not know: a plan then reads the record and appends the line again. So the file
may be deleted at any time.

All processes append to one file, a line by one write to a descriptor opened with O_APPEND: a local file system puts
such writes one behind the other. On a network file system two machines may overwrite each other; since all lines have
one length, one line is then lost and the others stay whole. One file per writer would avoid that, but every worker of
every run would leave a file behind.
"""

from __future__ import annotations

import os
import zlib
from collections.abc import Callable, Collection, Iterable
from contextlib import suppress
from itertools import groupby
from pathlib import Path
from sys import intern
from typing import NamedTuple

from dicflow.engine.objects import Manifest
from dicflow.engine.records import Record
from dicflow.engine.whole_file import LARGEST_TEXT, NO_WAIT, open_file, write_file

__all__ = ["Action", "ActionIndex", "action_of"]

_PREFIX = "sha256:"
_LINE = 3 * 64 + 1 + 4 + 8
"""Length of a line without its end [bytes]: three digests, the form, four spaces, the check sum."""

_LETTERS = b"0123456789abcdef rABR"
"""What the beginning of a line consists of."""

_ARRAYS, _BARE, _REMADE = "a", "b", "r"
"""Forms of a product: with a group of arrays, without arrays, and one that is made again when it is used.

A capital letter says that the record has warnings.
"""


class Action(NamedTuple):
    """What the index holds of a key.

    digest : of the product
    form : "a": its arrays are stored; "b": it has no arrays; "r": it is made again when it is used; a capital letter
        says that the record has warnings
    code : digest of the code that made it
    """

    digest: str
    form: str
    code: str

    @property
    def kept(self) -> bool:
        """Whether the product can be read from the store."""
        return self.form.lower() != _REMADE

    @property
    def warned(self) -> bool:
        """Whether the record has warnings."""
        return self.form.isupper()


def action_of(record: Record, manifest: Manifest) -> Action:
    """What the index holds of a record. manifest : of its product"""
    form = _REMADE if not manifest.kept else _ARRAYS if manifest.files else _BARE
    return Action(record.digest, form.upper() if record.warnings else form, record.code)


class ActionIndex:
    """The index in a file. A missing file is an empty index."""

    def __init__(self, path: Path, write: Callable[[Path, bytes], None] = write_file) -> None:
        self.path = path
        self._write = write

    def append(self, actions: Iterable[tuple[str, Action]]) -> None:
        """Add pairs (key, action). A store that is full or cannot be written is ignored: the records are enough."""
        lines = b"".join(_line(key, action) for key, action in actions)
        if not lines:
            return
        with suppress(OSError):
            descriptor = os.open(self.path, os.O_WRONLY | os.O_APPEND | os.O_CREAT | NO_WAIT, 0o666)
            try:
                os.write(descriptor, lines)
            finally:
                os.close(descriptor)

    def read(self) -> dict[str, Action]:
        """Key → action, by the last line of each key. Damaged lines are left out."""
        try:
            with open_file(self.path, LARGEST_TEXT) as file:
                return dict(filter(None, map(_parsed, file)))
        except OSError:
            return {}

    def damaged_lines(self) -> int:
        """Number of lines that cannot be read or hold more than one action. Raises OSError.

        The beginning of a line at the end of the file does not count: another process may be writing it.
        """
        with open_file(self.path, LARGEST_TEXT) as file:
            return sum(map(_is_damaged, file))

    def present(self, store: Path) -> dict[str, Action]:
        """The actions whose record and product are in the store, by the names in its folders.

        A folder is listed once, which takes the place of looking at every file: a file that is missing inside the
        group of a product is found when its array is read.
        """
        actions = self.read()
        _drop(actions, store / "actions", lambda key: key, lambda key, names: f"{_hex(key)}.json" in names)
        _drop(
            actions, store / "objects", lambda key: actions[key].digest, lambda key, names: _fits(actions[key], names)
        )
        return actions

    def keep_only(self, keys: Collection[str]) -> None:
        """Leave out all other keys, and damaged lines. Raises OSError.

        A line that another process appends meanwhile may be lost; a plan will append it again.
        """
        if self.path.exists():
            lines = (_line(key, action) for key, action in self.read().items() if key in keys)
            self._write(self.path, b"".join(lines))


def _drop(
    actions: dict[str, Action],
    folder: Path,
    digest: Callable[[str], str],
    fits: Callable[[str, frozenset[str]], bool],
) -> None:
    """Take out the actions that do not fit the names in one of the folders ``ab``, chosen by a digest of theirs."""
    for prefix, keys in groupby(sorted(actions, key=digest), lambda key: _hex(digest(key))[:2]):
        names = _names(folder / prefix)
        for key in [key for key in keys if not fits(key, names)]:
            del actions[key]


def _fits(action: Action, names: frozenset[str]) -> bool:
    """Whether the manifest of a product is there, and its group of arrays just where it has one."""
    name = _hex(action.digest)
    return f"{name}.json" in names and (name in names) == (action.form.lower() == _ARRAYS)


def _names(folder: Path) -> frozenset[str]:
    try:
        return frozenset(os.listdir(folder))
    except OSError:
        return frozenset()


def _hex(digest: str) -> str:
    return digest[len(_PREFIX) :]


def _line(key: str, action: Action) -> bytes:
    body = f"{_hex(key)} {_hex(action.digest)} {action.form} {_hex(action.code)}".encode("ascii")
    return b"%b %08x\n" % (body, zlib.crc32(body))


def _is_damaged(line: bytes) -> bool:
    if len(line) == _LINE + 1:
        return _parsed(line) is None
    return len(line) > _LINE or bool(line.translate(None, _LETTERS))


def _parsed(line: bytes) -> tuple[str, Action] | None:
    """Key and action of a line; what stands before it in the line is the rest of one that was cut short."""
    line = line.rstrip(b"\n")[-_LINE:]
    body = line[:-9]
    if len(line) != _LINE or line[-8:] != b"%08x" % zlib.crc32(body):
        return None
    key, digest, form, code = body.decode("ascii").split(" ")
    return _PREFIX + key, Action(_PREFIX + digest, intern(form), intern(_PREFIX + code))
