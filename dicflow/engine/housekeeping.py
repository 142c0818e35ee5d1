"""Upkeep of a store: garbage and pins."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from stat import S_ISDIR

from dicflow.engine.drafts import is_abandoned, tree
from dicflow.engine.hashing import is_digest
from dicflow.engine.journal import RunInfo, find_run, runs
from dicflow.engine.layout import Found, Part, Survey, foreign_in, survey
from dicflow.engine.store import Store
from dicflow.engine.stored_json import is_text, mapping_of, read_stored
from dicflow.errors import StoreError

__all__ = ["GRACE_S", "PINS", "Garbage", "collect", "pin", "pins", "size", "unpin"]

PINS = mapping_of(is_text)
"""Form of ``pins.json``: a note by run or product."""

GRACE_S = 3600.0
"""Younger files may belong to a run in progress in another process."""
_ORDER: tuple[Part, ...] = ("record", "manifest", "group", "run", "code", "draft", "set aside")
"""Order of deletion: if it is killed at any moment, no remaining file names a deleted product."""


@dataclass(frozen=True)
class Garbage:
    """Content of a store that no kept run and no pin needs.

    found : what can be deleted, in the order of deletion
    foreign : what has a place in the store but is not of the store, and is left alone: links, files of other names
    nbytes : size on the disk, without the records' lines in the store's index
    deleted : whether it was deleted, or only listed
    """

    found: list[Found] = field(default_factory=list)
    foreign: list[Path] = field(default_factory=list)
    nbytes: int = 0
    deleted: bool = False

    def names(self, *parts: Part) -> list[str]:
        """Names of all that is one of these parts."""
        return sorted({one.name for one in self.found if one.part in parts})


def collect(store: Store, *, keep_runs: int = 5, delete: bool = False, grace_s: float = GRACE_S) -> Garbage:
    """Find what can be deleted, and delete it if asked to.

    No symbolic link is followed, and only what has a name of the store's own is deleted.

    keep_runs : so many of the newest runs of each pipeline stay, with all their products; and so do pinned runs
    grace_s : younger files stay, and so does a run with a younger journal, with all its products [s]
    Raises StoreError if something cannot be deleted, or if a damaged file leaves unknown what must stay.
    """
    before = time.time() - grace_s
    keys, digests, old = _marked(store, keep_runs, before)
    seen = survey(store.path)
    stays = {"record": keys, "manifest": digests, "group": digests}
    found = [one for one in seen.parts if one.part in stays and one.name not in stays[one.part] and _older(one, before)]
    found += [one for one in seen.named("run") if one.name in old]
    found += [one for one in seen.named("draft") if is_abandoned(one.path, one.name, grace_s)]
    found += seen.named("set aside")
    found += _unnamed_codes(store, seen, {one.name for one in found if one.part == "record"}, before)
    impure = {one.path: path for one in found if (path := foreign_in(one)) is not None}
    found = sorted((one for one in found if one.path not in impure), key=lambda one: _ORDER.index(one.part))
    nbytes = sum(_size(one.path) for one in found)
    if delete:
        _delete(store, found)
    unreadable = [path for path, _ in seen.unreadable]
    foreign = sorted([*seen.links, *seen.disguised, *seen.foreign, *unreadable, *impure.values()])
    return Garbage(found, foreign, nbytes, delete)


def pins(store: Store) -> dict[str, str]:
    """Pinned runs and products, each with its note. Raises StoreError if the file of pins is damaged."""
    path = store.path / "pins.json"
    try:
        found: dict[str, str] = read_stored(path, PINS)
    except FileNotFoundError:
        return {}
    except ValueError as error:
        raise StoreError(
            f"{path}: {error}, so what is pinned is unknown; restore it from a copy, or delete it"
        ) from error
    except OSError as error:
        with store.reading():
            raise error
    return found


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
    store.write_json(store.path / "pins.json", {**pins(store), what: note}, durable=True)


def unpin(store: Store, what: str) -> None:
    """Remove a pin. Raises StoreError if it does not exist."""
    left = pins(store)
    if left.pop(what, None) is None:
        raise StoreError(f"{store.path}: {what} is not pinned; pins: {', '.join(left) or 'none'}")
    store.write_json(store.path / "pins.json", left, durable=True)


def size(store: Store) -> int:
    """Size of the store on the disk [bytes]."""
    return _size(store.path)


def _marked(store: Store, keep_runs: int, before: float) -> tuple[set[str], set[str], set[str]]:
    """Keys and digests that stay, and the runs that do not. before : runs that have written since stay [s]"""
    pinned = pins(store)
    _require_indexes(store, pinned)
    seen: dict[str, int] = {}
    keys, old = set(), set()
    digests = {name for name in pinned if is_digest(name)}
    for run in runs(store):
        seen[run.pipeline] = seen.get(run.pipeline, 0) + 1
        if seen[run.pipeline] > keep_runs and run.id not in pinned and _all_older(run, before):
            old.add(run.id)
            continue
        keys |= {entry["key"] for entry in run.index.values()}
        digests |= {entry["digest"] for entry in run.index.values()}
    return keys, digests, old


def _require_indexes(store: Store, pinned: Iterable[str]) -> None:
    """Refuse where it is unknown what a pinned run needs. Raises StoreError."""
    for name in pinned:
        if not is_digest(name) and not (store.path / "runs" / name / "index.json").is_file():
            raise StoreError(
                f"{store.path}: the pinned run {name} has lost its index, so what it needs is unknown; "
                f"restore runs/{name} from a copy, or 'dicflow pin {store.path} {name} --remove'"
            )


def _unnamed_codes(store: Store, seen: Survey, gone: set[str], before: float) -> list[Found]:
    """Files of code to which no record refers. gone : keys of records that are deleted"""
    codes = [one for one in seen.named("code") if _older(one, before)]
    if not codes:
        return []
    kept = (store.record(one.name) for one in seen.named("record") if one.name not in gone)
    named = {record.code for record in kept if record is not None}
    return [one for one in codes if one.name not in named]


def _delete(store: Store, found: Iterable[Found]) -> None:
    with store.writing():
        for one in found:
            with suppress(FileNotFoundError):  # another process may be doing the same
                shutil.rmtree(one.path) if one.path.is_dir() else one.path.unlink()
        store.index.keep_only({one.name for one in survey(store.path).named("record")})


def _older(found: Found, before: float) -> bool:
    return _changed(found.path) <= before


def _all_older(run: RunInfo, before: float) -> bool:
    """Whether all files of a run are older; the folder's own time changes with added files only."""
    try:
        return all(_changed(path) <= before for path in (run.folder, *run.folder.iterdir()))
    except OSError:
        return False


def _changed(path: Path) -> float:
    """When a file or folder was changed [s since 1970]; never, if it has gone."""
    try:
        return path.lstat().st_mtime
    except OSError:
        return float("inf")


def _size(path: Path) -> int:
    """Size of a file, or of all files below a folder; 0 where it is missing."""
    return sum(map(_file_size, tree(path)))


def _file_size(path: Path) -> int:
    try:
        status = path.lstat()
    except OSError:
        return 0
    return 0 if S_ISDIR(status.st_mode) else status.st_size
