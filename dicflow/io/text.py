"""Text files of the user, written by any program.

Pipeline files, tables, regions, rigs and calibrations are read here. A byte-order mark decides the encoding, else zero
bytes show UTF-16 and UTF-32, else it is UTF-8. A file in none of them is read as Windows' western code page (cp1252) if
its reader says that only ASCII in it matters: numbers and names of columns. Lines may end in LF, CRLF or CR. The size
is checked before anything is read, and only regular files are opened: a pipe would wait for ever.
"""

from __future__ import annotations

import codecs
import io
import os
import re
import stat
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from dicflow.errors import InputError

__all__ = [
    "decoded",
    "find_control",
    "numbered_lines",
    "place_in",
    "printable",
    "read_bytes",
    "read_text",
]

_MARKS = (
    (codecs.BOM_UTF8, "utf-8-sig"),
    (codecs.BOM_UTF32_LE, "utf-32"),
    (codecs.BOM_UTF32_BE, "utf-32"),
    (codecs.BOM_UTF16_LE, "utf-16"),
    (codecs.BOM_UTF16_BE, "utf-16"),
)
"""Byte-order marks; that of UTF-32 begins as that of UTF-16 does."""
_ZEROS: dict[tuple[bool, ...], str] = {
    (False, True, True, True): "utf-32-le",
    (True, True, True, False): "utf-32-be",
    (False, True, False, True): "utf-16-le",
    (True, False, True, False): "utf-16-be",
}
"""Which of the first four bytes are zero in a file that begins with two ASCII characters."""
_CHUNK_BYTES = 1 << 20
_LONGEST_LINE = 100_000
_MOST_LINES = 3_000_000
_CONTROL = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ufeff\ufffe\uffff]")
"""Characters that no text holds, and that may steer a terminal."""
_SAVE = "save it as plain text in UTF-8 (in Windows' Notepad: Save as, encoding UTF-8)"


def read_text(path: Path, what: str, most_bytes: int, *, western: bool = False) -> str:
    """The whole text of a file, its lines ending in LF.

    what : noun for messages, such as "a pipeline file"
    western : read what is not Unicode as cp1252, for files in which only ASCII matters
    Raises InputError for a file that is missing, not regular, larger than ``most_bytes`` or not text.
    """
    return decoded(path, read_bytes(path, what, most_bytes), western=western)


def read_bytes(path: Path, what: str, most_bytes: int) -> bytes:
    """The bytes of a file. Raises InputError as :func:`read_text`."""
    with _open(path, what, most_bytes) as file:
        return file.read(most_bytes)


def decoded(path: Path, data: bytes, *, western: bool = False) -> str:
    """Bytes of a file as text, its lines ending in LF. Raises InputError if they are not text."""
    encoding = _encoding(path, io.BytesIO(data), western)
    try:
        text = data.decode(encoding, errors="replace" if encoding == "cp1252" else "strict")
    except UnicodeDecodeError as error:
        raise _damaged(str(path), encoding) from error
    text = text.replace("\r\n", "\n").replace("\r", "\n")
    if (index := find_control(text)) is not None:
        line, column = place_in(text, index)
        raise _not_text(f"{path}:{line}:{column}", text[index])
    return text


def numbered_lines(path: Path, what: str, most_bytes: int) -> Iterator[tuple[int, str]]:
    """Lines of a table without their ends, numbered from 1, read one by one; what is not Unicode is cp1252.

    Raises InputError as :func:`read_text`, also while it yields.
    """
    with _open(path, what, most_bytes) as file:
        encoding = _encoding(path, file, western=True)
        file.seek(0)
        text = io.TextIOWrapper(file, encoding, errors="replace" if encoding == "cp1252" else "strict", newline=None)
        number = 0
        try:
            while line := text.readline(_LONGEST_LINE + 1):
                number += 1
                if number > _MOST_LINES:
                    raise InputError(str(path), f"has more than {_MOST_LINES:,} lines", "give a shorter table")
                line = line.rstrip("\n")
                if len(line) > _LONGEST_LINE or _CONTROL.search(line):
                    raise _bad_line(f"{path}:{number}", line)
                yield number, line
        except UnicodeDecodeError as error:
            raise _damaged(f"{path}:{number + 1}", encoding) from error


def find_control(text: str) -> int | None:
    """Place of the first character that no text holds; None without one."""
    found = _CONTROL.search(text)
    return None if found is None else found.start()


def place_in(text: str, index: int) -> tuple[int, int]:
    """Line and column of a character, counted from 1."""
    return text.count("\n", 0, index) + 1, index - text.rfind("\n", 0, index)


def printable(text: object, most: int = 60) -> str:
    """Text from a file for a message: cut, and without characters that steer a terminal."""
    shown = str(text)
    cut = shown if len(shown) <= most else f"{shown[:most]}…"
    return "".join(char if char.isprintable() else f"\\u{ord(char):04x}" for char in cut)


def _bad_line(where: str, line: str) -> InputError:
    """What is wrong with a line that is too long or holds a control character."""
    index = find_control(line)
    if index is None or len(line) > _LONGEST_LINE:
        return InputError(where, f"is longer than {_LONGEST_LINE:,} characters", "write one row per line")
    return _not_text(f"{where}:{index + 1}", line[index])


def _not_text(where: str, char: str) -> InputError:
    return InputError(where, f"holds the control character U+{ord(char):04X}, so it is not text", _SAVE)


def _damaged(where: str, encoding: str) -> InputError:
    return InputError(where, f"is damaged {encoding.removesuffix('-sig').upper()} text", _SAVE)


def _open(path: Path, what: str, most_bytes: int) -> BinaryIO:
    """A regular file of limited size, open for reading."""
    try:
        number = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(printable(path, 300), f"{what} cannot be read ({reason.lower()})", "check the path") from error
    status = os.fstat(number)
    if stat.S_ISREG(status.st_mode) and status.st_size <= most_bytes:
        return os.fdopen(number, "rb")
    os.close(number)
    if stat.S_ISDIR(status.st_mode):
        raise InputError(str(path), f"expected {what}, but it is a folder", "name the file itself")
    if not stat.S_ISREG(status.st_mode):
        raise InputError(str(path), f"expected {what}, but it is not a regular file", "name the file itself")
    problem = f"is larger ({status.st_size:,} bytes) than {what} may be ({most_bytes:,} bytes)"
    raise InputError(str(path), problem, "check which file is named")


def _encoding(path: Path, file: BinaryIO, western: bool) -> str:
    """Python's name of the encoding of a file that is open at its start."""
    start = file.read(4)
    for mark, encoding in _MARKS:
        if start.startswith(mark):
            return encoding
    if encoding := _ZEROS.get(tuple(byte == 0 for byte in start), ""):
        return encoding
    file.seek(0)
    line = _line_not_utf8(file)
    if line is None:
        return "utf-8"
    if western:
        return "cp1252"
    raise InputError(f"{path}:{line}", "is not UTF-8 text", _SAVE)


def _line_not_utf8(file: BinaryIO) -> int | None:
    """Number of the first line that is not UTF-8; None if the whole file is."""
    decoder, line = codecs.getincrementaldecoder("utf-8")(), 1
    while True:
        chunk = file.read(_CHUNK_BYTES)
        try:
            decoder.decode(chunk, final=not chunk)
        except UnicodeDecodeError as error:
            return line + error.object[: error.start].count(b"\n")
        if not chunk:
            return None
        line += chunk.count(b"\n")
