"""Keeping a store in order: what may be deleted, what is damaged, what must stay."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

from dicflow.engine.faults import fault
from dicflow.engine.hashing import digest_json, is_digest
from dicflow.engine.journal import find_run, runs
from dicflow.engine.records import Record
from dicflow.engine.store import Store, read_json, read_mapping
from dicflow.errors import StoreError

__all__ = ["Damage", "Garbage", "collect", "pin", "pins", "size", "unpin", "verify"]

_GRACE_S = 3600.0
"""What is younger may belong to a run that is under way elsewhere."""


@dataclass(frozen=True)
class Garbage:
    """What no run that is kept and no pin needs.

    objects, records, runs : digests, keys, ids
    leftovers : files of killed processes, and what is in quarantine
    nbytes : what it takes on the disk, without the records' lines in the store's index
    deleted : whether it is gone, or was only looked for
    """

    objects: list[str] = field(default_factory=list)
    records: list[str] = field(default_factory=list)
    runs: list[str] = field(default_factory=list)
    leftovers: list[str] = field(default_factory=list)
    nbytes: int = 0
    deleted: bool = False


@dataclass(frozen=True)
class Damage:
    """Something in the store that is not what it should be. what : digest of a product, or key of a record"""

    what: str
    reason: str


def collect(store: Store, *, keep_runs: int = 5, delete: bool = False, grace_s: float = _GRACE_S) -> Garbage:
    """Find what can be deleted, and delete it if asked to.

    keep_runs : so many of the newest runs of each pipeline stay, with all their products; pinned ones do besides
    grace_s : what is younger stays, and a run that has written its journal since, with all its products [s]
    Raises StoreError where something cannot be deleted, or where what must stay is unknown because a file is damaged.
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
    """Read all products and records and compare them with their digests; arrays without a manifest do no harm.

    repair : move damaged products into quarantine and delete damaged records, so that they are made again
    Raises StoreError where that cannot be done.
    """
    found = []
    for name, path in _named(store, "objects"):
        if path.suffix != ".json" and name:
            continue
        reason = fault(store, name) if name else f"{path}: is not part of a store"
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
    """What is pinned, runs and products, with the note given. Raises StoreError where that is damaged."""
    return {name: str(note) for name, note in read_mapping(store.path / "pins.json").items()}


def pin(store: Store, what: str, note: str = "") -> None:
    """Keep a run with all its products, or one product, until it is unpinned.

    what : id of a run or "latest", or digest of a product
    Raises StoreError where it does not exist, or for a product that is made again from others when it is used.
    """
    if is_digest(what):
        found = store.manifest(what)
        if found is None:
            raise StoreError(f"{store.path}: product {what} is missing; nothing to pin")
        if not found.kept:
            raise StoreError(f"{store.path}: the arrays of {what} are not stored but made again; pin its run")
    else:
        what = find_run(store, what).id
    store.write_json(store.path / "pins.json", {**pins(store), what: note})


def unpin(store: Store, what: str) -> None:
    """Take a pin away. Raises StoreError where it is not pinned."""
    left = pins(store)
    if left.pop(what, None) is None:
        raise StoreError(f"{store.path}: {what} is not pinned; pins: {', '.join(left) or 'none'}")
    store.write_json(store.path / "pins.json", left)


def size(store: Store) -> int:
    """What the store takes on the disk [bytes]."""
    return _size(store.path)


def _marked(store: Store, keep_runs: int, before: float) -> tuple[set[str], set[str], list[str]]:
    """Keys and digests that stay, and the runs that do not. before : runs that have written since stay [s]"""
    pinned = pins(store)
    seen: dict[str, int] = {}
    keys, old = set(), []
    digests = {name for name in pinned if is_digest(name)}
    for run in runs(store):
        seen[run.pipeline] = seen.get(run.pipeline, 0) + 1
        if seen[run.pipeline] > keep_runs and run.id not in pinned and _at_rest(run.folder, before):
            old.append(run.id)
            continue
        keys |= {entry["key"] for entry in run.index.values()}
        digests |= {entry["digest"] for entry in run.index.values()}
    return keys, digests, old


def _named(store: Store, part: str) -> Iterator[tuple[str, Path]]:
    """Name and path of everything in ``objects`` or ``actions``; the name is "" for what has none."""
    for folder in _listed(store.path / part):
        for path in _listed(folder):
            name = f"sha256:{path.name.partition('.')[0]}"
            yield (name if is_digest(name) else ""), path


def _unnamed_codes(store: Store, records: Iterable[Path], before: float) -> list[Path]:
    """Files of code that none of these records names."""
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


def _at_rest(folder: Path, before: float) -> bool:
    """Whether no file of a folder has changed since; the folder's own time tells of new files only."""
    return all(_older(path, before) for path in (folder, *folder.iterdir()))


def _size(path: Path) -> int:
    """Size of a file, or of all files below a folder; 0 where it is missing."""
    if path.is_dir():
        return sum(_size(Path(folder) / name) for folder, _, names in os.walk(path) for name in names)
    try:
        return path.lstat().st_size
    except OSError:
        return 0
