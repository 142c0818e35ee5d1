"""A run whose graph grows: plan, worker processes and journal are kept from one addition to the next.

Growing does not plan again. A task whose inputs, files and producers are what they were keeps its entry, and so its
outcome; any other one is pending, and the worker that does it finds its key and looks into the store. So steps may be
added at the end or in between, and files may be replaced.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import suppress
from dataclasses import replace
from typing import Any, TypeVar

from dicflow.engine.compilation import Uncompiled
from dicflow.engine.execute import MOST_REPAIRS, backend_options, jobs_of, keep_code
from dicflow.engine.file_stamps import FileStamp, FileStamps
from dicflow.engine.graph import Graph, Task
from dicflow.engine.journal import STATUSES, Event, Journal
from dicflow.engine.kernel_cache import keep_kernels
from dicflow.engine.node import Node
from dicflow.engine.plan import Plan, PlanEntry, make_plan
from dicflow.engine.processes import WorkerProcesses, survive
from dicflow.engine.references import Ref
from dicflow.engine.running import Options, Running
from dicflow.engine.schedulers import open_backend
from dicflow.engine.store import Store
from dicflow.engine.work import Outcome
from dicflow.engine.workers import keep_memory
from dicflow.errors import StoreError, WorkerError

__all__ = ["GrowingRun", "grown_plan"]

_SIGN_OF_LIFE_S = 120.0
"""How often the journal of a run that has nothing to do gets a line."""

T = TypeVar("T")


def grown_plan(plan: Plan, graph: Graph, store: Store) -> Plan:
    """The plan of a graph that has grown out of that of a plan: entries of what is as it was are the same objects.

    Raises InputError for a file that cannot be read.
    """
    stamps, entries, files = FileStamps(store), dict[str, PlanEntry](), {}
    for name, task in graph.tasks.items():
        known, before = plan.entries.get(name), plan.files.get(name, {})
        files[name] = stamps.of(task, before)
        producers = task.producers()
        is_kept = (
            known is not None
            and _is_joined_alike(known.task, task)
            and _digests(files[name]) == _digests(before)
            and all(entries[producer] is plan.entries.get(producer) for producer in producers)
        )
        entries[name] = (
            known if known is not None and is_kept else PlanEntry(task, "pending", waits_for=tuple(producers))
        )
    return replace(plan, graph=graph, entries=entries, files=files)


def _is_joined_alike(one: Task, other: Task) -> bool:
    return one.inputs == other.inputs and one.files == other.files


def _digests(files: Mapping[str, FileStamp]) -> dict[str, str]:
    return {name: file.digest for name, file in files.items()}


class GrowingRun:
    """A run under way in worker processes of its own, for a graph that grows. Use it as a context.

    pipeline : its name, under which the run is kept
    nodes : its stages by name, whose code is compiled and loaded before there is work
    options : as for :func:`dicflow.engine.execute.run`; the scheduler is "processes", and failures do not stop it
    """

    def __init__(self, store: Store, pipeline: str, nodes: Mapping[str, Node], options: Options) -> None:
        self.store = store
        self._pipeline = pipeline
        self._options = replace(options, scheduler="processes", keep_going=True)
        self._state: Running | None = None
        self._journal: Journal | None = None
        self._nodes = nodes
        ahead = options.ahead(nodes) if options.ahead is not None else ()
        self._processes = WorkerProcesses(options.workers, options.worker_setup, ahead)
        self._written = time.monotonic()

    def __enter__(self) -> GrowingRun:
        keep_kernels()
        keep_memory()
        self._processes.__enter__()
        self._processes.start()
        return self

    def __exit__(self, *error: object) -> None:
        self._processes.__exit__(*error)
        if self._state is not None and self._journal is not None:
            counts = Counter[str](outcome.status for outcome in self.outcomes.values())
            interrupted = len(self.outcomes) < len(self.tasks)
            result = {"counts": {status: counts[status] for status in STATUSES}, "interrupted": interrupted}
            with suppress(StoreError):
                self._journal.close(self._state.index(), result)

    @property
    def outcomes(self) -> Mapping[str, Outcome]:
        """What has become of tasks so far, by name."""
        return self._state.outcomes if self._state is not None else {}

    @property
    def tasks(self) -> Mapping[str, Task]:
        """The tasks of the graph by name, in the order of a plan."""
        return self._state.plan.graph.tasks if self._state is not None else {}

    @property
    def starts(self) -> Mapping[str, str]:
        """Stage that repeats over steps → the one that starts its series."""
        return self._state.plan.graph.starts if self._state is not None else {}

    def compile_ahead(self, is_wanted: Callable[[], bool]) -> None:
        """Compile what the stages need, in turn: one process of numba's compiles at once.

        is_wanted : whether to go on with the next piece
        """
        options = self._options
        left = Uncompiled(options.uncompiled(self._nodes) if options.uncompiled is not None else {})
        while is_wanted() and (piece := left.take()) is not None:
            if options.on_event is not None:
                options.on_event(Event("compiling", stage=piece[1]))
            with suppress(Exception):  # what goes wrong shows again in a task, which has a place for errors
                self.call(piece[2])

    def grow(self, graph: Graph, resolved: Any) -> None:
        """Go on with another graph. resolved : the pipeline as JSON, kept with the run

        Raises InputError and StoreError as :func:`~dicflow.engine.plan.make_plan` does, at the first call; later ones
        do not check files, so that the caller does.
        """
        if self._state is None or self._journal is None:
            plan = make_plan(graph, self.store, pipeline=self._pipeline, code_policy=self._options.code_policy)
            self._journal = Journal(self.store, self._pipeline, resolved)
            self._state = Running(plan, self.store, self._journal, self._options)
            self._journal.write_index(self._state.index())
        else:
            self._state.take(grown_plan(self._state.plan, graph, self.store))
            self._journal.describe(resolved)
        keep_code(self._state.plan, self.store)
        self._report_plan(self._state)

    def compute(self, names: Iterable[str]) -> None:
        """Do some tasks and what they need, so far as it has no outcome yet; what turns out damaged is made again.

        Raises WorkerError where no worker is left.
        """
        asked = tuple(names)
        for _ in range(MOST_REPAIRS):
            self._compute(asked)
            if not self._forget_damaged():
                return

    def _compute(self, names: Iterable[str]) -> None:
        state, journal = self._state, self._journal
        assert state is not None, "a graph comes first"
        assert journal is not None
        needed = self._needed(names)
        with open_backend(backend_options(state, journal.id, self._processes)) as backend:
            state.compute(backend, jobs_of(state.plan, self.store, journal.id, self._options.code_policy, needed))
        self._written = time.monotonic()
        if state.stopped:
            raise WorkerError(next(one.error for one in reversed(state.outcomes.values()) if one.status == "failed"))

    def ref(self, name: str) -> Ref | None:
        """The product of a task; None where it has none."""
        outcome = self.outcomes.get(name)
        return outcome.ref if outcome is not None else None

    def call(self, function: Callable[..., T], *arguments: Any) -> T:
        """The value of a function of a module, computed in a worker, and in another one where that dies.

        Raises what it raises, and WorkerLost.
        """
        found: T = survive(1, self._processes.call, function, *arguments)
        return found

    def show_life(self) -> None:
        """Write a line now and then while nothing happens: a silent run would count as killed."""
        if self._journal is not None and time.monotonic() - self._written > _SIGN_OF_LIFE_S:
            self._journal.write(Event("checking", text="files"))
            self._written = time.monotonic()

    def _forget_damaged(self) -> bool:
        """Let tasks be done again that met a damaged product, what waits for them, and the makers of such products.

        Returns whether there are any.
        """
        state = self._state
        assert state is not None
        met = [name for name, one in self.outcomes.items() if one.damaged]
        if not met:
            return False
        skipped = (name for name, one in self.outcomes.items() if one.status == "skipped")
        again = {*met, *skipped, *filter(self._is_lost, self._behind(met))}
        entries = {
            name: PlanEntry(entry.task, "pending", waits_for=tuple(entry.task.producers())) if name in again else entry
            for name, entry in state.plan.entries.items()
        }
        state.take(replace(state.plan, entries=entries))
        return True

    def _is_lost(self, name: str) -> bool:
        """Whether the product of a task is no longer whole in the store."""
        ref = self.ref(name)
        return ref is not None and self.store.inspect(ref.digest)[0] != "complete"

    def _behind(self, names: Iterable[str]) -> frozenset[str]:
        """All that some tasks need, however far back."""
        found: set[str] = set()
        waiting = list(names)
        while waiting:
            further = self.tasks[waiting.pop()].producers()
            waiting += (name for name in further if name not in found)
            found.update(further)
        return frozenset(found)

    def _needed(self, names: Iterable[str]) -> frozenset[str]:
        needed: set[str] = set()
        waiting = list(names)
        while waiting:
            name = waiting.pop()
            if name not in needed and name not in self.outcomes:
                needed.add(name)
                waiting += self.tasks[name].producers()
        return frozenset(needed)

    def _report_plan(self, state: Running) -> None:
        """Say how many tasks each stage has; those that have a product count as hits."""
        stages = {stage: dict.fromkeys(("hit", "pending"), 0) for stage in state.plan.graph.stages}
        for name, task in self.tasks.items():
            stages[task.stage]["hit" if name in state.outcomes else "pending"] += 1
        counts = {way: sum(row[way] for row in stages.values()) for way in ("hit", "pending")}
        state.report(Event("planned", counts=counts, stages=stages))
