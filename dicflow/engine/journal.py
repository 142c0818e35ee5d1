"""Runs: a journal of events as they happen, and the product of every task."""

from __future__ import annotations

import calendar
import os
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import cached_property
from io import BytesIO
from pathlib import Path
from typing import Any, Literal, get_args

from dicflow.engine.hashing import digest_json, is_digest
from dicflow.engine.layout import RUN_ID
from dicflow.engine.store import Store
from dicflow.engine.stored_json import (
    anything,
    fields,
    is_count,
    is_flag,
    is_number,
    is_text,
    mapping_of,
    one_of,
    read_stored,
    seal,
    stored,
    unseal,
)
from dicflow.engine.whole_file import LARGEST_TEXT, read_file
from dicflow.errors import StoreError

__all__ = [
    "ABOUT",
    "INDEX",
    "RESULT",
    "STATUSES",
    "Entry",
    "Event",
    "Journal",
    "RunInfo",
    "Status",
    "adopt",
    "find_run",
    "is_run_id",
    "latest",
    "runs",
    "whole_lines",
]

_TIME = "%Y%m%d-%H%M%S"
_LATEST_S = 2.5e11
"""A time in the year 9892 [s since 1970]; later ones are damage."""

Entry = dict[str, str]
"""Entry of an index for a task: ``key`` and ``digest``."""


def _is_time(value: Any) -> bool:
    return is_number(value) and 0 <= value <= _LATEST_S


INDEX = mapping_of(fields({"key": is_digest, "digest": is_digest}))
"""Form of ``index.json`` and of the files in ``runs/latest``: an entry for each task."""
ABOUT = fields({"id": is_text, "pipeline": is_text, "started": _is_time, "resolved": anything})
"""Form of ``pipeline.json``."""
RESULT = fields({"counts": mapping_of(is_count), "interrupted": is_flag})
"""Form of ``result.json``."""

Happening = Literal[
    "checking", "planned", "dashboard", "waiting", "compiling", "compiled", "finished", "warning", "ended"
]
"""What an event is."""
Status = Literal["hit", "computed", "failed", "skipped"]
"""What became of a task."""
STATUSES = get_args(Status)
_EVENT = fields({"kind": one_of(*get_args(Happening)), "time": _is_time}, {
    **dict.fromkeys(("task", "stage", "step", "text"), is_text),
    "status": one_of(*STATUSES), "seconds": is_number, "key": is_digest, "digest": is_digest,
    "counts": mapping_of(is_count), "stages": mapping_of(mapping_of(is_count)),
})  # fmt: skip
"""Form of a line of the journal."""


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened in a run.

    status : of a finished task: hit, computed, failed or skipped
    seconds : of a finished task, in its stage; of a stage that is compiled, processor time; of an ended run, altogether
    stage : of a warning: the stage whose products it is of; "" for one of the run; of code that is compiled: the stage
        that needs it
    text : message of an error or warning, the dashboard's link, what is waited for, or being checked: files or tasks
    counts : checking: done and all, of what ``text`` names; planned: hit, run, pending;
        ended: hit, computed, failed, skipped
    stages : planned: the same counts per stage
    """

    kind: Happening
    time: float = field(default_factory=time.time)
    task: str = ""
    stage: str = ""
    step: str | None = None
    status: str = ""
    seconds: float = 0.0
    text: str = ""
    key: str = ""
    digest: str = ""
    counts: Mapping[str, int] = field(default_factory=dict)
    stages: Mapping[str, Mapping[str, int]] = field(default_factory=dict)


@dataclass(frozen=True)
class RunInfo:
    """A run, read from its folder."""

    id: str
    folder: Path

    @cached_property
    def _about(self) -> dict[str, Any]:
        return stored(self.folder / "pipeline.json", ABOUT) or {}

    @property
    def pipeline(self) -> str:
        """Name of the pipeline; empty if it is unknown."""
        return str(self._about.get("pipeline", ""))

    @property
    def resolved(self) -> Any:
        """The pipeline as it was run, as the caller of ``run`` described it; None if it is unknown."""
        return self._about.get("resolved")

    @property
    def started(self) -> float:
        """Start time [s since 1970]."""
        return float(self._about.get("started", self._named_time))

    @property
    def _named_time(self) -> float:
        """The time in the run's id, in whole seconds."""
        with suppress(ValueError):
            return float(calendar.timegm(time.strptime(self.id[:15], _TIME)))
        return 0.0

    @cached_property
    def result(self) -> dict[str, Any] | None:
        """Counts, and whether it was interrupted; None while it runs, or after it was killed."""
        found: dict[str, Any] | None = stored(self.folder / "result.json", RESULT)
        return found

    @cached_property
    def index(self) -> dict[str, Entry]:
        """Task → key and digest, of every task that has a product. Raises StoreError if it is damaged.

        The file holds the hits of the plan, and the journal the tasks that have finished since. When the run ends, it
        is written again with all of them.
        """
        entries = self._indexed()
        for event in self.events():
            if event.kind == "finished" and event.key and event.digest:
                entries[event.task] = {"key": event.key, "digest": event.digest}
        return entries

    @property
    def is_whole(self) -> bool:
        """Whether it is known what the run came to."""
        try:
            self.index  # noqa: B018
        except StoreError:
            return False
        return True

    def _indexed(self) -> dict[str, Entry]:
        path = self.folder / "index.json"
        try:
            found: dict[str, Entry] = read_stored(path, INDEX)
        except FileNotFoundError:
            return {}
        except OSError as error:
            raise StoreError(f"{path}: cannot be read ({error.strerror}); get read access to the store") from error
        except ValueError as error:
            raise StoreError(f"{path}: {error}; 'dicflow verify --repair' sets it aside, or delete the run") from error
        return found

    def events(self) -> Iterator[Event]:
        """The journal, without lines cut short or damaged; empty if it cannot be read."""
        with suppress(OSError):
            yield from (event for _, event in self.lines() if event is not None)

    def lines(self) -> Iterator[tuple[bytes, Event | None]]:
        """Each line of the journal with its event, None for one that is damaged or cut short. Raises OSError."""
        for line in BytesIO(read_file(self.folder / "journal.jsonl", LARGEST_TEXT)):
            if line != b"\n":
                yield line, _event(line.rstrip(b"\n"))


