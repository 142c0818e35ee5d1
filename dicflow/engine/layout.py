"""The names in a store: what each stands for, and what else is there.

Whoever lists a store does so by :func:`survey`. It follows no symbolic link, and takes for a part of the store only
what has a name that the store gives. All else is foreign: it is named, and left alone.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal, NamedTuple

from dicflow.engine.drafts import DRAFT

__all__ = ["RUN_ID", "Found", "Part", "Survey", "foreign_in", "is_top_name", "survey"]

Part = Literal[
    "mark", "files", "actions", "pins", "manifest", "group", "record", "code", "run", "latest", "draft", "set aside"
]
Sort = Literal["file", "folder", "link", "other"]

RUN_ID = re.compile("[0-9]{8}-[0-9]{6}-[0-9a-f]{6}")
"""Name of a run: date, time of day, random digits."""

_HEX = "[0-9a-f]{64}"
_FOLDERS = re.compile(r"(objects|actions)(/[0-9a-f]{2})?|code|runs(/latest)?|tmp|quarantine")
_PARTS: tuple[tuple[Part, tuple[Sort, ...], re.Pattern[str]], ...] = (
    ("manifest", ("file",), re.compile(rf"objects/([0-9a-f]{{2}})/(?=\1){_HEX}\.json")),
    ("group", ("folder",), re.compile(rf"objects/([0-9a-f]{{2}})/(?=\1){_HEX}")),
    ("record", ("file",), re.compile(rf"actions/([0-9a-f]{{2}})/(?=\1){_HEX}\.json")),
    ("code", ("file",), re.compile(rf"code/{_HEX}\.json")),
    ("run", ("folder",), re.compile(f"runs/{RUN_ID.pattern}")),
    ("latest", ("file",), re.compile(r"runs/latest/[0-9a-f]{16}\.json")),
    ("draft", ("file", "folder"), re.compile(f"tmp/{DRAFT}")),
    ("draft", ("file",), re.compile(rf"(files|actions)\.index\.{DRAFT}\.part")),
    ("set aside", ("file", "folder", "other"), re.compile(r"quarantine/[^/]+\.[0-9a-f]{8}")),
    ("mark", ("file",), re.compile(r"dicflow\.json")),
    ("files", ("file",), re.compile(r"files\.index")),
    ("actions", ("file",), re.compile(r"actions\.index")),
    ("pins", ("file",), re.compile(r"pins\.json")),
)
"""Each part of a store: what it is, and its path below the store's folder."""

_IN_GROUP = re.compile(r"([^/]+/)?zarr\.json|[^/]+/c(\.\d+)*"), re.compile("[^/]+")
_IN_RUN = (
    re.compile(r"(pipeline|index|result)\.json|journal\.jsonl|stop|errors/[^/]+\.txt|jobs/[^/]+"),
    re.compile("errors|jobs"),
)
"""Files and folders inside."""


class Found(NamedTuple):
    """A part of a store. name : its digest; of a run its id, of a draft its own name, else the last one of the path"""

    part: Part
    name: str
    path: Path


@dataclass(frozen=True)
class Survey:
    """What is in the folder of a store.

    parts : in the order of their paths
    links : symbolic links with names of the store; neither they nor what they lead to is a part of it
    disguised : with a name of the store, but a pipe, a folder or the like where a file belongs, or the other way round
    foreign : with any other name
    unreadable : folders that could not be listed, each with its error
    """

    parts: list[Found] = field(default_factory=list)
    links: list[Path] = field(default_factory=list)
    disguised: list[Path] = field(default_factory=list)
    foreign: list[Path] = field(default_factory=list)
    unreadable: list[tuple[Path, OSError]] = field(default_factory=list)

    def named(self, part: Part) -> list[Found]:
        """All that are the same part."""
        return [found for found in self.parts if found.part == part]


def is_top_name(name: str) -> bool:
    """Whether a file or folder at the top of a store may have this name.

    >>> is_top_name("objects"), is_top_name("dicflow.json"), is_top_name("thesis.tex")
    (True, True, False)
    """
    return any(pattern.fullmatch(name) for pattern in (_FOLDERS, *(pattern for _, _, pattern in _PARTS)))


def survey(root: Path) -> Survey:
    """Look at all names in the folder of a store."""
    found, waiting = Survey(), [""]
    while waiting:
        folder = waiting.pop()
        try:
            for entry in _entries(root / folder):
                path = f"{folder}/{entry.name}" if folder else entry.name
                if _sort(entry) == "folder" and _FOLDERS.fullmatch(path):
                    waiting.append(path)
                else:
                    _sort_in(found, entry, path)
        except FileNotFoundError:
            continue
        except OSError as error:
            found.unreadable.append((root / folder, error))
    return found


def foreign_in(found: Found) -> Path | None:
    """Something in a folder of the store that the store did not put there: a link, or a file of another name."""
    files, folders = _IN_RUN if found.part == "run" else _IN_GROUP
    try:
        for path, sort in _inside(found.path):
            pattern = {"file": files, "folder": folders}.get(sort)
            if pattern is None or not pattern.fullmatch(path.relative_to(found.path).as_posix()):
                return path
    except OSError as error:
        return Path(error.filename or found.path)
    return None


def _sort_in(survey: Survey, entry: os.DirEntry[str], path: str) -> None:
    place, sort = Path(entry.path), _sort(entry)
    for part, sorts, pattern in _PARTS:
        if pattern.fullmatch(path):
            if sort in sorts:
                survey.parts.append(Found(part, _name(part, entry.name), place))
            else:
                (survey.links if sort == "link" else survey.disguised).append(place)
            return
    strange = survey.links if sort == "link" else survey.disguised
    (strange if _FOLDERS.fullmatch(path) else survey.foreign).append(place)


def _name(part: Part, name: str) -> str:
    if part in ("manifest", "group", "record", "code"):
        return f"sha256:{name[:64]}"
    return name.removesuffix(".part").rpartition(".")[2] if part == "draft" else name


def _inside(folder: Path) -> Iterator[tuple[Path, Sort]]:
    """Everything below a folder, with what it is; nothing below a file. Raises OSError."""
    if not folder.is_dir():
        return
    for entry in _entries(folder):
        yield Path(entry.path), _sort(entry)
        if _sort(entry) == "folder":
            yield from _inside(Path(entry.path))


def _entries(folder: Path) -> list[os.DirEntry[str]]:
    with os.scandir(folder) as entries:
        return sorted(entries, key=lambda entry: entry.name)


def _sort(entry: os.DirEntry[str]) -> Sort:
    if entry.is_symlink():
        return "link"
    if entry.is_dir(follow_symlinks=False):
        return "folder"
    return "file" if entry.is_file(follow_symlinks=False) else "other"
