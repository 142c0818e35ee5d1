"""Files that dicflow writes into a folder for people, with a list of what each was made of."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from dicflow.engine.stored_json import fields, is_text, list_of, mapping_of, seal, stored
from dicflow.engine.whole_file import read_file
from dicflow.io.files import write_whole

__all__ = ["Job", "Published", "source_of"]

_LIST = ".published.json"


class Job(NamedTuple):
    """Files that are made together.

    sources : name of each file below the folder → digest of what it is made of
    make : makes the contents of those of them that are asked for
    """

    sources: Mapping[str, str]
    make: Callable[[Collection[str]], Mapping[str, bytes]]


class _Made(NamedTuple):
    """Digests of what a file was made of, and of what was written."""

    source: str
    content: str


class Published:
    """The files in a folder that dicflow wrote. Threads may share it.

    A file counts only while it is as it was written: one that is damaged, that somebody changed, or that a killed
    process replaced before it could save the list, is unknown.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        found = stored(folder / _LIST, _FORM) or {"made": {}, "result": "", "files": []}
        self._made = {file: _Made(*made) for file, made in found["made"].items()}
        self._result, self._files = found["result"], found["files"]

    @property
    def listed(self) -> list[str]:
        """Names below the folder, of all that is on the list, also of files of other results."""
        return list(self._made)

    def files_of(self, result: str) -> list[str] | None:
        """Names of the files of a result if it was published last and they are all there; None otherwise.

        result : digest of all that the files are made of
        """
        there = result == self._result and all(self.content(file) is not None for file in self._files)
        return list(self._files) if there else None

    def is_current(self, file: str, source: str) -> bool:
        """Whether a file is as it was written, and was made of the same."""
        return file in self._made and self._made[file].source == source and self.content(file) is not None

    def content(self, file: str) -> bytes | None:
        """What a file holds; None if it is not as it was written."""
        with suppress(OSError):
            content = read_file(self._folder / file)
            return content if file in self._made and _digest(content) == self._made[file].content else None
        return None

    def write(self, file: str, source: str, content: bytes) -> None:
        """Write a file. Raises InputError where that fails."""
        write_whole(self._folder / file, content)
        self._made[file] = _Made(source, _digest(content))

    def delete(self, file: str) -> None:
        """Delete a file that is still as it was written, and its folder if that is empty then."""
        path = self._folder / file
        with suppress(OSError):
            if path.resolve().is_relative_to(self._folder.resolve()) and self.content(file) is not None:
                path.unlink()
                path.parent.rmdir()
        self._made.pop(file, None)

    def save(self, result: str, files: Sequence[str]) -> None:
        """Write the list, after all files of a result. Raises InputError where that fails."""
        made = {file: list(one) for file, one in sorted(self._made.items())}
        write_whole(self._folder / _LIST, seal({"made": made, "result": result, "files": list(files)}))


def source_of(*parts: Any) -> str:
    """The digest of what a file is made of, given as JSON."""
    return _digest(json.dumps(parts).encode())


def _digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def _is_made(value: Any) -> bool:
    return isinstance(value, list) and len(value) == 2 and list_of(is_text)(value)


_FORM = fields({"made": mapping_of(_is_made), "result": is_text, "files": list_of(is_text)})
