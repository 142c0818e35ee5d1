"""What the files of tasks hold, by digest, and what stages find in them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dicflow.engine.files import FilePart, Stamp, part_digest, stamp
from dicflow.engine.graph import Task
from dicflow.engine.hashing import plain
from dicflow.engine.node import Node
from dicflow.engine.store import Store

__all__ = ["FileStamp", "FileStamps", "file_facts"]


@dataclass(frozen=True, slots=True)
class FileStamp:
    """The contents of a file, and how to see that it is still the same."""

    digest: str
    stamp: Stamp


_NO_FILES: Mapping[str, FileStamp] = {}
"""The files of a task without any, shared by all of them."""


class FileStamps:
    """The files of tasks, each read once while it is unchanged."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._wholes: dict[tuple[Path, Stamp], str] = {}

    def of(self, task: Task, known: Mapping[str, FileStamp] = _NO_FILES) -> Mapping[str, FileStamp]:
        """Argument of ``run`` → contents.

        known : what the same files held before
        Raises InputError for a file that cannot be read.
        """
        if not task.files:
            return _NO_FILES
        return {name: self._found(task.node, file, known.get(name)) for name, file in task.files.items()}

    def _found(self, node: Node, file: Path | FilePart, known: FileStamp | None) -> FileStamp:
        before = stamp(file)  # first: of a file that changes meanwhile the stamp then no longer fits
        if known is not None and known.stamp == before:
            return known
        if not isinstance(file, FilePart):
            return FileStamp(self._store.files.digest(file), before)
        digest = file_facts(self._store, node, file).get("digest")
        return FileStamp(digest or part_digest(self._whole(file.path, before), file.number), before)

    def _whole(self, path: Path, unchanged: Stamp) -> str:
        """Digest of a file of many parts, found once for all of them."""
        if (path, unchanged) not in self._wholes:
            self._wholes[path, unchanged] = self._store.files.digest(path)
        return self._wholes[path, unchanged]


def file_facts(store: Store, node: Node, file: Path | FilePart) -> Any:
    """What a stage finds in a file, as JSON, from the store if it was found before. Raises InputError as it does."""
    purpose = f"check:{node.stage}:{node.impl_version}"
    if isinstance(file, FilePart):
        purpose += f"#{file.number}"
    return store.files.fact(file, purpose, lambda file: plain(node.check(file)))
