"""Runs: a journal of events as they happen, and the product of every task."""

from __future__ import annotations

import json
import re
import time
import uuid
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Literal

from dicflow.engine.hashing import digest_json
from dicflow.engine.store import Store, read_json, read_mapping
from dicflow.errors import StoreError

__all__ = ["Entry", "Event", "Journal", "RunInfo", "find_run", "is_run_id", "latest", "runs"]

_RUN = re.compile(r"\d{8}-\d{6}-[0-9a-f]{6}")

Entry = dict[str, str]
"""Entry of an index for a task: ``key`` and ``digest``."""


@dataclass(frozen=True, slots=True)
class Event:
    """One thing that happened in a run.

    status : of a finished task: hit, computed, failed or skipped
    seconds : of a finished task, in its stage; of an ended run, altogether
    text : message of an error or warning, the dashboard's link, or what is being checked: files or tasks
    counts : checking: done and all, of what ``text`` names; planned: hit, run, pending;
        ended: hit, computed, failed, skipped
    stages : planned: the same counts per stage
    """

    kind: Literal["checking", "planned", "dashboard", "finished", "warning", "ended"]
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
        found = read_json(self.folder / "pipeline.json")
        return found if isinstance(found, dict) else {}

    @property
    def pipeline(self) -> str:
        """Name of the pipeline."""
        return str(self._about.get("pipeline", ""))

    @property
    def resolved(self) -> Any:
        """The pipeline as it was run, as the caller of ``run`` described it."""
        return self._about.get("resolved")

    @property
    def started(self) -> float:
        """Start time [s since 1970]."""
        return float(self._about.get("started", 0.0))

    @cached_property
    def result(self) -> dict[str, Any] | None:
        """Counts, and whether it was interrupted; None while it runs, or after it was killed."""
        found = read_json(self.folder / "result.json")
        return found if isinstance(found, dict) else None

    @cached_property
    def index(self) -> dict[str, Entry]:
        """Task → key and digest, of every task that has a product. Raises StoreError if it is damaged.

        The file holds the hits of the plan, and the journal the tasks that have finished since.
        """
        entries = read_mapping(self.folder / "index.json")
        for event in self.events():
            if event.get("kind") == "finished" and event.get("digest"):
                entries[event["task"]] = {"key": event["key"], "digest": event["digest"]}
        return entries

    def events(self) -> Iterator[dict[str, Any]]:
        """The journal, without lines cut short."""
        try:
            content = (self.folder / "journal.jsonl").read_bytes()
        except OSError:
            return
        for line in content.split(b"\n"):
            with suppress(ValueError):
                yield json.loads(line)


class Journal:
    """The folder of a run in progress.

    Raises StoreError if it cannot be made.
    """

    def __init__(self, store: Store, pipeline: str, resolved: Any) -> None:
        now = time.time()
        self.id = f"{time.strftime('%Y%m%d-%H%M%S', time.gmtime(now))}-{uuid.uuid4().hex[:6]}"
        self.pipeline = pipeline
        self.folder = store.path / "runs" / self.id
        self._store = store
        about = {"id": self.id, "pipeline": pipeline, "started": now, "resolved": resolved}
        store.write_json(self.folder / "pipeline.json", about)
        with store.writing():
            self._file = (self.folder / "journal.jsonl").open("ab", buffering=0)
        self._cut = False

    def write(self, event: Event) -> None:
        """Append an event. A full disk is ignored here; the tasks report it."""
        given = {name: value for name, value in asdict(event).items() if value not in ("", None, {}, 0.0)}
        # a file name in a message may not be valid Unicode: its bytes are written as escapes
        line = json.dumps(given, ensure_ascii=False).encode("utf-8", "backslashreplace") + b"\n"
        whole = b"\n" + line if self._cut else line
        self._cut = True
        with suppress(OSError):
            self._cut = self._file.write(whole) < len(whole)

    def write_index(self, entries: Mapping[str, Entry]) -> None:
        """Write the product of each hit of the plan, once; the journal adds the others. Raises StoreError."""
        self._store.write_json(self.folder / "index.json", entries)

    def close(self, entries: Mapping[str, Entry], result: Mapping[str, Any]) -> None:
        """Write the counts, and the product of each task as the pipeline's latest. Raises StoreError."""
        with suppress(OSError):
            self._file.close()
        merged = {**latest(self._store, self.pipeline), **entries}
        self._store.write_json(_latest_path(self._store, self.pipeline), merged)
        self._store.write_json(self.folder / "result.json", result)


def is_run_id(text: str) -> bool:
    """Whether a text has the form of a run's id."""
    return _RUN.fullmatch(text) is not None


def runs(store: Store) -> list[RunInfo]:
    """All runs in a store, newest first."""
    folder = store.path / "runs"
    names = [path.name for path in folder.iterdir()] if folder.is_dir() else []
    found = [RunInfo(name, folder / name) for name in names if is_run_id(name)]
    return sorted(found, key=lambda run: (run.started, run.id), reverse=True)


def find_run(store: Store, name: str = "latest", pipeline: str | None = None) -> RunInfo:
    """A run by its id, or the latest one. Raises StoreError if it does not exist."""
    for run in runs(store):
        if name in ("latest", run.id) and pipeline in (None, run.pipeline):
            return run
    raise StoreError(f"{store.path}: unknown run '{name}'; 'dicflow pin STORE' lists all runs")


def latest(store: Store, pipeline: str) -> dict[str, Entry]:
    """Key and digest of each task in the last run of a pipeline."""
    found = read_json(_latest_path(store, pipeline))
    return found if isinstance(found, dict) else {}


def _latest_path(store: Store, pipeline: str) -> Path:
    return store.path / "runs" / "latest" / f"{digest_json(pipeline).partition(':')[2][:16]}.json"