def _event(line: bytes) -> Event | None:
    try:
        return Event(**unseal(line, _EVENT))
    except ValueError:
        return None


class Journal:
    """The folder of a run in progress.

    Raises StoreError if it cannot be made.
    """

    def __init__(self, store: Store, pipeline: str, resolved: Any) -> None:
        now = time.time()
        self.id = f"{time.strftime(_TIME, time.gmtime(now))}-{uuid.uuid4().hex[:6]}"
        self.pipeline = pipeline
        self.folder = store.path / "runs" / self.id
        self._store = store
        self._about = {"id": self.id, "pipeline": pipeline, "started": now}
        self.describe(resolved)
        with store.writing():
            self._file = (self.folder / "journal.jsonl").open("ab", buffering=0)
        self._cut = False
        self._listed = 0

    def describe(self, resolved: Any) -> None:
        """Write what the run is of, as the caller of ``run`` describes it. Raises StoreError."""
        self._store.write_json(self.folder / "pipeline.json", {**self._about, "resolved": resolved})

    def write(self, event: Event) -> None:
        """Append an event. A full disk is ignored here; the tasks report it."""
        line = seal({name: value for name, value in asdict(event).items() if value not in ("", None, {}, 0.0)}) + b"\n"
        whole = b"\n" + line if self._cut else line
        self._cut = True
        with suppress(OSError):
            self._cut = self._file.write(whole) < len(whole)

    def write_index(self, entries: Mapping[str, Entry]) -> None:
        """Write the product of each hit of the plan; the journal adds the others. Raises StoreError."""
        self._store.write_json(self.folder / "index.json", entries)
        self._listed = len(entries)

    def close(self, entries: Mapping[str, Entry], result: Mapping[str, Any]) -> None:
        """Write the counts, and the product of each task, also as the pipeline's latest. Raises StoreError."""
        with suppress(OSError):
            self._file.close()
        if len(entries) > self._listed:
            self.write_index(entries)
        merged = {**latest(self._store, self.pipeline), **entries}
        self._store.write_json(_latest_path(self._store, self.pipeline), merged)
        self._store.write_json(self.folder / "result.json", result)


def is_run_id(text: str) -> bool:
    """Whether a text has the form of a run's id."""
    return RUN_ID.fullmatch(text) is not None


def runs(store: Store) -> list[RunInfo]:
    """All runs in a store, newest first."""
    folder = store.path / "runs"
    with store.reading():
        names = os.listdir(folder) if folder.is_dir() else []
    found = [RunInfo(name, folder / name) for name in names if is_run_id(name)]
    return sorted(found, key=lambda run: (run.started, run.id), reverse=True)


def find_run(store: Store, name: str = "latest", pipeline: str | None = None) -> RunInfo:
    """A run by its id, or the latest one. Raises StoreError if it does not exist."""
    for run in runs(store):
        if name in ("latest", run.id) and pipeline in (None, run.pipeline):
            return run
    raise StoreError(
        f"{store.path}: unknown run '{name}'; it was cleaned up or is elsewhere, 'dicflow pin STORE' lists all runs"
    )


def adopt(store: Store, draft: Path, name: str) -> None:
    """Take in a run whose folder was written elsewhere. A run that is there, and what is the latest, stay.

    draft : in the same file system; name : id of the run
    Raises StoreError.
    """
    run = RunInfo(name, store.path / "runs" / name)
    with store.writing():
        run.folder.parent.mkdir(exist_ok=True)
        if not run.folder.exists():
            os.rename(draft, run.folder)
    store.write_json(_latest_path(store, run.pipeline), {**run.index, **latest(store, run.pipeline)})


def whole_lines(content: bytes) -> bytes:
    """A journal without lines that are damaged or cut short."""
    return b"".join(line + b"\n" for line in content.split(b"\n") if _event(line) is not None)


def latest(store: Store, pipeline: str) -> dict[str, Entry]:
    """Key and digest of each task in the last run of a pipeline."""
    return stored(_latest_path(store, pipeline), INDEX) or {}


def _latest_path(store: Store, pipeline: str) -> Path:
    return store.path / "runs" / "latest" / f"{digest_json(pipeline).partition(':')[2][:16]}.json"
