"""What a run did, read from its journal and the records of its products."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

from dicflow.engine.journal import STATUSES, Event, RunInfo
from dicflow.engine.store import Store

__all__ = ["RunFacts", "RunWarning", "TaskFacts", "run_facts"]


class TaskFacts(NamedTuple):
    """Outcome of one task.

    stage : its name in the graph, ``surface`` or in a sweep also ``surface@2``
    step : None for a stage that runs once
    status : hit, computed, failed or skipped
    seconds : in its stage; of a hit, in the run that computed it
    key, digest : of its record and its product; empty if missing
    error : why it failed or was skipped; may name files of the machine
    """

    task: str
    stage: str
    step: str | None
    status: str
    seconds: float
    key: str
    digest: str
    error: str


class RunWarning(NamedTuple):
    """A warning of a run. stage : name in the graph of the stage whose products it is of; "" for one of the run"""

    stage: str
    text: str


class RunFacts(NamedTuple):
    """What one run did.

    started : s since 1970
    planned : number of its tasks; ``tasks`` of a killed run has fewer
    interrupted : by Ctrl-C
    ended : false while it runs, and for a killed run
    versions : package → every version that has made a product of this run
    """

    id: str
    started: float
    planned: int
    interrupted: bool
    ended: bool
    tasks: tuple[TaskFacts, ...]
    warnings: tuple[RunWarning, ...]
    versions: Mapping[str, tuple[str, ...]]

    @property
    def counts(self) -> dict[str, int]:
        """How many tasks were hit, computed, failed and skipped."""
        found = Counter(task.status for task in self.tasks)
        return {status: found[status] for status in STATUSES}

    @property
    def saved_s(self) -> float:
        """Time in stages that hits once took, and that this run saved [s]."""
        return sum(task.seconds for task in self.tasks if task.status == "hit")


def run_facts(store: Store, run: RunInfo) -> RunFacts:
    """The facts of a run, also of one that failed, was interrupted or killed. No array is read."""
    events, index = list(run.events()), run.index
    finished = {event.task: event for event in events if event.kind == "finished"}
    made = {task: _made(store, entry["key"]) for task, entry in index.items()}
    plans: list[Mapping[str, int]] = [event.counts for event in events if event.kind == "planned"]
    tasks = [_hit(task, index[task], made[task]) for task in index if task not in finished]
    tasks += [_finished(event, made.get(task, {})) for task, event in finished.items()]
    return RunFacts(
        run.id,
        run.started,
        sum(plans[-1].values()) if plans else 0,
        bool((run.result or {}).get("interrupted")),
        run.result is not None,
        tuple(tasks),
        tuple(RunWarning(event.stage, event.text) for event in events if event.kind == "warning"),
        _versions(made.values()),
    )


def _made(store: Store, key: str) -> Mapping[str, Any]:
    """How a product was made, by its record; empty if the record has been freed."""
    record = store.record(key)
    return record.made if record is not None else {}


def _hit(task: str, entry: Mapping[str, str], made: Mapping[str, Any]) -> TaskFacts:
    """A task whose product the plan found in the store; the journal has no event of it."""
    stage, _sign, step = task.partition("/")
    return TaskFacts(task, stage, step or None, "hit", made.get("stage_s", 0.0), entry["key"], entry["digest"], "")


def _finished(event: Event, made: Mapping[str, Any]) -> TaskFacts:
    seconds = made.get("stage_s", 0.0) if event.status == "hit" else event.seconds
    texts = (event.key, event.digest, event.text)
    return TaskFacts(event.task, event.stage, event.step, event.status, seconds, *texts)


def _versions(made: Iterable[Mapping[str, Any]]) -> dict[str, tuple[str, ...]]:
    found: defaultdict[str, set[str]] = defaultdict(set)
    for one in made:
        for package, version in one.get("versions", {}).items():
            found[package].add(version)
    return {package: tuple(sorted(versions)) for package, versions in sorted(found.items())}
