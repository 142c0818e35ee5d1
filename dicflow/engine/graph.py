"""From stages to tasks: every stage repeated over its scope, with the tasks that each takes its inputs from."""

from __future__ import annotations

import graphlib
import math
import typing
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo

from dicflow.engine.files import FilePart
from dicflow.engine.looks import AT_ONCE, look_ports
from dicflow.engine.node import At, Node, Scope, Steps, port_of
from dicflow.errors import ConfigurationError, InputError

__all__ = ["EARLY_STEPS", "Graph", "StageSpec", "Task", "TaskInput", "expand", "file_fields"]

_LATER = (
    "runs at the first step too, where '{source}' has nothing to give to its input '{port}'; let the stage declare "
    "scope = Scope.PAIR, or the input optional=True"
)

TaskInput = str | None | tuple[tuple[str, str], ...]
"""What a port of a task is joined to: a task's name, nothing, or for several steps pairs (step, task's name)."""

EARLY_STEPS = (1, 2, 4, 8, 16)
"""Steps after the first that ``At.EARLY`` takes."""


@dataclass(frozen=True)
class StageSpec:
    """One stage of a pipeline.

    node : what it does, with its parameters
    inputs : port → name of the stage that gives it; of several stages the later ones as ``port[1]``, ``port[2]`` …
    folder : where the relative paths among its parameters start
    where : position in the pipeline file, put in front of messages
    places : parameter → its own position there
    only : names of the steps to keep, of a stage that starts a series; all if empty
    """

    node: Node
    inputs: Mapping[str, str] = field(default_factory=dict)
    folder: Path = Path()
    where: str = ""
    places: Mapping[str, str] = field(default_factory=dict)
    only: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Task:
    """One piece of work: a stage at one step, or a stage that runs once.

    name : ``stage/step``, or ``stage`` alone where it runs once
    step : name of the step; of a pair, the one that it ends in
    inputs : port → task
    files : argument of ``run`` → file, or part of one
    is_look : whether it is a look at some steps, which the stage takes in place of these; its step names them
    """

    name: str
    stage: str
    step: str | None
    node: Node
    inputs: Mapping[str, TaskInput]
    files: Mapping[str, Path | FilePart]
    is_look: bool = False

    def producers(self) -> list[str]:
        """Names of all tasks that this one takes something from, each once."""
        names: dict[str, None] = {}
        for source in self.inputs.values():
            if isinstance(source, str):
                names[source] = None
            elif source is not None:
                names.update((name, None) for _, name in source)
        return list(names)


@dataclass(frozen=True)
class Graph:
    """All stages and tasks of a pipeline.

    stages : name → stage, every stage after those it takes from
    tasks : name → task, every task after those it takes from, and step by step: the tasks of all stages at one step
        before those at the next. A task that others of an early step need, such as one of a calibration, comes before
        that step.
    steps : stage → names of its steps in order; empty for a stage that runs once
    files : stage → step → argument → file, for stages that start a series of steps
    starts : stage that repeats over steps → the one whose files these are
    is_whole : whether the steps are all that there will be
    """

    stages: Mapping[str, StageSpec]
    tasks: Mapping[str, Task]
    steps: Mapping[str, tuple[str, ...]]
    files: Mapping[str, Steps]
    starts: Mapping[str, str]
    is_whole: bool = True

    def tasks_of(self, stage: str) -> list[Task]:
        """The tasks of one stage, in the order of its steps."""
        return [task for task in self.tasks.values() if task.stage == stage]

    def gathered(self) -> frozenset[str]:
        """Names of the tasks whose arrays some stage takes together with those of all other steps."""
        inputs = ((task.node, *pair) for task in self.tasks.values() for pair in task.inputs.items())
        taken = (source for node, port, source in inputs if isinstance(source, tuple) and node.gathers(port))
        return frozenset(name for source in taken for _, name in source)

    def upstream(self, stages: Iterable[str]) -> Graph:
        """The part of the graph that these stages need, with the stages themselves."""
        needed: set[str] = set()
        waiting = list(stages)
        while waiting:
            name = waiting.pop()
            if name not in needed:
                needed.add(name)
                waiting += self.stages[name].inputs.values()
        return Graph(
            {name: spec for name, spec in self.stages.items() if name in needed},
            {name: task for name, task in self.tasks.items() if task.stage in needed},
            {name: steps for name, steps in self.steps.items() if name in needed},
            {name: files for name, files in self.files.items() if name in needed},
            {name: start for name, start in self.starts.items() if name in needed},
            self.is_whole,
        )


