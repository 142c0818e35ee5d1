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
and writers need no lock. Only ``actions.index`` is appended to; it repeats the records.
"""

from __future__ import annotations

import errno
import json
import os
import re
import shutil
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from dicflow.engine.action_index import ActionIndex
from dicflow.engine.files import FileIndex
from dicflow.engine.hashing import is_digest
from dicflow.engine.objects import Manifest, write_group
from dicflow.engine.product import Product
from dicflow.engine.records import Record
from dicflow.engine.whole_file import write_file
from dicflow.errors import StoreError

__all__ = ["FORMAT", "State", "Store", "read_json", "read_mapping"]

FORMAT = 2
"""Version of the layout that this release reads and writes."""

State = Literal["complete", "missing", "damaged"]

_DRAFT = re.compile(r"\d+-[0-9a-f]{32}")
_FULL = {errno.ENOSPC, errno.EDQUOT}
_DENIED = {errno.EROFS, errno.EACCES, errno.EPERM}


class Store:
    """A store in a folder. Use :meth:`open`."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._code_parts: dict[str, dict[str, str]] = {}

    @classmethod
    def open(cls, path: Path | str, create: bool = True) -> Store:
        """The store in a folder, which is made if it does not exist.

        Raises StoreError for another format, a folder that holds something else, or one that cannot be made.
        """
        store = cls(Path(path).absolute())
        foreign = _foreign(store.path)  # before the search for the mark, which another process may be about to write
        mark = store.path / "dicflow.json"
        if mark.is_file():
            store._check_format(mark)
            return store
        if not create:
            raise StoreError(f"{store.path}: is not a store; run a pipeline first, or name the store's folder")
        if foreign:
            raise StoreError(f"{store.path}: holds other files and is not a store; name an empty or new folder")
        with store.writing():
            (store.path / "tmp").mkdir(parents=True, exist_ok=True)
        store.write_json(mark, {"format": FORMAT})
        return store

    @cached_property
    def files(self) -> FileIndex:
        """Facts about input files and source files."""
        return FileIndex(self.path / "files.index")

    @cached_property
    def index(self) -> ActionIndex:
        """The product of every key, in one file."""
        return ActionIndex(self.path / "actions.index")

    @contextmanager
    def writing(self) -> Iterator[None]:
        """Turns errors of the file system into StoreErrors with a remedy."""
        try:
            yield
        except OSError as error:
            reason = error.strerror or str(error)
            if error.errno in _FULL:
                message = "the disk is full; free some space ('dicflow gc' shows what can be deleted)"
            elif error.errno in _DENIED:
                message = f"cannot be written ({reason.lower()}); get write access, or name another store"
            else:
                message = f"cannot be written ({reason.lower()}); check the disk, or name another store"
            raise StoreError(f"{self.path}: {message}; nothing that was stored is lost") from error

    # records

    def record(self, key: str) -> Record | None:
        """The record of a key; None if it is missing or cannot be read."""
        record = Record.from_json(read_json(self.record_path(key)))
        return record if record is not None and record.key == key else None

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
            found = read_json(self.code_path(root))
            if isinstance(found, dict) and found:
                self._code_parts[root] = {name: str(digest) for name, digest in found.items()}
        return self._code_parts.get(root, {})

    def put_code(self, root: str, parts: Mapping[str, str]) -> None:
        """Store the definitions of a fingerprint, unless they are stored. Raises StoreError."""
        if read_json(self.code_path(root)) is None:
            self.write_json(self.code_path(root), dict(parts))

    def code_path(self, root: str) -> Path:
        """Path of the definitions of a fingerprint."""
        return self.path / "code" / f"{_hex(root)}.json"

    # objects

    def object_path(self, digest: str) -> Path:
        """Path of the group of a product; its manifest has the suffix ``.json``."""
        return self.path / "objects" / _hex(digest)[:2] / _hex(digest)

    def manifest(self, digest: str) -> Manifest | None:
        """The manifest of a product; None if it is missing or cannot be read."""
        found = Manifest.from_json(read_json(self.object_path(digest).with_suffix(".json")))
        return found if found is not None and found.digest == digest else None

    def inspect(self, digest: str) -> tuple[State, Manifest | None]:
        """Whether all files of a product have their sizes; and its manifest, None if it is missing or damaged."""
        found = self.manifest(digest)
        if found is None:
            return ("damaged" if self.object_path(digest).with_suffix(".json").exists() else "missing"), None
        return ("complete", found) if _holds(self.object_path(digest), found.files) else ("damaged", None)

    def put(self, product: Product, manifest: Manifest, keep: bool) -> Manifest:
        """Store a product, or its manifest alone if ``keep`` is false. A stored product is left untouched.

        Raises StoreError; the store is then unchanged.
        """
        state, present = self.inspect(manifest.digest)
        if state == "damaged":
            self.quarantine(manifest.digest)
        if present is not None and (present.kept or not keep):
            return present
        kept = keep or not manifest.content["variables"]
        files = self._put_group(product, manifest.digest) if kept and manifest.content["variables"] else {}
        whole = replace(manifest, kept=kept, files=files)
        self.write_json(self.object_path(manifest.digest).with_suffix(".json"), whole.to_json())
        return whole

    def quarantine(self, digest: str) -> None:
        """Move the files of a damaged product into quarantine. Raises StoreError."""
        folder = self.object_path(digest)
        with self.writing():
            (self.path / "quarantine").mkdir(exist_ok=True)
            for path in (folder, folder.with_suffix(".json")):
                with suppress(FileNotFoundError):  # another process may be doing the same
                    os.rename(path, self.path / "quarantine" / f"{path.name}.{uuid.uuid4().hex[:8]}")

    # files

    def write_json(self, path: Path, value: Any) -> None:
        """Write one JSON file, whole or not at all. Raises StoreError."""
        content = json.dumps(value, ensure_ascii=False, separators=(",", ":")).encode("utf-8")
        with self.writing():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_file(path, content, self._draft())

    def _put_group(self, product: Product, digest: str) -> dict[str, int]:
        folder = self.object_path(digest)
        with self.writing():
            draft = self._draft()
            try:
                files = write_group(draft, product)
                folder.parent.mkdir(parents=True, exist_ok=True)
                if folder.exists() and not _holds(folder, files):
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

    def _draft(self) -> Path:
        """Unused path in ``tmp``."""
        folder = self.path / "tmp"
        folder.mkdir(exist_ok=True)
        return folder / f"{os.getpid()}-{uuid.uuid4().hex}"

    def _check_format(self, mark: Path) -> None:
        content = read_json(mark)
        found = content.get("format") if isinstance(content, dict) else None
        if not isinstance(found, int):
            raise StoreError(f"{mark}: has no format number: not a dicflow store, or a damaged one")
        if found != FORMAT:
            raise StoreError(
                f"{self.path}: has format {found}, this release reads {FORMAT}; "
                "use the dicflow that wrote it, or name another store"
            )


