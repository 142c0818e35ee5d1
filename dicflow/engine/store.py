"""The store: products by the digest of their contents, records by the key of the action that made them.

::

    store/  dicflow.json  files.index  actions.index  pins.json
      objects/ab/<digest>/       the arrays of a product as a zarr group; absent if it is made again when it is used
      objects/ab/<digest>.json   its manifest: what it is, and the sizes of the group's files
      actions/ab/<key>.json      a record
      code/<root>.json           the definitions that a fingerprint covers, with their digests
      runs/<id>/                 pipeline, journal and index of a run
      tmp/  quarantine/

No file is changed in place: each is written in ``tmp`` and renamed, first the arrays, then the manifest that names
them, then the record that names the product. So a killed process leaves nothing that could be mistaken for a result,
and writers need no lock. Only ``actions.index`` and the journals of runs are appended to.

Each JSON file has one reader, which knows its form and checks its sum (:mod:`dicflow.engine.stored_json`). A file that
is damaged or cannot be read counts as missing, and what it held is made again. Where that is impossible, for pins and
for what old runs used, whoever needs it raises StoreError.

After a power failure, files written in the last half minute may be empty or missing; such products are made again. Only
pins are on the disk before they count. To wait for the disk at every manifest and record would cost more than the rest
of the engine: 13 ms per small product on a busy virtual disk (ext4), where hashing and storing it take 3 ms, and 36 ms
with the files of its array.
"""

from __future__ import annotations

import dataclasses
import errno
import os
import re
import shutil
import uuid
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal

from dicflow.engine.action_index import ActionIndex
from dicflow.engine.drafts import DRAFT, draft_name
from dicflow.engine.files import FileIndex
from dicflow.engine.hashing import is_digest
from dicflow.engine.layout import is_top_name
from dicflow.engine.objects import Manifest, write_group
from dicflow.engine.product import Product
from dicflow.engine.records import Record
from dicflow.engine.stored_json import is_text, mapping_of, read_stored, seal, stored
from dicflow.engine.whole_file import file_size, write_file
from dicflow.errors import StoreError

__all__ = ["CODE", "FORMAT", "State", "Store"]

FORMAT = 2
"""Version of the layout that this release reads and writes."""

CODE = mapping_of(is_text)
"""Form of a file of definitions: digest of the code of each, by its name."""

State = Literal["complete", "missing", "damaged"]

_FULL = {errno.ENOSPC, errno.EDQUOT}
_DENIED = {errno.EROFS, errno.EACCES, errno.EPERM}


