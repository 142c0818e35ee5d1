"""Runs: started as processes of their own, watched by the journals of the store, whoever started them."""

from __future__ import annotations

import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import Any

from dicflow.app.project import Project
from dicflow.engine import housekeeping
from dicflow.engine.journal import STATUSES, Event, RunInfo, find_run, runs
from dicflow.engine.store import Store
from dicflow.engine.work import stop_path
from dicflow.errors import ConfigurationError

__all__ = ["Runs"]

_LISTED = 50
_QUIET_S = 600.0
"""A run without a result whose journal is older counts as killed."""
_SHOWN = 20
"""Failures and warnings that are shown."""


class Runs:
    """The runs of a project. One object serves all pages; it knows which processes are its own."""

    def __init__(self, project: Project) -> None:
        self.project = project
        self._own: dict[str, tuple[subprocess.Popen[bytes], Path]] = {}
        self._read: dict[str, tuple[int, dict[str, Any]]] = {}

    def start(self, name: str) -> None:
        """Start ``dicflow run`` for a pipeline file, in a session of its own, so that it outlives the app.

        Raises ConfigurationError if the file is not valid, or if a run that the app started is under way.
        """
        pipeline = self.project.pipeline(name)
        if self._is_alive(name):
            raise ConfigurationError(f"a run of {name} is under way; stop it first, or wait for its end")
        log = self.project.own_folder / "logs" / f"{pipeline.name}.log"
        log.parent.mkdir(exist_ok=True)
        command = [sys.executable, "-m", "dicflow", "run", str(pipeline.path), "--json"]
        command += ["--data", str(pipeline.folder), "--store", str(pipeline.store_folder)]
        with log.open("wb") as output:
            process = subprocess.Popen(
                command, stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True,
                cwd=pipeline.path.parent,
            )  # fmt: skip
        self._own[name] = process, log

    def stop(self, name: str) -> None:
        """Let the run of a pipeline file finish the tasks it is at, and start no other."""
        process, _ = self._own.get(name, (None, None))
        if process is not None and process.poll() is None:
            process.send_signal(signal.SIGINT)
            return
        pipeline = self.project.pipeline(name)
        for run in runs(pipeline.store):
            if run.pipeline == pipeline.name and run.result is None:
                with suppress(OSError):
                    stop_path(pipeline.store.path, run.id).touch()
                return
        raise ConfigurationError(f"no run of {name} is under way")

    def watch(self, name: str) -> dict[str, Any]:
        """The newest run of a pipeline file.

        ``state``: none, starting, running, done, failed, stopped or killed; ``run``: its id; ``stages``: name → counts
        by status, all and seconds; ``failures``: task and message; ``warnings``; ``left_s``: time left at the pace so
        far; ``message``: what the command said if it ended before it made a run.
        """
        pipeline = self.project.pipeline(name)
        process, log = self._own.get(name, (None, None))
        alive = process is not None and process.poll() is None
        store = Store.existing(pipeline.store_folder)
        newest = next((run for run in runs(store) if run.pipeline == pipeline.name), None) if store else None
        started = log.stat().st_mtime if log is not None and alive else 0.0
        if newest is None or (alive and newest.result is not None):
            return {"state": "starting" if alive else "none", "message": _said(process, log), "started": started}
        found = self._summary(newest)
        state = _state(newest, alive, found["last"])
        ended_otherwise = process is not None and not alive and process.returncode not in (0, 1, 130)
        return {**found, "run": newest.id, "state": state, "message": _said(process, log) if ended_otherwise else ""}

    def size(self, name: str) -> int:
        """Disk that the store of a pipeline file uses [bytes]; of a large store that takes seconds."""
        store = Store.existing(self.project.pipeline(name).store_folder)
        return 0 if store is None else housekeeping.size(store)

    def listed(self, name: str) -> list[dict[str, Any]]:
        """The runs in the store of a pipeline file, of all its pipelines, newest first."""
        store = Store.existing(self.project.pipeline(name).store_folder)
        if store is None:
            return []
        pins = housekeeping.pins(store)
        return [
            {
                "id": run.id,
                "pipeline": run.pipeline,
                "started": run.started,
                "counts": (run.result or {}).get("counts", {}),
                "interrupted": (run.result or {}).get("interrupted"),
                "pin": pins.get(run.id),
            }
            for run in runs(store)[:_LISTED]
        ]

    def pin(self, name: str, run_id: str, note: str | None) -> None:
        """Pin a run with a note, or take its pin away. note : None takes it away"""
        store = self._store(name)
        if note is None:
            housekeeping.unpin(store, run_id)
        else:
            housekeeping.pin(store, find_run(store, run_id).id, note)

    def clean(self, name: str, keep_runs: int, delete: bool) -> dict[str, Any]:
        """What ``dicflow gc`` would free, or frees."""
        garbage = housekeeping.collect(self._store(name), keep_runs=keep_runs, delete=delete)
        products = len(garbage.names("manifest", "group"))
        return {"bytes": garbage.nbytes, "products": products, "runs": len(garbage.names("run"))}

    def _summary(self, run: RunInfo) -> dict[str, Any]:
        """What the journal of a run says; it is read again once it has grown."""
        with suppress(OSError):
            size = (run.folder / "journal.jsonl").stat().st_size
            if self._read.get(run.id, (-1,))[0] != size:
                self._read = {run.id: (size, _summary(run))}
            return self._read[run.id][1]
        return _summary(run)

    def _store(self, name: str) -> Store:
        return Store.open(self.project.pipeline(name).store_folder, create=False)

    def _is_alive(self, name: str) -> bool:
        process, _ = self._own.get(name, (None, None))
        return process is not None and process.poll() is None


