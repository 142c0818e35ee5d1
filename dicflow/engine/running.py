"""A run under way: how it is run, what has come of its tasks, and its listener."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace

from dicflow.engine.cluster_spec import ClusterSpec
from dicflow.engine.compilation import Compilation, Pieces
from dicflow.engine.expectation import expected_cpu_s
from dicflow.engine.graph import Graph
from dicflow.engine.journal import Event, Journal
from dicflow.engine.node import Node
from dicflow.engine.plan import CodePolicy, Plan
from dicflow.engine.references import Ref, recipe_of
from dicflow.engine.schedulers import Backend
from dicflow.engine.store import Store
from dicflow.engine.work import Job, Outcome, stop_path
from dicflow.errors import WorkerError

__all__ = ["Options", "Running", "has_few_tasks"]

_WORTH_WORKERS_S, _WORTH_WORKERS = 2.0, 9
"""Processor time and number of tasks below which work is done in threads of this process.

Workers have to start first, and each loads the libraries that the report here loads again: 0.3 s and 0.7 s."""


@dataclass(frozen=True)
class Options:
    """How a graph is run; nothing here changes a result.

    scheduler : one of :data:`dicflow.engine.schedulers.SCHEDULERS`, or the address of a running one; "auto" has worker
        processes where these are worth their start, and threads of this process elsewhere
    dashboard : show dask's dashboard on this machine's loopback, where every account can read its pages
    code_policy : what to do with results that other code has made
    keep_going : after a failure go on with all that does not need what failed
    retries : how often a task is tried again after an error that is not a DicflowError; a scheduler of dask's does so
        itself, perhaps on another worker. Workers of this machine may also die so often of one task, but at least
        once; then it gets one more attempt, alone.
    on_event : called with every event, in the thread that called ``run``
    worker_setup : called once in every worker, a function of a module
    uncompiled : gives the pieces of code that stages which will run need, where these are not compiled yet
    ahead : gives for all stages by name what workers do while they wait for work
    linger : called when all is done, before workers and dashboard end
    cluster : whose workers are started for the run, in the place of those of ``scheduler``
    """

    scheduler: str = "auto"
    workers: int = 2
    dashboard: bool = False
    code_policy: CodePolicy = "recompute"
    keep_going: bool = False
    retries: int = 0
    on_event: Callable[[Event], None] | None = None
    worker_setup: Callable[[], None] | None = None
    uncompiled: Callable[[Mapping[str, Node]], Pieces] | None = None
    ahead: Callable[[Mapping[str, Node]], Sequence[Callable[[], None]]] | None = None
    linger: Callable[[], None] | None = None
    cluster: ClusterSpec | None = None


def has_few_tasks(graph: Graph) -> bool:
    """Whether workers would each have so few tasks that they cost more than they save."""
    return len(graph.tasks) < _WORTH_WORKERS


class Running:
    """A run under way: its outcomes, journal and listener."""

    def __init__(self, plan: Plan, store: Store, journal: Journal | None, options: Options) -> None:
        self.plan = plan
        self.store = store
        self.journal = journal
        self.options = options
        self.interrupted = False
        self.stopped = False
        self.compiled_s: dict[str, float] = {}
        hits = {name: entry for name, entry in plan.entries.items() if entry.state == "hit"}
        self.outcomes = {
            name: Outcome(
                name, entry.task.stage, entry.task.step, "hit", entry.ref, entry.key or "", warnings=entry.warnings
            )
            for name, entry in hits.items()
        }

    def take(self, plan: Plan) -> None:
        """Go on with a plan that has grown; outcomes of tasks that are joined otherwise now are forgotten."""
        before = self.plan.entries
        self.outcomes = {name: one for name, one in self.outcomes.items() if plan.entries.get(name) is before[name]}
        self.plan = plan

    def report(self, event: Event) -> None:
        """Journal an event and call the listener with it."""
        if self.journal is not None:
            self.journal.write(event)
        if self.options.on_event is not None:
            self.options.on_event(event)

    def finished(self, outcome: Outcome) -> None:
        """Take in the outcome of a task."""
        outcome = self._shared(outcome)
        self.outcomes[outcome.name] = outcome
        if outcome.warning and outcome.warning not in self.plan.warnings:
            self.plan.warnings.append(outcome.warning)
            self.report(Event("warning", text=outcome.warning))
        if outcome.status == "failed" and not outcome.damaged and not self.options.keep_going:
            self.stop()
        self.report(
            Event(
                "finished",
                task=outcome.name,
                stage=outcome.stage,
                step=outcome.step,
                status=outcome.status,
                seconds=outcome.stage_s,
                text=outcome.error,
                key=outcome.key,
                digest=outcome.ref.digest if outcome.ref is not None else "",
            )
        )

    def _shared(self, outcome: Outcome) -> Outcome:
        """The outcome with the task and references of this process, in the place of the copies that a worker sent."""
        task, ref = self.plan.entries[outcome.name].task, outcome.ref
        if ref is not None and ref.recipe is not None:
            producers = ((name, self.outcomes[name].ref) for name in task.producers())
            ref = Ref(ref.digest, recipe_of(task, {name: one for name, one in producers if one is not None}))
        return replace(outcome, name=task.name, stage=task.stage, step=task.step, ref=ref)

    def is_short(self) -> bool:
        """Whether the missing tasks took so little time in the last run that worker processes cost more."""
        name = self.journal.pipeline if self.journal is not None else ""
        return expected_cpu_s(self.plan, self.store, name, _WORTH_WORKERS_S) < _WORTH_WORKERS_S

    def compilation(self) -> Compilation:
        """What is to compile for the stages that will run, and who listens."""
        nodes = self._nodes()
        pieces = self.options.uncompiled(nodes) if self.options.uncompiled is not None else {}
        return Compilation(pieces, lambda: not self.stopped, self._compiling, self._compiled)

    def ahead(self) -> Sequence[Callable[[], None]]:
        """What is done while there is nothing to do yet."""
        return self.options.ahead(self._nodes()) if self.options.ahead is not None else ()

    def say(self, text: str) -> None:
        """Report a sentence about what is waited for."""
        self.report(Event("waiting", text=text))

    def _nodes(self) -> dict[str, Node]:
        """The stages that will run, by name."""
        entries = (entry.task for entry in self.plan.entries.values() if entry.state != "hit")
        return {task.stage: task.node for task in entries}

    def _compiling(self, stage: str) -> None:
        self.report(Event("compiling", stage=stage))

    def _compiled(self, stage: str, cpu_s: float) -> None:
        self.compiled_s[stage] = self.compiled_s.get(stage, 0.0) + cpu_s
        self.report(Event("compiled", stage=stage, seconds=cpu_s))

    def stop(self) -> None:
        """Let no worker start another task."""
        self.stopped = True
        if self.journal is not None:
            with suppress(OSError):
                stop_path(self.store.path, self.journal.id).touch()

    def interrupt(self) -> None:
        """The same after Ctrl-C."""
        self.interrupted = True
        self.stop()

    def compute(self, backend: Backend, jobs: Iterator[Job]) -> None:
        """Run jobs until a stop. Where no worker is left, the first task without an outcome has failed."""
        try:
            backend.compute(self._until_stop(jobs), self.outcomes, self.finished)
        except WorkerError as error:
            lost = next(entry.task for name, entry in self.plan.entries.items() if name not in self.outcomes)
            self.stopped = True
            self.finished(Outcome(lost.name, lost.stage, lost.step, "failed", error=f"{lost.name}: {error}"))

    def skip_rest(self) -> None:
        """Give an outcome to the tasks that were not handed over before a stop."""
        for name, entry in self.plan.entries.items():
            if name not in self.outcomes:
                task = entry.task
                self.finished(Outcome(name, task.stage, task.step, "skipped", error="the run was stopped"))

    def _until_stop(self, jobs: Iterator[Job]) -> Iterator[Job]:
        while not self.stopped and (job := next(jobs, None)) is not None:
            yield job

    def index(self) -> dict[str, dict[str, str]]:
        """Key and digest of every task that has its product."""
        return {
            name: {"key": outcome.key, "digest": outcome.ref.digest}
            for name, outcome in self.outcomes.items()
            if outcome.ref is not None
        }