class Store:
    """A store in a folder. Use :meth:`open`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._code_parts: dict[str, dict[str, str]] = {}

    @classmethod
    def open(cls, path: Path | str, create: bool = True, accept_damaged: bool = False) -> Store:
        """The store in a folder.

        create : make it if it does not exist, and its mark again if that is damaged
        accept_damaged : open a store with a damaged mark as it is, to be verified
        Raises StoreError for another format, a folder that holds something else, and one that cannot be read or made.
        """
        store = cls(Path(path).absolute())
        with store.reading():
            foreign = _foreign(store.path)  # before the mark, which another process may be about to write
            state = store.mark_state()
        if state == "missing":
            store._refuse_missing(foreign, create)
        if state == "damaged" and not (create or accept_damaged):
            raise StoreError(f"{store.mark}: is damaged; 'dicflow verify {store.path} --repair' makes it again")
        if state != "complete" and create:
            store.write_mark()
        return store

    @classmethod
    def existing(cls, path: Path | str) -> Store | None:
        """The store in a folder; None where nothing is yet, or no more than the first run has prepared.

        Raises StoreError as :meth:`open` does.
        """
        store = cls(Path(path).absolute())
        with store.reading():
            if not _foreign(store.path) and store.mark_state() == "missing":
                return None
        return cls.open(path, create=False)

    @property
    def mark(self) -> Path:
        """The file that makes a folder a store, and says in which format."""
        return self.path / "dicflow.json"

    def mark_state(self) -> State:
        """The state of the mark. Raises OSError if it cannot be read, StoreError for another format.

        A damaged mark is refused too, unless the folder holds what a store holds and nothing else. Then it can be made
        again: even where another release wrote the store, files of another form count as missing.
        """
        try:
            found = read_stored(self.mark, lambda value: "format" in value)["format"]
        except (FileNotFoundError, NotADirectoryError):
            return "missing"
        except ValueError as error:
            self._refuse_foreign(error)
            return "damaged"
        if found == FORMAT:
            return "complete"
        raise StoreError(
            f"{self.path}: has format {found}, this release reads {FORMAT}; "
            "use the dicflow that wrote it, or name another store"
        )

    @property
    def is_new(self) -> bool:
        """Whether nothing has been done yet."""
        return not (self.path / "actions").exists()

    def write_mark(self) -> None:
        """Write the mark. Raises StoreError."""
        with self.writing():
            (self.path / "tmp").mkdir(parents=True, exist_ok=True)
        self.write_json(self.mark, {"format": FORMAT})

    def _refuse_missing(self, foreign: bool, create: bool) -> None:
        if not create:
            raise StoreError(f"{self.path}: is not a store; run a pipeline first, or name the store's folder")
        if foreign:
            raise StoreError(f"{self.path}: holds other files and is not a store; name an empty or new folder")

    def _refuse_foreign(self, error: ValueError) -> None:
        names = os.listdir(self.path)
        if "tmp" not in names or not all(map(is_top_name, names)):
            raise StoreError(
                f"{self.mark}: {error}, and the rest of the folder is not that of a store either; name another folder, "
                f'or write {{"format": {FORMAT}}} into this file'
            ) from error

    @cached_property
    def files(self) -> FileIndex:
        """Facts about input files and source files."""
        return FileIndex(self.path / "files.index", self.replace)

    @cached_property
    def index(self) -> ActionIndex:
        """The product of every key, in one file."""
        return ActionIndex(self.path / "actions.index", self.replace)

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Turns errors of the file system into StoreErrors with a remedy."""
        try:
            yield
        except OSError as error:
            if error.errno in _FULL:
                message = "the disk is full; free some space ('dicflow gc' shows what can be deleted)"
            elif error.errno in _DENIED:
                message = f"cannot be written ({_reason(error)}); get write access, or name another store"
            else:
                message = f"cannot be written ({_reason(error)}); check the disk, or name another store"
            raise StoreError(f"{self.path}: {message}; nothing that was stored is lost") from error

    @contextmanager
    def reading(self) -> Iterator[None]:
        """The same for reading."""
        try:
            yield
        except OSError as error:
            remedy = "get read access" if error.errno in _DENIED else "check the disk"
            where = error.filename or self.path
            raise StoreError(f"{where}: cannot be read ({_reason(error)}); {remedy}, or name another store") from error

    # records

    def record(self, key: str) -> Record | None:
        """The record of a key; None if it is missing or cannot be read."""
        with suppress(OSError, ValueError):
            record = Record.read(self.record_path(key))
            return record if record.key == key else None
        return None

    def put_record(self, record: Record) -> None:
        """Store a record, in place of an older one. Raises StoreError."""
        self.write_json(self.record_path(record.key), record.to_json())

    def record_path(self, key: str) -> Path:
        """Path of the record of a key."""
        return self.path / "actions" / _hex(key)[:2] / f"{_hex(key)}.json"

    # code

    def code_parts(self, root: str) -> dict[str, str]:
        """Definition → digest of its code, by the root of a fingerprint; empty if it is unknown."""
        if is_digest(root) and root not in self._code_parts:
            found = stored(self.code_path(root), CODE)
            if found:
                self._code_parts[root] = found
        return self._code_parts.get(root, {})

    def put_code(self, root: str, parts: Mapping[str, str]) -> None:
        """Store the definitions of a fingerprint, unless they are stored. Raises StoreError."""
        if stored(self.code_path(root), CODE) is None:
            self.write_json(self.code_path(root), dict(parts))

    def code_path(self, root: str) -> Path:
        """Path of the definitions of a fingerprint."""
        return self.path / "code" / f"{_hex(root)}.json"

    # objects

    def object_path(self, digest: str) -> Path:
        """Path of the group of a product."""
        return self.path / "objects" / _hex(digest)[:2] / _hex(digest)

    def manifest_path(self, digest: str) -> Path:
        """Path of the manifest of a product."""
        return self.object_path(digest).with_suffix(".json")

    def manifest(self, digest: str) -> Manifest | None:
        """The manifest of a product; None if it is missing or cannot be read."""
        with suppress(OSError, ValueError):
            found = Manifest.read(self.manifest_path(digest))
            return found if found.digest == digest else None
        return None

    def inspect(self, digest: str) -> tuple[State, Manifest | None]:
        """Whether all files of a product have their sizes; and its manifest, None if it is missing or damaged."""
        found = self.manifest(digest)
        if found is None:
            return ("damaged" if os.path.lexists(self.manifest_path(digest)) else "missing"), None
        return ("complete", found) if _holds(self.object_path(digest), found.files) else ("damaged", None)

    def put(self, product: Product, manifest: Manifest, keep: bool) -> Manifest:
        """Store a product, or its manifest alone if ``keep`` is false. A stored product is left untouched.

        Raises StoreError; the store is then unchanged.
        """
        return self.put_written(manifest, keep, partial(write_group, product=product))

    def put_written(self, manifest: Manifest, keep: bool, write: Callable[[Path], dict[str, int]]) -> Manifest:
        """The same for a product whose arrays a function writes into a new folder.

        write : returns the size [bytes] of each file by its relative path
        """
        state, present = self.inspect(manifest.digest)
        if state == "damaged":
            self.quarantine(manifest.digest)
        if present is not None and (present.kept or not keep):
            return present
        kept = keep or not manifest.content["variables"]
        files = self._put_group(manifest.digest, write) if kept and manifest.content["variables"] else {}
        whole = dataclasses.replace(manifest, kept=kept, files=files)
        self.write_json(self.manifest_path(manifest.digest), whole.to_json())
        return whole

    def quarantine(self, digest: str) -> None:
        """Move the files of a damaged product into quarantine. Raises StoreError."""
        self.set_aside(self.manifest_path(digest))  # first: without a manifest the arrays stand for nothing
        self.set_aside(self.object_path(digest))

    # files

    def set_aside(self, path: Path) -> None:
        """Move a damaged file or folder into quarantine. Raises StoreError."""
        name = "-".join(path.relative_to(self.path).parts)
        with self.writing(), suppress(FileNotFoundError):  # another process may be doing the same
            (self.path / "quarantine").mkdir(exist_ok=True)
            os.rename(path, self.path / "quarantine" / f"{name}.{uuid.uuid4().hex[:8]}")

    def write_json(self, path: Path, value: Mapping[str, Any], durable: bool = False) -> None:
        """Write one JSON file, whole or not at all; a folder that has its name is set aside. Raises StoreError.

        durable : wait until it is on the disk, for what cannot be made again
        """
        with self.writing():
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.is_dir():
                self.set_aside(path)
            self.replace(path, seal(value), durable)

    def replace(self, path: Path, content: bytes, durable: bool = False) -> None:
        """Write a file, or replace it. Raises OSError."""
        write_file(path, content, self.draft(), durable)

    def _put_group(self, digest: str, write: Callable[[Path], dict[str, int]]) -> dict[str, int]:
        folder = self.object_path(digest)
        with self.writing():
            draft = self.draft()
            try:
                files = write(draft)
                folder.parent.mkdir(parents=True, exist_ok=True)
                if os.path.lexists(folder) and not _holds(folder, files):
                    self.quarantine(digest)
                self._rename_group(draft, folder, files)
            finally:
                shutil.rmtree(draft, ignore_errors=True)
        return files

    @staticmethod
    def _rename_group(draft: Path, folder: Path, files: Mapping[str, int]) -> None:
        """Rename the group, unless an equal one has its name: from another writer, or a killed one."""
        try:
            os.rename(draft, folder)
        except OSError:
            if not _holds(folder, files):
                raise

    def draft(self) -> Path:
        """Unused path in ``tmp``."""
        folder = self.path / "tmp"
        folder.mkdir(exist_ok=True)
        return folder / draft_name()


def _foreign(folder: Path) -> bool:
    """Whether a folder holds other files than a store that is being made, which has drafts of its mark in ``tmp``."""
    if not folder.is_dir():
        return False
    drafts = folder / "tmp"
    names = [path.name for path in drafts.iterdir()] if drafts.is_dir() else []
    return any(path != drafts for path in folder.iterdir()) or not all(re.fullmatch(DRAFT, name) for name in names)


def _holds(folder: Path, files: Mapping[str, int]) -> bool:
    """Whether a folder holds all files, each of its size."""
    try:
        return all(file_size(folder / name) == size for name, size in files.items())
    except OSError:
        return False


def _reason(error: OSError) -> str:
    return (error.strerror or str(error)).lower()


def _hex(digest: str) -> str:
    """The part of a digest that names a file. Raises StoreError for other texts, so that they never become paths."""
    if not is_digest(digest):
        raise StoreError(f"{digest!r} is not a digest; the store's files are damaged, run 'dicflow verify'")
    return digest.partition(":")[2]
