"""Upkeep of a store: garbage, damage and pins."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from dicflow.engine.hashing import digest_json, is_digest
from dicflow.engine.integrity import check_product
from dicflow.engine.journal import find_run, runs
from dicflow.engine.records import Record
from dicflow.engine.store import Store, read_json, read_mapping
from dicflow.errors import StoreError

__all__ = ["Damage", "Garbage", "collect", "pin", "pins", "size", "unpin", "verify"]

_GRACE_S = 3600.0
"""Younger files may belong to a run in progress in another process."""


@dataclass(frozen=True)
class Garbage:
    """Content of a store that no kept run and no pin needs.

    objects, records, runs : digests, keys, ids
    leftovers : files of killed processes, and what is in quarantine
    nbytes : size on the disk, without the records' lines in the store's index
    deleted : whether it was deleted, or only listed
    """

    objects: list[str] = field(default_factory=list)
    records: list[str] = field(default_factory=list)
    runs: list[str] = field(default_factory=list)
    leftovers: list[str] = field(default_factory=list)
    nbytes: int = 0
    deleted: bool = False


@dataclass(frozen=True)
class Damage:
    """A damaged part of a store. what : digest of a product, or key of a record"""

    what: str
    reason: str


def collect(store: Store, *, keep_runs: int = 5, delete: bool = False, grace_s: float = _GRACE_S) -> Garbage:
    """Find what can be deleted, and delete it if asked to.

    keep_runs : so many of the newest runs of each pipeline stay, with all their products; and so do pinned runs
    grace_s : younger files stay, and so does a run with a younger journal, with all its products [s]
    Raises StoreError if something cannot be deleted, or if a damaged file leaves unknown what must stay.
    """
    before = time.time() - grace_s
    keys, digests, old_runs = _marked(store, keep_runs, before)
    objects = [(name, path) for name, path in _named(store, "objects") if name not in digests and _older(path, before)]
    records = [(name, path) for name, path in _named(store, "actions") if name not in keys and _older(path, before)]
    folders = [(name, store.path / "runs" / name) for name in old_runs]
    loose = [path for path in _listed(store.path / "tmp") if _older(path, before)]
    loose += _listed(store.path / "quarantine")
    deleted = {path for _, path in records}
    codes = _unnamed_codes(store, [path for _, path in _named(store, "actions") if path not in deleted], before)
    paths = [path for _, path in (*records, *objects, *folders)] + codes + loose
    nbytes = sum(_size(path) for path in paths)
    if delete:
        with store.writing():
            for path in paths:
                shutil.rmtree(path) if path.is_dir() else path.unlink(missing_ok=True)
            store.index.keep_only({name for name, _ in _named(store, "actions")})
    return Garbage(
        sorted({name for name, _ in objects}),
        [name for name, _ in records],
        [name for name, _ in folders],
        [str(path.relative_to(store.path)) for path in loose],
        nbytes,
        delete,
    )


def verify(store: Store, *, repair: bool = False) -> list[Damage]:
    """Read all products and records and compare them with their digests; arrays without a manifest are ignored.

    repair : move damaged products into quarantine and delete damaged records, so that they are made again
    Raises StoreError if that fails.
    """
    found = []
    for name, path in _named(store, "objects"):
        if path.suffix != ".json" and name:
            continue
        reason = check_product(store, name) if name else f"{path}: is not part of a store"
        if reason:
            found.append(Damage(name, reason))
            if repair and name:
                store.quarantine(name)
    for name, path in _named(store, "actions"):
        record = Record.from_json(read_json(path))
        if record is None or record.key != name or digest_json(record.parts) != name:
            found.append(Damage(name, f"{path}: the record does not fit its key"))
            if repair:
                with store.writing():
                    path.unlink(missing_ok=True)
    return found


def pins(store: Store) -> dict[str, str]:
    """Pinned runs and products, each with its note. Raises StoreError if the file of pins is damaged."""
    return {name: str(note) for name, note in read_mapping(store.path / "pins.json").items()}


def pin(store: Store, what: str, note: str = "") -> None:
    """Keep a run with all its products, or one product, until it is unpinned.

    what : id of a run or "latest", or digest of a product
    Raises StoreError if it does not exist, and for a product that is made again from others when it is used.
    """
    if is_digest(what):
        found = store.manifest(what)
        if found is None:
            raise StoreError(f"{store.path}: product {what} is missing, so it cannot be pinned")
        if not found.kept:
            raise StoreError(f"{store.path}: the arrays of {what} are not stored but remade when used; pin its run")
    else:
        what = find_run(store, what).id
    store.write_json(store.path / "pins.json", {**pins(store), what: note})


def unpin(store: Store, what: str) -> None:
    """Remove a pin. Raises StoreError if it does not exist."""
    left = pins(store)
    if left.pop(what, None) is None:
        raise StoreError(f"{store.path}: {what} is not pinned; pins: {', '.join(left) or 'none'}")
    store.write_json(store.path / "pins.json", left)


def size(store: Store) -> int:
    """Size of the store on the disk [bytes]."""
    return _size(store.path)


def _marked(store: Store, keep_runs: int, before: float) -> tuple[set[str], set[str], list[str]]:
    """Keys and digests that stay, and the runs that do not. before : runs that have written since stay [s]"""
    pinned = pins(store)
    seen: dict[str, int] = {}
    keys, old = set(), []
    digests = {name for name in pinned if is_digest(name)}
    for run in runs(store):
        seen[run.pipeline] = seen.get(run.pipeline, 0) + 1
        if seen[run.pipeline] > keep_runs and run.id not in pinned and _all_older(run.folder, before):
            old.append(run.id)
            continue
        keys |= {entry["key"] for entry in run.index.values()}
        digests |= {entry["digest"] for entry in run.index.values()}
    return keys, digests, old


def _named(store: Store, part: str) -> Iterator[tuple[str, Path]]:
    """Name and path of everything in ``objects`` or ``actions``; the name of a foreign file is ""."""
    for folder in _listed(store.path / part):
        for path in _listed(folder):
            name = f"sha256:{path.name.partition('.')[0]}"
            yield (name if is_digest(name) else ""), path


def _unnamed_codes(store: Store, records: Iterable[Path], before: float) -> list[Path]:
    """Files of code to which these records do not refer."""
    found = [path for path in _listed(store.path / "code") if _older(path, before)]
    if found:
        loaded = [Record.from_json(read_json(path)) for path in records]
        named = {store.code_path(record.code) for record in loaded if record is not None and record.code}
        found = [path for path in found if path not in named]
    return found


def _listed(folder: Path) -> list[Path]:
    return sorted(folder.iterdir()) if folder.is_dir() else []


def _older(path: Path, before: float) -> bool:
    try:
        return path.stat().st_mtime <= before
    except OSError:
        return False


def _all_older(folder: Path, before: float) -> bool:
    """Whether all files of a folder are older; the folder's own time changes with added files only."""
    return all(_older(path, before) for path in (folder, *folder.iterdir()))


def _size(path: Path) -> int:
    """Size of a file, or of all files below a folder; 0 where it is missing."""
    if path.is_dir():
        return sum(_size(Path(folder) / name) for folder, _, names in os.walk(path) for name in names)
    try:
        return path.lstat().st_size
    except OSError:
        return 0