def expand(stages: Mapping[str, StageSpec], steps: Mapping[str, Steps] | None = None) -> Graph:
    """All tasks of the given stages.

    steps : of the stages that start a series, where these are known; their folders are not looked at

    Raises ConfigurationError with the stage's position where the stages do not fit together (an unknown or missing
    input, one of another kind, a cycle, two series of steps in one stage), and InputError where files are missing
    or have names that cannot be written down.
    """
    ordered = {name: stages[name] for name in _in_order(stages)}
    for name in ordered:
        _check_inputs(name, stages)
    series: dict[str, _Series | None] = {}
    for name in ordered:
        if steps is not None and name in steps:
            series[name] = _Series(name, steps[name])
        else:
            series[name] = _series_of(name, stages, series)
    joints = _Joints(ordered, series)
    tasks = _step_major([task for name in ordered for task in joints.tasks(name)], joints.places)
    _check_names(tasks.values())
    files = {name: one.files for name, one in series.items() if one is not None and one.start == name}
    starts = {name: one.start for name, one in series.items() if one is not None}
    is_whole = steps is None and not any(spec.only for spec in stages.values())
    return Graph(ordered, tasks, joints.steps, files, starts, is_whole)


@cache
def file_fields(cls: type[Node]) -> frozenset[str]:
    """Names of the parameters that hold the path of an input file, alone or as one of several types."""
    hints = typing.get_type_hints(cls, include_extras=True)
    return frozenset(name for name in cls.model_fields if _holds_file(hints[name]))


@dataclass(frozen=True)
class _Series:
    """A series of steps. start : the stage whose files it follows; files : step → argument → file."""

    start: str
    files: Steps


def _holds_file(hint: Any) -> bool:
    marks = getattr(hint, "__metadata__", ())
    if any(isinstance(m, FieldInfo) and (m.json_schema_extra or {}) == {"file": True} for m in marks):
        return True
    return any(_holds_file(inner) for inner in typing.get_args(hint))


def _fail(name: str, spec: StageSpec, message: str) -> typing.NoReturn:
    raise ConfigurationError(f"{spec.where}: {name}: {message}" if spec.where else f"{name}: {message}")


def _outer_inputs(name: str, spec: StageSpec) -> dict[str, str]:
    """Inputs that come from other stages, by port."""
    takes = spec.node.takes
    return {port: source for port, source in spec.inputs.items() if not (port in takes and takes[port].own)}


def _in_order(stages: Mapping[str, StageSpec]) -> list[str]:
    sources = {name: list(_outer_inputs(name, spec).values()) for name, spec in stages.items()}
    try:
        order = graphlib.TopologicalSorter(sources).static_order()
        return [name for name in order if name in stages]
    except graphlib.CycleError as error:
        ring = error.args[1]
        _fail(ring[0], stages[ring[0]], f"the stages {' → '.join(ring)} wait for each other; change one input")


def _step_major(tasks: Sequence[Task], places: Mapping[str, Mapping[str, int]]) -> dict[str, Task]:
    """Name → task, step by step, every task after those it takes from.

    tasks : every task after those it takes from
    places : stage → step → place of the step in its series

    A task is due at the first step that needs it, itself or through others: due(t) = min(place(t), due(consumers)).
    It can begin once the last step is through that it needs: ready(t) = max(place(t), ready(producers)). Neither falls
    from a producer to its consumer, so the order by (due, ready) keeps producers first. A look is due as soon as it can
    begin.
    """
    place = {task.name: None if task.step is None else places[task.stage].get(task.step) for task in tasks}
    due = {name: math.inf if where is None else where for name, where in place.items()}
    ready = {name: where or 0 for name, where in place.items()}
    for task in reversed(tasks):
        for producer in task.producers():
            due[producer] = min(due[producer], due[task.name])
    for task in tasks:
        ready[task.name] = max([ready[task.name], *(ready[producer] for producer in task.producers())])
        if task.is_look:
            due[task.name] = ready[task.name]
    return {task.name: task for task in sorted(tasks, key=lambda task: (due[task.name], ready[task.name]))}


