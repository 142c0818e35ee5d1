"""Files that a pattern names: ``*`` and ``?`` stand for characters, ``[ab]`` for one of several, ``**`` for folders.

A part of a pattern that is the name of a file or folder as it stands is no wildcard, so ``photos [test 1]/*.png`` finds
what it seems to. Names count as equal in both Unicode forms of an accented letter, suffixes in upper and lower case,
and a back-slash parts folders. As in a shell, a wildcard does not stand for hidden files. It does not enter linked
folders either: these may lead anywhere, or in a circle.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from unicodedata import normalize

from dicflow.errors import InputError

__all__ = ["MOST_ENTRIES", "find_files", "fits", "search_start"]

MOST_ENTRIES = 300_000
"""Files and folders that one search looks at."""
_ANY_DEPTH = "**"


def search_start(folder: Path, pattern: str) -> tuple[Path, list[str]]:
    """Where a search begins, and the parts of the pattern below; no parts if the pattern is a plain path.

    folder : where a relative pattern starts
    Raises InputError for a pattern that no file can match.
    """
    if "\0" in pattern:
        raise InputError(f"{pattern!r}: a name cannot hold a zero byte; correct the pattern")
    start = folder / Path(pattern).anchor
    parts = list(Path(pattern).parts[bool(Path(pattern).anchor) :])
    while parts:
        found = _existing(start, parts[0])
        if found is None and "\\" in parts[0]:
            parts[:1] = [part for part in parts[0].split("\\") if part]
        elif found is None and _is_wild(parts[0]):
            break
        else:
            start = found or start / parts[0]
            del parts[0]
    if ".." in parts:
        raise InputError(f"{pattern!r}: '..' after a wildcard; name the folder in which to search")
    return start, parts


def find_files(start: Path, parts: list[str]) -> list[Path]:
    """The files that a pattern matches, in no particular order.

    start, parts : where the search begins, and the parts of the pattern below, as :func:`search_start` gives them
    Raises InputError where the search would go through more than MOST_ENTRIES files and folders.
    """
    found: dict[Path, None] = {}
    waiting, visited = [(start, parts)], 0
    while waiting:
        place, (part, *rest) = waiting.pop()
        rest = rest or (["*"] if part == _ANY_DEPTH else [])
        if part == _ANY_DEPTH:
            waiting.append((place, rest))
            part, rest = "*", [_ANY_DEPTH, *rest]
        for entry in _entries(place, part):
            visited += 1
            if visited > MOST_ENTRIES:
                raise InputError(
                    f"{'/'.join(parts)!r} in {start}: more than {MOST_ENTRIES} files and folders to look through; "
                    "name the folder of the photographs"
                )
            if entry is None:
                continue
            if rest and entry.is_dir() and not entry.is_symlink():
                waiting.append((entry, rest))
            elif not rest and entry.is_file():
                found[entry] = None
    return list(found)


def _entries(folder: Path, part: str) -> Iterator[Path | None]:
    """The files and folders that a part of a pattern matches; None for each that it does not."""
    if (found := _existing(folder, part)) is not None:
        yield found
        return
    try:
        with os.scandir(folder) as entries:
            for entry in entries:
                yield folder / entry.name if _matches(entry.name, part) else None
    except OSError:
        return  # not a folder, or not readable: nothing in it can be measured


def _existing(folder: Path, part: str) -> Path | None:
    """The file or folder of this name, in one of the Unicode forms of its accented letters."""
    names = dict.fromkeys((part, normalize("NFC", part), normalize("NFD", part)))
    return next((folder / name for name in names if os.path.lexists(folder / name)), None)


def _matches(name: str, part: str) -> bool:
    if name.startswith(".") and not part.startswith("."):
        return False
    return fits(name, part)


def fits(name: str, pattern: str) -> bool:
    """Whether a name of a file or folder is that of a pattern or matches it; suffixes count in any case of letters.

    >>> fits("a1.PNG", "a*.png"), fits("left [1]", "left [1]"), fits("A1.png", "a*.png")
    (True, True, False)
    """
    one, other = _comparable(name), _comparable(pattern)
    return one == other or fnmatchcase(one, other)


def _comparable(name: str) -> str:
    """A name in one Unicode form, with its suffix in lower case."""
    stem, suffix = os.path.splitext(normalize("NFC", name))
    return stem + suffix.lower()


def _is_wild(part: str) -> bool:
    return any(sign in part for sign in "*?[")
