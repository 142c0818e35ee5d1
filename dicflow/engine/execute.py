"""Running a graph: plan, hand what is missing to a scheduler, keep the journal, and report how it went."""

from __future__ import annotations

import signal
import threading
import time
from collections import Counter
from collections.abc import Callable, Container, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from dicflow.engine.fingerprint import Fingerprint
from dicflow.engine.graph import Graph
from dicflow.engine.journal import STATUSES, Event, Journal
from dicflow.engine.kernel_cache import keep_kernels
from dicflow.engine.plan import CodePolicy, Plan, make_plan
from dicflow.engine.processes import WorkerProcesses
from dicflow.engine.product import Product
from dicflow.engine.product_warnings import product_warnings
from dicflow.engine.references import load
from dicflow.engine.running import Options, Running, has_few_tasks
from dicflow.engine.schedulers import BackendOptions, check_scheduler, open_backend, scheduler_warning
from dicflow.engine.store import Store
from dicflow.engine.work import Job, Outcome, perform, stop_path
from dicflow.engine.workers import keep_memory
from dicflow.errors import StageError, StoreError

__all__ = [
    "MOST_REPAIRS",
    "STATUSES",
    "Options",
    "RunResult",
    "backend_options",
    "dask_graph",
    "interruptible",
    "jobs_of",
    "keep_code",
    "run",
]


MOST_REPAIRS = 20
"""How often a run goes back to make damaged products again: where a disk damages all it gets, that has no end."""


@dataclass(frozen=True)
class RunResult:
    """What became of every task.

    folder : of the run in the store; None where nothing was to do in a store that cannot be written
    seconds : from the call of ``run`` to its return
    warnings : each once, those of products too, whether they were computed now or before
    compiled_s : processor time of compiling, by stage [s]
    """

    run_id: str
    folder: Path | None
    store: Store
    outcomes: Mapping[str, Outcome]
    seconds: float
    interrupted: bool = False
    warnings: Sequence[str] = ()
    compiled_s: Mapping[str, float] = field(default_factory=dict)

    @property
    def counts(self) -> dict[str, int]:
        """How many tasks were hit, computed, failed and skipped."""
        found = Counter[str](outcome.status for outcome in self.outcomes.values())
        return {status: found[status] for status in STATUSES}

    @property
    def ok(self) -> bool:
        """Whether every task has its product."""
        return all(outcome.ref is not None for outcome in self.outcomes.values())

    @property
    def errors(self) -> list[str]:
        """Messages of the tasks that failed."""
        return [outcome.error for outcome in self.outcomes.values() if outcome.status == "failed"]

    def by_stage(self) -> dict[str, dict[str, float]]:
        """The counts of each stage, and the seconds spent in it."""
        found: dict[str, dict[str, float]] = {}
        for outcome in self.outcomes.values():
            row = found.setdefault(outcome.stage, {**dict.fromkeys(STATUSES, 0), "seconds": 0.0})
            row[outcome.status] += 1
            row["seconds"] += outcome.stage_s
        return found

    def product(self, name: str) -> Product:
        """The product of a task. Raises StageError where it has none."""
        outcome = self.outcomes[name]
        if outcome.ref is None:
            raise StageError(f"{name}: has no product, it {outcome.status}: {outcome.error}")
        return load(self.store, outcome.ref)


def run(
    graph: Graph, store: Store, *, pipeline: str = "", resolved: Any = None, options: Options | None = None
) -> RunResult:
    """Make every product of a graph that is not in the store.

    pipeline : its name, under which the run is kept
    resolved : the pipeline as JSON, kept with the run
    The first Ctrl-C lets running tasks finish; the second raises KeyboardInterrupt. What is done is kept either way.
    What turns out damaged while it is read is made again; after a power failure that may be many products.

    Raises ConfigurationError, InputError and StoreError for what is wrong before anything runs. What fails in a
    stage is in the outcomes.
    """
    options, start = options or Options(), time.perf_counter()
    keep_kernels()
    keep_memory()
    check_scheduler(options.scheduler, options.workers)
    with _workers(options, graph, store) as processes:
        once = partial(_run_once, graph, store, pipeline, resolved, options, processes)
        result = once({})
        for _ in range(MOST_REPAIRS):
            if result.interrupted or not any(outcome.damaged for outcome in result.outcomes.values()):
                break
            before, result = result.compiled_s, once(result.outcomes)
            result = replace(result, compiled_s={**before, **result.compiled_s})
    result = replace(result, seconds=time.perf_counter() - start)
    if options.on_event is not None:
        options.on_event(Event("ended", counts=result.counts, seconds=result.seconds))
    return result


@contextmanager
def _workers(options: Options, graph: Graph, store: Store) -> Iterator[WorkerProcesses | None]:
    """Worker processes, for a scheduler that has them.

    In a new store, where all stages have work for sure, they start and load at once what these use; else each one loads
    what its tasks use, once there are some.
    """
    is_auto = options.scheduler == "auto"
    if (
        options.cluster
        or options.dashboard
        or not (is_auto or options.scheduler == "processes")
        or (is_auto and has_few_tasks(graph))
    ):
        yield None
        return
    nodes = {task.stage: task.node for task in graph.tasks.values()}
    ahead = options.ahead(nodes) if options.ahead is not None and store.is_new else ()
    with WorkerProcesses(options.workers, options.worker_setup, ahead) as processes:
        if store.is_new:
            processes.start()
        yield processes