def _check_names(tasks: Iterable[Task]) -> None:
    """Refuse files whose names are not valid text: journals, pages and tables could not print them."""
    for path in {path: None for task in tasks for path in task.files.values()}:
        try:
            str(path).encode("utf-8")
        except UnicodeEncodeError as error:
            raise InputError(f"{str(path)!r}: the name is not in UTF-8; rename the file or its folder") from error


def _check_inputs(name: str, stages: Mapping[str, StageSpec]) -> None:
    spec = stages[name]
    takes = spec.node.takes
    for given in spec.inputs:
        if port_of(given) not in takes or (given not in takes and not takes[port_of(given)].several):
            _fail(name, spec, f"has no input '{given}'; its inputs are {', '.join(takes) or 'none'}")
    for port_name, port in takes.items():
        sources = [name] if port.own else _joined_to(spec, port_name)
        if not sources and not port.optional:
            _fail(name, spec, f"needs an input '{port_name}' ({' or '.join(port.kinds)}); name the stage for it")
        for source in sources:
            _check_source(name, spec, port_name, source, stages)


def _check_source(name: str, spec: StageSpec, port_name: str, source: str, stages: Mapping[str, StageSpec]) -> None:
    """Raise ConfigurationError if a port does not fit a stage that is joined to it."""
    port = spec.node.takes[port_name]
    if source not in stages:
        _fail(name, spec, f"input '{port_name}' names an unknown stage '{source}'; stages: {', '.join(stages)}")
    if stages[source].node.gives not in port.kinds:
        kind = stages[source].node.gives
        _fail(name, spec, f"input '{port_name}' needs {' or '.join(port.kinds)}, but '{source}' gives {kind}")
    if port.own and port.at not in (At.PREVIOUS, At.FIRST):
        _fail(name, spec, f"input '{port_name}' takes its own output at the step before or the first only")


def _joined_to(spec: StageSpec, port_name: str) -> list[str]:
    """The stages joined to a port, in the order of the pipeline."""
    return [source for given, source in spec.inputs.items() if port_of(given) == port_name]


def _repeats(node: Node) -> bool:
    return node.scope in (Scope.STEP, Scope.PAIR)


def _series_of(name: str, stages: Mapping[str, StageSpec], series: Mapping[str, _Series | None]) -> _Series | None:
    """The steps that a stage repeats over: its own, or those of its inputs; None for a stage that runs once."""
    spec = stages[name]
    if not _repeats(spec.node):
        return None
    try:
        own = spec.node.steps(spec.folder)
    except InputError as error:
        raise InputError(f"{spec.where}: {name}: {error}" if spec.where else f"{name}: {error}") from error
    if own is not None:
        return _Series(name, {step: own[step] for step in spec.only} if spec.only else own)
    outer = _outer_inputs(name, spec)
    found = {one.start: one for source in outer.values() if (one := series[source]) is not None}
    following = [port for port in outer if spec.node.takes[port_of(port)].at in (At.SAME, At.PREVIOUS)]
    if following and len(found) > 1:
        found = {one.start: one for port in following if (one := series[outer[port]]) is not None}
    if not found:
        _fail(name, spec, "repeats over steps, but none of its inputs has any; name a stage with images")
    if len(found) > 1:
        _fail(name, spec, f"mixes the steps of {' and '.join(found)}; all its inputs must follow one series of images")
    return next(iter(found.values()))