def read_json(path: Path) -> Any:
    """The value in a JSON file; None if it cannot be read."""
    try:
        return json.loads(path.read_bytes())
    except (OSError, ValueError):
        return None


def read_mapping(path: Path) -> dict[str, Any]:
    """The mapping in a JSON file; empty if the file is missing.

    Raises StoreError if the file does not hold a mapping, since its contents are then unknown.
    """
    found = read_json(path)
    if isinstance(found, dict):
        return found
    if not path.exists():
        return {}
    raise StoreError(f"{path}: is not a mapping in JSON; restore it from a copy, or delete it")


def _foreign(folder: Path) -> bool:
    """Whether a folder holds other files than a store that is being made, which has drafts of its mark in ``tmp``."""
    if not folder.is_dir():
        return False
    drafts = folder / "tmp"
    names = [path.name for path in drafts.iterdir()] if drafts.is_dir() else []
    return any(path != drafts for path in folder.iterdir()) or not all(map(_DRAFT.fullmatch, names))


def _holds(folder: Path, files: Mapping[str, int]) -> bool:
    """Whether a folder holds all files, each of its size."""
    try:
        return all(os.stat(folder / name).st_size == size for name, size in files.items())
    except OSError:
        return False


def _hex(digest: str) -> str:
    """The part of a digest that names a file. Raises StoreError for other texts, so that they never become paths."""
    if not is_digest(digest):
        raise StoreError(f"{digest!r} is not a digest; the store's files are damaged, run 'dicflow verify'")
    return digest.partition(":")[2]
