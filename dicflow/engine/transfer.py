"""Copies of a run from one store to another: a folder, or a bucket with the files of a store under the same names.

Nothing of the other store is believed. Paths are made of digests and of names that the store gives; what is read is
limited in size, has its form, and fits its digest; what is damaged ends the copy with one sentence, and what was copied
until then is whole. As in every store, a manifest is written after its arrays and a record after its product. Only that
the product of a record came from its inputs, nobody can check without measuring again.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import NamedTuple, Protocol, TypeVar

from dicflow.engine.hashing import digest_json
from dicflow.engine.integrity import GONE, check_group, check_product
from dicflow.engine.journal import ABOUT, INDEX, RESULT, Entry, RunInfo, adopt, find_run, is_run_id, whole_lines
from dicflow.engine.objects import Manifest
from dicflow.engine.records import Record
from dicflow.engine.store import CODE, FORMAT, Store
from dicflow.engine.stored_json import is_count, seal, unseal
from dicflow.engine.whole_file import LARGEST, LARGEST_TEXT, read_file
from dicflow.errors import StoreError

__all__ = ["Folder", "Moved", "Source", "Target", "pull", "push"]

_ARRAY, _IN_GROUP = re.compile(r"\w+"), re.compile(r"(\w+/)?zarr\.json|\w+/c(\.\d+)*")
_about = partial(unseal, form=ABOUT)
_RUN_FILES = {"pipeline.json": _about, "index.json": partial(unseal, form=INDEX)}
_SECOND = len("20260131-101500")
"""Length of the second in the id of a run; several may have begun in it."""
T = TypeVar("T")
_AGAIN = "copy it again from where it is whole"

Progress = Callable[[int, int, str], None]
"""Receives how many products are done, of how many, and the task of this one."""


class Source(Protocol):
    """Where another store lies. Paths are relative, with slashes. ``name`` is for messages."""

    name: str

    def get(self, path: str, most: int) -> bytes:
        """Contents of a file. Raises FileNotFoundError, StoreError if it cannot be read or has more than most bytes."""

    def sizes(self, folder: str) -> Mapping[str, int]:
        """Size [bytes] of every file below a folder, by path; empty if it is missing. Raises StoreError."""


class Target(Source, Protocol):
    """The same, where one may write."""

    def put(self, path: str, content: bytes) -> None:
        """Write a file as a whole, or replace it. Raises StoreError."""


class Folder:
    """A store in a folder of the file system, read without following links out of it."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.name = str(path)

    def get(self, path: str, most: int) -> bytes:
        file = self._path / path
        if not file.resolve().is_relative_to(self._path.resolve()):
            raise StoreError(str(file), "is a link out of the folder", _AGAIN)
        try:
            return read_file(file, most)
        except GONE as error:
            raise FileNotFoundError(path) from error
        except OSError as error:
            raise StoreError(str(file), f"cannot be read ({error.strerror})", "get read access") from error

    def sizes(self, folder: str) -> Mapping[str, int]:
        try:
            files = (file for file in (self._path / folder).rglob("*") if file.is_file())
            return {file.relative_to(self._path).as_posix(): file.stat().st_size for file in files}
        except OSError as error:
            raise StoreError(str(error.filename), f"cannot be read ({error.strerror})", "get read access") from error


class Moved(NamedTuple):
    """What was copied. products : of the run; new : those that were not there; nbytes : size of what was written"""

    run: str
    products: int
    new: int
    nbytes: int


def pull(store: Store, source: Source, run: str = "latest", on_product: Progress = lambda *_: None) -> Moved:
    """Copy a run with its products and records into a store; what is there already stays.

    Raises StoreError where something is missing or damaged; whole products copied before stay.
    """
    _check_mark(source)
    name, draft = _chosen(source, run), store.draft()
    try:
        _take_run(store, source, name, draft)
        sizes = _each(RunInfo(name, draft).index, on_product, partial(_take, store, source))
        adopt(store, draft, name)
    finally:
        shutil.rmtree(draft, ignore_errors=True)
    return Moved(name, len(sizes), sum(map(bool, sizes)), sum(sizes))