def _summary(run: RunInfo) -> dict[str, Any]:
    """What the journal of a run says."""
    stages: dict[str, dict[str, Any]] = {}
    failures: list[dict[str, str]] = []
    warnings: list[str] = []
    planned = last = run.started
    for event in run.events():
        last = event.time
        if event.kind == "planned":
            planned = event.time
            stages = {name: _row(counts) for name, counts in event.stages.items()}
        elif event.kind == "finished" and event.stage in stages:
            stages[event.stage][event.status] += 1
            stages[event.stage]["seconds"] += event.seconds
            if event.status == "failed":
                failures.append({"task": event.task, "text": event.text})
        elif event.kind == "warning":
            warnings.append(_warning(event))
    return {
        "stages": stages,
        "failures": failures[:_SHOWN],
        "failed": len(failures),
        "warnings": list(dict.fromkeys(warnings))[:_SHOWN],
        "started": run.started,
        "last": last,
        "left_s": _left(stages.values(), planned),
    }


def _row(counts: Any) -> dict[str, Any]:
    return {**dict.fromkeys(STATUSES, 0), "hit": counts.get("hit", 0), "all": sum(counts.values()), "seconds": 0.0}


def _warning(event: Event) -> str:
    return f"{event.stage}: {event.text}" if event.stage and not event.text.startswith(event.stage) else event.text


def _left(stages: Iterable[dict[str, Any]], planned: float) -> float | None:
    """Time left at the pace so far [s]; None before the first task has ended."""
    totals: Counter[str] = Counter()
    for row in stages:
        totals.update({name: row[name] for name in (*STATUSES, "all")})
    done = totals["computed"] + totals["failed"]
    to_do = totals["all"] - totals["hit"]
    return (time.time() - planned) * (to_do - done) / done if done else None


def _state(run: RunInfo, alive: bool, last: float) -> str:
    """In one word what a run is doing, or how it ended."""
    if run.result is None:
        return "running" if alive or time.time() - last < _QUIET_S else "killed"
    counts = run.result["counts"]
    if run.result["interrupted"] or (counts.get("skipped") and not counts.get("failed")):
        return "stopped"
    return "failed" if counts.get("failed") else "done"


def _said(process: subprocess.Popen[bytes] | None, log: Path | None) -> str:
    """The last lines of a command that has ended without success."""
    if process is None or log is None or process.poll() in (None, 0):
        return ""
    with suppress(OSError):
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines()
        return "\n".join(lines[-_SHOWN:])
    return ""