def dask_graph(plan: Plan, store: Store, run_id: str = "plan") -> dict[tuple[str, ...], tuple[Any, ...]]:
    """The plain dask graph of what a plan lacks: (stage, step, run) → a call and the names of its inputs."""
    jobs = {job.task.name: job for job in jobs_of(plan, store, run_id, "recompute")}
    return {job.key: (perform, job, *(jobs[name].key for name in job.awaited())) for job in jobs.values()}


def _run_once(
    graph: Graph,
    store: Store,
    pipeline: str,
    resolved: Any,
    options: Options,
    processes: WorkerProcesses | None,
    before: Mapping[str, Outcome],
) -> RunResult:
    """Plan and run. before : outcomes of a first try; what that computed counts as computed."""
    plan = make_plan(
        graph,
        store,
        pipeline=pipeline,
        code_policy=options.code_policy,
        every_file=bool(before),
        on_event=options.on_event,
    )
    journal = _journal(plan, store, pipeline, resolved)
    state = Running(plan, store, journal, options)
    state.report(Event("planned", counts=plan.counts, stages=plan.by_stage()))
    for text in plan.warnings:
        state.report(Event("warning", text=text))
    if journal is not None:
        journal.write_index(state.index())
        try:
            if plan.counts["hit"] < len(plan.entries):
                keep_code(plan, store)
                _compute(state, journal.id, processes)
            for stage, text in product_warnings(graph, state.outcomes):
                state.report(Event("warning", stage=stage, text=text))
        finally:
            _close(state, journal)
    computed = {name: outcome for name, outcome in before.items() if outcome.status == "computed"}
    outcomes = {name: computed.get(name, state.outcomes[name]) for name in plan.entries}
    return RunResult(
        journal.id if journal is not None else "",
        journal.folder if journal is not None else None,
        store,
        outcomes,
        0.0,
        state.interrupted,
        [*plan.warnings, *(text for _, text in product_warnings(graph, outcomes))],
        state.compiled_s,
    )


def _journal(plan: Plan, store: Store, pipeline: str, resolved: Any) -> Journal | None:
    """The journal, or None in a store that cannot be written while there is nothing to write."""
    try:
        return Journal(store, pipeline, resolved)
    except StoreError:
        if plan.counts["hit"] == len(plan.entries):
            return None
        raise


def keep_code(plan: Plan, store: Store) -> None:
    """Keep which code the records will name."""
    for stage in dict.fromkeys(entry.task.stage for entry in plan.entries.values() if entry.state != "hit"):
        with suppress(StoreError):  # it only explains; a full disk is reported by the tasks
            store.put_code(plan.code[stage].root, plan.code[stage].parts)


def jobs_of(
    plan: Plan, store: Store, run_id: str, code_policy: CodePolicy, only: Container[str] | None = None
) -> Iterator[Job]:
    """A job for every task that is not a hit, in the order of the plan. only : names of the tasks; None for all"""
    gathered = plan.graph.gathered()
    codes = {stage: Fingerprint(code.root) for stage, code in plan.code.items()}
    for name, entry in plan.entries.items():
        if entry.state != "hit" and (only is None or name in only):
            task = entry.task
            refs = {producer: plan.entries[producer].ref for producer in task.producers()}
            yield Job(
                run_id,
                store.path,
                task,
                plan.parameters[task.stage],
                {producer: ref for producer, ref in refs.items() if ref is not None},
                plan.files[name],
                codes[task.stage],
                name in gathered,
                code_policy,
            )


def _compute(state: Running, run_id: str, processes: WorkerProcesses | None) -> None:
    options = state.options
    warning = scheduler_warning(options.scheduler)
    if warning:
        state.plan.warnings.append(warning)
        state.report(Event("warning", text=warning))
    opened = backend_options(state, run_id, processes)
    if options.scheduler == "auto" and state.is_short():
        opened = replace(opened, processes=None)
    with interruptible(state.interrupt), open_backend(opened) as backend:
        if backend.link:
            state.report(Event("dashboard", text=backend.link))
        state.compute(backend, jobs_of(state.plan, state.store, run_id, options.code_policy))
        state.skip_rest()
        if options.linger is not None:
            options.linger()


def backend_options(state: Running, run_id: str, processes: WorkerProcesses | None) -> BackendOptions:
    """What the scheduler of a run is opened with."""
    options = state.options
    return BackendOptions(
        options.scheduler,
        state.store,
        run_id,
        options.workers,
        options.dashboard,
        options.retries,
        options.worker_setup,
        processes,
        state.compilation(),
        state.ahead(),
        options.cluster,
        state.say,
    )


def _close(state: Running, journal: Journal) -> None:
    """Keep the index and counts; a full disk is ignored here; the tasks report it."""
    counts = Counter[str](outcome.status for outcome in state.outcomes.values())
    ended_early = len(state.outcomes) < len(state.plan.entries)
    interrupted = state.interrupted or ended_early
    result = {"counts": {status: counts[status] for status in STATUSES}, "interrupted": interrupted}
    with suppress(OSError):
        stop_path(state.store.path, journal.id).unlink(missing_ok=True)
    with suppress(StoreError):
        journal.close(state.index(), result)


@contextmanager
def interruptible(first: Callable[[], None]) -> Iterator[None]:
    """Turn the first Ctrl-C into a call of ``first``, and the second into KeyboardInterrupt."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    interrupted = False

    def handle(_signal: int, _frame: FrameType | None) -> None:
        nonlocal interrupted
        if interrupted:
            raise KeyboardInterrupt
        interrupted = True
        first()

    previous = signal.signal(signal.SIGINT, handle)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, previous)