def push(store: Store, target: Target, run: str = "latest", on_product: Progress = lambda *_: None) -> Moved:
    """Copy a run with its products and records out of a store; files that are there with their size stay.

    Raises StoreError where something is missing or damaged here, or the target cannot be written.
    """
    found = find_run(store, run)
    there = dict(item for folder in ("objects", "actions", "code") for item in target.sizes(folder).items())
    target.put("dicflow.json", seal({"format": FORMAT}))
    sizes = _each(found.index, on_product, partial(_send, store, target, there))
    for path, content in _files_of_run(found):
        target.put(path, content)
    return Moved(found.id, len(sizes), sum(map(bool, sizes)), sum(sizes))


def _each(index: Mapping[str, Entry], on_product: Progress, copy: Callable[[Entry], int]) -> list[int]:
    """Copy what each entry of an index names; bytes written for each."""
    sizes = []
    for number, (task, entry) in enumerate(index.items(), start=1):
        sizes.append(copy(entry))
        on_product(number, len(index), task)
    return sizes


# what comes in


def _check_mark(source: Source) -> None:
    """Raise StoreError unless there is a store of this format."""
    try:
        found = unseal(source.get("dicflow.json", LARGEST_TEXT), lambda value: is_count(value.get("format")))["format"]
    except (FileNotFoundError, ValueError) as error:
        raise StoreError(source.name, "is not a store", "name a folder or bucket that a run was pushed to") from error
    if found != FORMAT:
        raise StoreError(
            source.name, f"has format {found}, this release reads {FORMAT}", "use the dicflow that wrote it"
        )


def _chosen(source: Source, run: str) -> str:
    """The id of a run that the source has, ``latest`` for the newest."""
    names = {path.split("/")[1] for path in source.sizes("runs") if path.endswith("/index.json")}
    known = sorted(filter(is_run_id, names))
    if run == "latest" and known:
        newest = [name for name in known if name[:_SECOND] == known[-1][:_SECOND]]
        return max(newest, key=lambda name: _parsed(source, f"runs/{name}/pipeline.json", _about)["started"])
    if run not in known:
        raise StoreError(source.name, f"has no run '{run}'", f"its runs: {', '.join(known) or 'none'}")
    return run


def _take_run(store: Store, source: Source, name: str, draft: Path) -> None:
    """Write what the source has of a run into a folder."""
    below = f"runs/{name}"
    files = {file: seal(_parsed(source, f"{below}/{file}", form)) for file, form in _RUN_FILES.items()}
    files["journal.jsonl"] = whole_lines(_content(source, f"{below}/journal.jsonl", LARGEST_TEXT))
    with suppress(FileNotFoundError):  # of a run that was killed
        source.get(f"{below}/result.json", LARGEST_TEXT)
        files["result.json"] = seal(_parsed(source, f"{below}/result.json", partial(unseal, form=RESULT)))
    with store.writing():
        draft.mkdir()
        for file, content in files.items():
            (draft / file).write_bytes(content)


def _take(store: Store, source: Source, entry: Entry) -> int:
    """Copy a product and its record, unless they are there; bytes written."""
    taken = _take_product(store, source, entry["digest"])
    present = store.record(entry["key"])
    if present is None or store.inspect(present.digest)[0] != "complete":
        _take_record(store, source, entry)
    return taken


def _take_product(store: Store, source: Source, digest: str) -> int:
    state, present = store.inspect(digest)
    if state == "complete" and present is not None and present.kept:
        return 0
    path = _relative(store, store.manifest_path(digest))
    manifest = _parsed(source, path, Manifest.parse)
    if manifest.digest != digest or not manifest.is_sound or not _has_own_names(manifest):
        raise _damaged(source, path)
    if present is not None and not manifest.kept:
        return 0
    store.put_written(manifest, manifest.kept, partial(_write_group, store, source, manifest))
    return len(seal(manifest.to_json())) + sum(manifest.files.values())