class _Joints:
    """Joins the tasks of all stages, port by port."""

    def __init__(self, stages: Mapping[str, StageSpec], series: Mapping[str, _Series | None]) -> None:
        self.stages = stages
        self.series = series
        self.all_steps = {name: tuple(one.files) if one is not None else () for name, one in series.items()}
        self.offset = {name: int(spec.node.scope is Scope.PAIR) for name, spec in stages.items()}
        self.steps = {name: steps[self.offset[name] :] for name, steps in self.all_steps.items()}
        self.places = {name: {step: k for k, step in enumerate(steps)} for name, steps in self.all_steps.items()}

    def tasks(self, name: str) -> list[Task]:
        """The tasks of one stage, in the order of its steps."""
        node, own, files = self.stages[name].node, self.series[name], _own_files(self.stages[name])
        if own is None:
            inputs = self._inputs(name, None)
            looks = _looks(name, node, inputs)
            return [*looks, Task(name, name, None, node, _seen_through(looks, node, inputs), files)]
        here = own.files if own.start == name else {}
        return [
            Task(f"{name}/{step}", name, step, node, self._inputs(name, place), {**files, **here.get(step, {})})
            for place, step in enumerate(self.steps[name], start=self.offset[name])
        ]

    def _inputs(self, name: str, place: int | None) -> dict[str, TaskInput]:
        return {port: self._joined(name, port, place) for port in self.stages[name].node.takes}

    def _joined(self, name: str, port_name: str, place: int | None) -> TaskInput:
        """What one port is joined to, at one place in the series of its stage (None: the stage runs once)."""
        spec = self.stages[name]
        port = spec.node.takes[port_name]
        if port.several:
            return tuple(pair for source in _joined_to(spec, port_name) for pair in self._every(source)) or None
        source = name if port.own else spec.inputs.get(port_name)
        if source is None:
            return None
        if port.at is At.ALL:
            return self._every(source)
        if self.series[source] is None:
            return None if port.at is At.EARLY else source
        if port.at is At.EARLY:
            early = (self.offset[source] + after for after in EARLY_STEPS)
            steps = self.all_steps[source]
            return tuple((steps[k], f"{source}/{steps[k]}") for k in early if k < len(steps)) or None
        if port.at is At.FIRST:
            source_place = self.offset[source]
        elif place is None:
            _fail(name, spec, f"runs once, so input '{port_name}' cannot follow the steps of '{source}'")
        else:
            source_place = place - (port.at is At.PREVIOUS)
        steps = self.all_steps[source]
        if not self.offset[source] <= source_place < len(steps) or (port.own and source_place == place):
            if port.at is At.SAME and not port.optional:
                _fail(name, spec, _LATER.format(port=port_name, source=source))
            return None
        return f"{source}/{steps[source_place]}"

    def _every(self, source: str) -> tuple[tuple[str, str], ...]:
        """All tasks of a stage, each with the name of its step, or of the stage if it runs once."""
        if self.series[source] is None:
            return ((source, source),)
        return tuple((step, f"{source}/{step}") for step in self.steps[source])


def _looks(name: str, node: Node, inputs: Mapping[str, TaskInput]) -> list[Task]:
    """The looks of a stage that runs once at each whole part of its series; none for a stage without a look."""
    ports = look_ports(type(node))
    series = inputs[ports[0]] if ports else None
    if not isinstance(series, tuple):
        return []
    found = []
    for end in range(AT_ONCE, len(series) + 1, AT_ONCE):
        part = series[end - AT_ONCE : end]
        label, given = f"{part[0][0]}…{part[-1][0]}", {port: inputs[port] for port in ports}
        found.append(Task(f"{name}/{label}", name, label, node, {**given, ports[0]: part}, {}, is_look=True))
    return found


def _seen_through(looks: Sequence[Task], node: Node, inputs: Mapping[str, TaskInput]) -> Mapping[str, TaskInput]:
    """The inputs of a stage with looks in place of the steps that they are of."""
    if not looks:
        return inputs
    port = look_ports(type(node))[0]
    series = inputs[port]
    assert isinstance(series, tuple)
    rest = series[len(looks) * AT_ONCE :]
    return {**inputs, port: (*((str(task.step), task.name) for task in looks), *rest)}


def _own_files(spec: StageSpec) -> dict[str, Path]:
    given = {name: getattr(spec.node, name) for name in sorted(file_fields(type(spec.node)))}
    return {f"{name}_path": spec.folder / value for name, value in given.items() if value is not None}
