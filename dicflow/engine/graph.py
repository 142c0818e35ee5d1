"""From stages to tasks: every stage repeated over its scope, with the tasks that each takes its inputs from."""

from __future__ import annotations

import graphlib
import typing
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

from pydantic.fields import FieldInfo

from dicflow.engine.node import At, Node, Port, Scope
from dicflow.errors import ConfigurationError

__all__ = ["Graph", "StageSpec", "Task", "TaskInput", "expand", "file_fields"]

TaskInput = str | None | tuple[tuple[str, str], ...]
"""What a port of a task is joined to: a task's name, nothing, or for ``At.ALL`` pairs (step, task's name)."""


@dataclass(frozen=True)
class StageSpec:
    """One stage of a pipeline.

    node : what it does, with its parameters
    inputs : port → name of the stage that gives it
    folder : where the relative paths among its parameters start
    where : position in the pipeline file, put in front of messages
    """

    node: Node
    inputs: Mapping[str, str] = field(default_factory=dict)
    folder: Path = Path()
    where: str = ""


@dataclass(frozen=True)
class Task:
    """One piece of work: a stage at one step, or a stage that runs once.

    name : ``stage/step``, or ``stage`` alone where it runs once
    step : name of the step; of a pair, the one that it ends in
    inputs : port → task
    files : argument of ``run`` → file
    """

    name: str
    stage: str
    step: str | None
    node: Node
    inputs: Mapping[str, TaskInput]
    files: Mapping[str, Path]

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
    tasks : name → task, every task after those it takes from
    steps : stage → names of its steps in order; empty for a stage that runs once
    files : stage → step → argument → file, for stages that start a series of steps
    """

    stages: Mapping[str, StageSpec]
    tasks: Mapping[str, Task]
    steps: Mapping[str, tuple[str, ...]]
    files: Mapping[str, Mapping[str, Mapping[str, Path]]]

    def tasks_of(self, stage: str) -> list[Task]:
        """The tasks of one stage, in the order of its steps."""
        return [task for task in self.tasks.values() if task.stage == stage]

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
        )


def expand(stages: Mapping[str, StageSpec]) -> Graph:
    """All tasks of the given stages.

    Raises ConfigurationError with the stage's position where the stages do not fit together (an unknown or missing
    input, one of another kind, a cycle, two series of steps in one stage), and InputError where files are missing.
    """
    ordered = _in_order(stages)
    for name in ordered:
        _check_inputs(name, stages)
    series: dict[str, _Series | None] = {}
    for name in ordered:
        series[name] = _series_of(name, stages, series)
    tasks: dict[str, Task] = {}
    for name in ordered:
        tasks.update((task.name, task) for task in _tasks(name, stages, series))
    return Graph(
        {name: stages[name] for name in ordered},
        tasks,
        {name: _steps(stages[name].node, series[name]) for name in ordered},
        {name: one.files for name in ordered if (one := series[name]) is not None and one.start == name},
    )


@cache
def file_fields(cls: type[Node]) -> frozenset[str]:
    """Names of the parameters that hold the path of an input file, alone or as one of several types."""
    hints = typing.get_type_hints(cls, include_extras=True)
    return frozenset(name for name in cls.model_fields if _holds_file(hints[name]))


@dataclass(frozen=True)
class _Series:
    """A series of steps. start : the stage whose files it follows; files : step → argument → file."""

    start: str
    files: Mapping[str, Mapping[str, Path]]


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


def _check_inputs(name: str, stages: Mapping[str, StageSpec]) -> None:
    spec = stages[name]
    takes = spec.node.takes
    for port in spec.inputs:
        if port not in takes:
            _fail(name, spec, f"has no input '{port}'; its inputs are {', '.join(takes) or 'none'}")
    for port_name, port in takes.items():
        source = name if port.own else spec.inputs.get(port_name)
        if source is None:
            if not port.optional:
                _fail(name, spec, f"needs an input '{port_name}' ({' or '.join(port.kinds)}); name the stage for it")
        elif source not in stages:
            _fail(name, spec, f"input '{port_name}' names no stage: '{source}'; stages: {', '.join(stages)}")
        elif stages[source].node.gives not in port.kinds:
            given = stages[source].node.gives
            _fail(name, spec, f"input '{port_name}' needs {' or '.join(port.kinds)}, but '{source}' gives {given}")
        elif port.own and port.at not in (At.PREVIOUS, At.FIRST):
            _fail(name, spec, f"input '{port_name}' takes its own output at the step before or the first only")


def _repeats(node: Node) -> bool:
    return node.scope in (Scope.STEP, Scope.PAIR)


def _series_of(name: str, stages: Mapping[str, StageSpec], series: Mapping[str, _Series | None]) -> _Series | None:
    """The steps that a stage repeats over: its own, or those of its inputs; None for a stage that runs once."""
    spec = stages[name]
    if not _repeats(spec.node):
        return None
    own = spec.node.steps(spec.folder)
    if own is not None:
        return _Series(name, own)
    outer = _outer_inputs(name, spec)
    found = {one.start: one for source in outer.values() if (one := series[source]) is not None}
    following = [port for port in outer if spec.node.takes[port].at in (At.SAME, At.PREVIOUS)]
    if following and len(found) > 1:
        found = {one.start: one for port in following if (one := series[outer[port]]) is not None}
    if not found:
        _fail(name, spec, "repeats over steps, but none of its inputs has any; name a stage with images")
    if len(found) > 1:
        _fail(name, spec, f"mixes the steps of {' and '.join(found)}; all its inputs must follow one series of images")
    return next(iter(found.values()))


def _steps(node: Node, series: _Series | None) -> tuple[str, ...]:
    names = tuple(series.files) if series is not None else ()
    return names[1:] if node.scope is Scope.PAIR else names


def _tasks(name: str, stages: Mapping[str, StageSpec], series: Mapping[str, _Series | None]) -> list[Task]:
    spec, own = stages[name], series[name]
    files = _own_files(spec)
    if own is None:
        inputs = {port: _joined(name, port, None, None, stages, series) for port in spec.node.takes}
        return [Task(name, name, None, spec.node, inputs, files)]
    result = []
    places = {step: place for place, step in enumerate(own.files)}
    starts = own.start == name
    for step in _steps(spec.node, own):
        inputs = {port: _joined(name, port, own, places[step], stages, series) for port in spec.node.takes}
        here = {**files, **own.files[step]} if starts else files
        result.append(Task(f"{name}/{step}", name, step, spec.node, inputs, here))
    return result


def _own_files(spec: StageSpec) -> dict[str, Path]:
    given = {name: getattr(spec.node, name) for name in sorted(file_fields(type(spec.node)))}
    return {f"{name}_path": spec.folder / value for name, value in given.items() if value is not None}


def _joined(
    name: str,
    port_name: str,
    own: _Series | None,
    place: int | None,
    stages: Mapping[str, StageSpec],
    series: Mapping[str, _Series | None],
) -> TaskInput:
    """The task, or tasks, that one port is joined to, at one place in the series of its stage."""
    spec = stages[name]
    port: Port = spec.node.takes[port_name]
    source = name if port.own else spec.inputs.get(port_name)
    if source is None:
        return None
    steps: Collection[str] = _steps(stages[source].node, series[source])
    if port.at is At.ALL:
        return tuple((step, f"{source}/{step}") for step in steps) if series[source] else ((source, source),)
    if series[source] is None:
        return source
    step = _step_taken(port.at, own, place, tuple(steps))
    if place is None and port.at is not At.FIRST:
        _fail(name, spec, f"runs once, so input '{port_name}' cannot follow the steps of '{source}'")
    if step is None or (port.own and place is not None and own is not None and step == tuple(own.files)[place]):
        return None
    return f"{source}/{step}"


def _step_taken(at: At, own: _Series | None, place: int | None, steps: tuple[str, ...]) -> str | None:
    """Name of the step that a port takes, None where the producer has none there."""
    if at is At.FIRST:
        return steps[0] if steps else None
    if own is None or place is None:
        return None
    wanted = place - 1 if at is At.PREVIOUS else place
    names = tuple(own.files)
    return names[wanted] if wanted >= 0 and names[wanted] in steps else None
