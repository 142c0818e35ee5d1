"""A test that is measured while it runs: each step as its photographs come, the newest first."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from dicflow.engine.files import Stamp
from dicflow.engine.graph import Graph
from dicflow.engine.growing import GrowingRun
from dicflow.engine.journal import Event
from dicflow.engine.node import Scope, Steps
from dicflow.engine.processes import WorkerLost
from dicflow.engine.work import KILLED, Outcome
from dicflow.errors import DicflowError, InputError
from dicflow.io.folder_changes import FolderChanges
from dicflow.pipeline.arrivals import Arrivals
from dicflow.pipeline.step_readings import readings_of_step

if TYPE_CHECKING:
    from dicflow.pipeline.pipeline import Pipeline

__all__ = ["Measured", "Watch"]

_LOOK_S, _SOON_S, _END_S = 2.0, 0.05, 0.2
"""How often the folders are looked at without a change, and while a file is being written; how soon the end is seen."""


class Measured(NamedTuple):
    """A step that is measured.

    after_s : since the last of its photographs was there [s]
    readings : rows of the probes at this step, as their table has them; none at the first step. Of a sweep each has the
        values of its variant beside, under "variant"
    problems : why it has no values
    """

    step: str
    after_s: float
    readings: tuple[Mapping[str, Any], ...] = ()
    problems: tuple[str, ...] = ()


class Watch:
    """Measures the steps of a pipeline as their photographs come.

    on_measured : called with each step, in the order in which they are measured
    on_note : called with sentences for the user: what is waited for, and how far measuring is behind
    workers : tasks at once

    What it makes are products of the pipeline as any run makes them, except of stages that need the whole test:
    ``pipeline_so_far().run()`` adds these.
    """

    def __init__(
        self,
        pipeline: Pipeline,
        on_measured: Callable[[Measured], None],
        on_note: Callable[[str], None],
        workers: int = 2,
    ) -> None:
        self._pipeline = pipeline
        self._on_measured, self._on_note = on_measured, on_note
        self._options = pipeline.options(workers=workers, on_event=self._on_event)
        self._specs = {name: pipeline.stages[name] for name in pipeline.searched}
        folders = {
            place if place.is_dir() else _folder(place) for places in pipeline.searched.values() for place in places
        }
        self._changes = FolderChanges(sorted(folders), pipeline.store_folder)
        self._arrivals = Arrivals(pipeline.store)
        self._found: dict[str, Steps] = {}
        self._stamps: dict[Path, Stamp] = {}
        self._noted: set[str] = set()
        self._behind = False
        self._has_ended = False

    def end(self) -> None:
        """Let :meth:`run` return once the step is measured that it is at; also called by a handler of a signal."""
        self._has_ended = True

    def run(self) -> None:
        """Measure until :meth:`end`. Raises WorkerError where no worker is left, and StoreError."""
        pipeline = self._pipeline
        nodes = {name: spec.node for name, spec in pipeline.stages.items()}
        with self._changes, GrowingRun(pipeline.store, pipeline.name, nodes, self._options) as growing:
            growing.compile_ahead(lambda: not self._has_ended)
            while not self._has_ended:
                if not (self._look(growing) and self._measure_next(growing)):
                    growing.show_life()
                    self._wait(_LOOK_S if self._arrivals.resting else _SOON_S)

    def pipeline_so_far(self) -> Pipeline:
        """The pipeline with the steps found so far. Raises InputError where there are none."""
        if not self._found:
            raise InputError("no step was measured; start again when there are photographs")
        return replace(self._pipeline, found=self._found)

    def _wait(self, seconds: float) -> None:
        """Wait for a change, the end, or so long."""
        until = time.monotonic() + seconds
        while not self._has_ended and (left := until - time.monotonic()) > 0:
            if self._changes.wait(min(left, _END_S)):
                return

    def _on_event(self, event: Event) -> None:
        if event.kind == "compiling":
            self._note(f"compiling for {event.stage}, once per version")

    def _look(self, growing: GrowingRun) -> bool:
        """Let the run grow by the steps that are there now; returns whether their files are at rest."""
        try:
            if missing := self._changes.missing():
                raise InputError(f"{missing[0]}: no such folder; it is waited for, and Ctrl-C ends the watch")
            found = self._arrivals.look(self._specs)
            if self._arrivals.replaced:
                self._note(f"waiting: {self._arrivals.replaced[0]} is being written again")
                return False
            stamps = self._arrivals.stamps(found)
            if found != self._found or stamps != self._stamps or not growing.tasks:
                so_far = replace(self._pipeline, found=found)
                growing.grow(_live(so_far.graph), so_far.described())
                self._found, self._stamps = found, stamps
        except InputError as error:
            self._note(f"waiting: {error}")
            return True
        if self._arrivals.resting:
            problems = [*self._arrivals.waiting.values(), *self._arrivals.alone]
            waiting = [f"waiting: {problem}" for problem in problems]
            self._noted.intersection_update(waiting)
            for text in waiting:
                self._note(text)
        return True

    def _note(self, text: str) -> None:
        """Say something once."""
        if text not in self._noted:
            self._noted.add(text)
            self._on_note(text)

    def _measure_next(self, growing: GrowingRun) -> bool:
        """Measure the newest step, or else the oldest that is left; returns whether there was one."""
        if not growing.tasks:
            return False
        series = _main_series(growing)
        steps = self._found[series]
        left = _unmeasured(growing, series)
        self._say_how_far(len(left))
        if not left:
            return False
        last = list(steps)[-1]
        step = last if last in left else next(iter(left))
        growing.compute(left[step])
        still_left = _unmeasured(growing, series)
        for done in sorted(left.keys() - still_left.keys(), key=list(left).index):
            self._on_measured(self._measured(growing, series, done, left[done]))
        return True

    def _say_how_far(self, left: int) -> None:
        if left > 1 and not self._behind:
            self._on_note(f"{left} steps are not measured yet: the newest is measured first, then the others")
        elif not left and self._behind:
            self._on_note("all steps are measured")
        self._behind = left > 1 or (self._behind and left > 0)

    def _measured(self, growing: GrowingRun, series: str, step: str, names: list[str]) -> Measured:
        problems = _problems([growing.outcomes[name] for name in names])
        rows: list[Mapping[str, Any]] = []
        for stage, spec in self._pipeline.stages.items():
            total = growing.ref(f"{spec.inputs.get('total')}/{step}") if spec.node.gives == "probes" else None
            if total is not None:
                try:
                    rig = growing.ref(spec.inputs.get("rig", ""))
                    read = growing.call(readings_of_step, self._pipeline.store_folder, spec.node, step, total, rig)
                    rows += [{**row, **self._variant(stage)} for row in read]
                except DicflowError as error:
                    problems.append(f"{stage}: {error}")
                except WorkerLost:
                    problems.append(f"{stage}: {KILLED}")
                except Exception as error:  # the test goes on, and so does the watch
                    problems.append(f"{stage}: {type(error).__name__}: {error}; the run at the end tries again")
        return Measured(step, self._arrivals.age(self._found[series][step].values()), tuple(rows), tuple(problems))

    def _variant(self, stage: str) -> dict[str, Any]:
        """Of a stage of a sweep the column "variant": the values that all variants with this stage share."""
        variants = zip(self._pipeline.variants, self._pipeline.instances, strict=True)
        first, *others = (variant.values for variant, names in variants if stage in names.values())
        shared = {name: value for name, value in first.items() if all(one.get(name) == value for one in others)}
        return {"variant": shared} if shared else {}


def _problems(outcomes: Sequence[Outcome]) -> list[str]:
    """Why a step has no values: what failed, or else what the first task that was skipped lacks."""
    failed = [one.error for one in outcomes if one.status == "failed"]
    return failed or [f"not measured: {one.error}" for one in outcomes if one.status == "skipped"][:1]


def _folder(place: Path) -> Path:
    """The folder of a file that is named without wildcards; of a name without a suffix, the folder of that name."""
    return place.parent if place.suffix else place


def _live(graph: Graph) -> Graph:
    """The part of a graph that is made step by step, with what it needs: all but what needs the whole test."""
    return graph.upstream(name for name, spec in graph.stages.items() if spec.node.scope in (Scope.STEP, Scope.PAIR))


def _main_series(growing: GrowingRun) -> str:
    """The series that most stages follow: the photographs of the test, rather than those of boards."""
    return Counter(growing.starts.values()).most_common(1)[0][0]


def _unmeasured(growing: GrowingRun, series: str) -> dict[str, list[str]]:
    """Step → tasks of its own that have no outcome, for each step of a series that has any, in order."""
    left: dict[str, list[str]] = {}
    for name, task in growing.tasks.items():
        if task.step is not None and name not in growing.outcomes and growing.starts[task.stage] == series:
            left.setdefault(task.step, []).append(name)
    return left