def _write_group(store: Store, source: Source, manifest: Manifest, folder: Path) -> dict[str, int]:
    """Write the arrays of a product into a new folder, and check all of them."""
    below = _relative(store, store.object_path(manifest.digest))
    for name in ("", *manifest.content["variables"]):
        (folder / name).mkdir()
    for name, size in manifest.files.items():
        (folder / name).write_bytes(_content(source, f"{below}/{name}", min(size, LARGEST)))
    if damage := check_group(folder, manifest):
        raise _damaged(source, below, damage.removeprefix(f"{folder}/").partition(": ")[2])
    return dict(manifest.files)


def _take_record(store: Store, source: Source, entry: Entry) -> None:
    path = _relative(store, store.record_path(entry["key"]))
    record = _parsed(source, path, Record.parse)
    if (record.key, record.digest) != (entry["key"], entry["digest"]) or digest_json(record.parts) != record.key:
        raise _damaged(source, path)
    if record.code and not store.code_parts(record.code):
        with suppress(FileNotFoundError, ValueError):  # it only says which definitions have changed
            content = source.get(_relative(store, store.code_path(record.code)), LARGEST_TEXT)
            store.put_code(record.code, unseal(content, CODE))
    store.put_record(record)


def _has_own_names(manifest: Manifest) -> bool:
    """Whether the files of a product are those that its arrays have."""
    arrays = manifest.content["variables"]
    fit = all(map(_ARRAY.fullmatch, arrays)) and all(map(_IN_GROUP.fullmatch, manifest.files))
    return fit and all(name.split("/")[0] in arrays for name in manifest.files if "/" in name)


def _parsed(source: Source, path: str, parse: Callable[[bytes], T]) -> T:
    try:
        return parse(_content(source, path, LARGEST_TEXT))
    except ValueError as error:
        raise _damaged(source, path, str(error)) from error


def _content(source: Source, path: str, most: int) -> bytes:
    try:
        return source.get(path, most)
    except FileNotFoundError as error:
        raise _damaged(source, path, "missing, or larger than it should be") from error


def _damaged(source: Source, path: str, reason: str = "does not fit its digest") -> StoreError:
    return StoreError(f"{source.name}/{path}", f"is damaged ({reason}), and nothing of it was taken", _AGAIN)


# what goes out


def _send(store: Store, target: Target, there: dict[str, int], entry: Entry) -> int:
    """Copy a product and its record, without the files that are there; bytes written. there : takes what was copied"""
    sent = 0
    for path, size, content in _files_of(store, entry):
        if there.get(path) != size:
            target.put(path, content())
            there[path] = size
            sent += size
    return sent


def _files_of(store: Store, entry: Entry) -> Iterator[tuple[str, int, Callable[[], bytes]]]:
    """Path, size and contents of each file of a product and its record, in the order in which they are written."""
    digest = entry["digest"]
    if damage := check_product(store, digest):
        raise StoreError(f"{damage}; run the pipeline again to make it, then push")
    manifest, record = store.manifest(digest), store.record(entry["key"])
    if manifest is None or record is None:
        raise StoreError(f"{store.path}: the record {entry['key'][:19]}… is missing; run the pipeline again, then push")
    group = store.object_path(digest)
    paths = [*(group / name for name in manifest.files), store.manifest_path(digest)]
    if store.code_parts(record.code):
        paths.append(store.code_path(record.code))
    for path in (*paths, store.record_path(record.key)):
        yield _relative(store, path), path.stat().st_size, partial(read_file, path)


def _files_of_run(run: RunInfo) -> Iterator[tuple[str, bytes]]:
    """Path and contents of the files of a run, the index, which makes it known, last."""
    for name in ("pipeline.json", "journal.jsonl", "result.json"):
        if (run.folder / name).is_file():
            yield f"runs/{run.id}/{name}", read_file(run.folder / name)
    yield f"runs/{run.id}/index.json", seal(run.index)


def _relative(store: Store, path: Path) -> str:
    return path.relative_to(store.path).as_posix()
