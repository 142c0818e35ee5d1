"""The plan: for every task whether its product is there, and if not, why not.

All keys are resolved in the main process, from digests alone; no array is read and no numerics are loaded.

Of few tasks the records and the files of their products are looked at. Of many, the store's index says what each key
came to, and one listing of the store's folders whether record and product are there; a file that is missing inside a
product is then found when it is read, and the product is made again.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any, Literal, TypeVar

from dicflow.engine.action_index import Action, action_of
from dicflow.engine.file_stamps import FileStamp, FileStamps, file_facts
from dicflow.engine.files import FilePart
from dicflow.engine.fingerprint import Fingerprint, Sources, changed_names, kept_sources
from dicflow.engine.graph import Graph, Task, TaskInput
from dicflow.engine.journal import Entry, Event, latest
from dicflow.engine.keys import Change, differences, input_digests, key_maker, key_parts, parameters
from dicflow.engine.node import At, Scope
from dicflow.engine.problems import Facts, check_parameters
from dicflow.engine.records import Record
from dicflow.engine.references import Recipe, Ref, RefInput
from dicflow.engine.store import Store

__all__ = ["CodePolicy", "Plan", "PlanEntry", "code_changes", "code_warning", "find_hit", "make_plan"]

CodePolicy = Literal["recompute", "warn", "ignore"]
"""What to do with a result that other code has made, though its ``impl_version`` is the same."""

_MOST_NAMES = 5
"""So many definitions are named as changed; of more, their number is given."""

_MANY = 2000
"""Tasks of a plan above which the store's index is read, and progress is reported."""
_MANY_FILES = 100
"""Files above which progress is reported."""
_REPORTS = 100
"""Reports of progress in one pass."""

T = TypeVar("T")


@dataclass(frozen=True, slots=True)
class PlanEntry:
    """What is planned for one task.

    state : "hit": its product is there; "run": it must run; "pending": known once those before it have run
    changes : why it must run, against the last time
    key : once all its inputs are known
    ref : the product of a hit
    warnings : of the product of a hit
    """

    task: Task
    state: Literal["hit", "run", "pending"]
    changes: tuple[Change, ...] = ()
    key: str | None = None
    ref: Ref | None = None
    waits_for: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()

    @property
    def reason(self) -> str:
        """One line that says why."""
        if self.state == "hit":
            return "stored"
        if self.state == "pending":
            more = f" and {len(self.waits_for) - 1} more" if len(self.waits_for) > 1 else ""
            return f"waits for {self.waits_for[0]}{more}"
        return "; ".join(change.text for change in self.changes)


@dataclass(frozen=True)
class Plan:
    """The plan of a run.

    entries : task → entry, in the graph's order
    parameters : stage → its parameters as they enter keys
    code : stage → fingerprint of its code
    files : argument of a task's ``run`` → contents, by task
    """

    graph: Graph
    entries: Mapping[str, PlanEntry]
    parameters: Mapping[str, Mapping[str, Any]]
    code: Mapping[str, Fingerprint]
    files: Mapping[str, Mapping[str, FileStamp]]
    code_policy: CodePolicy
    warnings: list[str] = field(default_factory=list)

    @property
    def counts(self) -> dict[str, int]:
        """How many tasks are hit, run and pending."""
        found = Counter(entry.state for entry in self.entries.values())
        return {state: found[state] for state in ("hit", "run", "pending")}

    def by_stage(self) -> dict[str, dict[str, int]]:
        """The same for each stage."""
        found = {stage: {"hit": 0, "run": 0, "pending": 0} for stage in self.graph.stages}
        for entry in self.entries.values():
            found[entry.task.stage][entry.state] += 1
        return found

    def why(self, name: str) -> list[Change]:
        """Why a task must run: its own reasons, or for a pending one those of the tasks it waits for in the end."""
        seen: set[str] = set()
        waiting, found = [name], []
        while waiting:
            entry = self.entries[waiting.pop(0)]
            if entry.task.name in seen:
                continue
            seen.add(entry.task.name)
            found += [change for change in entry.changes if change not in found]
            waiting += entry.waits_for
        return found


def make_plan(
    graph: Graph,
    store: Store,
    *,
    pipeline: str = "",
    code_policy: CodePolicy = "recompute",
    every_file: bool = False,
    on_event: Callable[[Event], None] | None = None,
) -> Plan:
    """Look at all files, resolve all keys, and find what is there.

    pipeline : name under which its last run is looked up, for the reasons
    every_file : look at the files of every product, however many tasks there are
    on_event : receives an event "checking" now and then, where there are many files or tasks
    Raises InputError for a file that cannot be used, and ConfigurationError for parameters that do not suit the files,
    before anything has run.
    """
    try:
        facts = _check_files(graph, store, on_event)
        check_parameters(graph, facts)
        planner = _Planner(graph, store, pipeline, code_policy, not every_file and len(graph.tasks) > _MANY)
        for task in _reported("tasks", graph.tasks.values(), len(graph.tasks), _MANY, on_event):
            planner.add(task)
    finally:
        store.files.save()  # also where a file is refused: the others need not be looked at again
    store.index.append(planner.unindexed)
    planner.plan.warnings.extend([*_left_out(graph), *_single_steps(graph)])
    return planner.plan


def _left_out(graph: Graph) -> Iterator[str]:
    """What each series of steps says of files that are not in it."""
    for series, steps in graph.files.items():
        spec = graph.stages[series]
        if spec.only:
            continue
        yield from (f"{series}: {sentence}" for sentence in spec.node.left_out(spec.folder, steps))


def _single_steps(graph: Graph) -> Iterator[str]:
    """A warning for each series of one step of which stages need an earlier one."""
    for series in graph.files:
        steps = graph.steps[series]
        alike = {name for name, found in graph.steps.items() if found == steps}
        comparing = [name for name in graph.stages if alike & _compared(graph, name)]
        if len(steps) == 1 and comparing:
            yield f"{series} has one step only, with which {', '.join(comparing)} cannot compare; add the other steps"


def _compared(graph: Graph, name: str) -> set[str]:
    """The stages whose first or previous step a stage compares with a later one."""
    spec = graph.stages[name]
    if spec.node.scope not in (Scope.STEP, Scope.PAIR):
        return set()
    earlier = [port for port, declared in spec.node.takes.items() if declared.at in (At.PREVIOUS, At.FIRST)]
    return {spec.inputs[port] for port in earlier if port in spec.inputs}


def find_hit(
    store: Store, key: str, code: Fingerprint, policy: CodePolicy
) -> tuple[Record | None, bool, tuple[Change, ...]]:
    """The record of a key, whether its product is there, and the reasons that speak against using it."""
    record = store.record(key)
    if record is None:
        return None, False, ()
    changed = code_changes(store, record, code)
    if changed and policy == "recompute":
        return record, False, changed
    state, manifest = store.inspect(record.digest)
    if manifest is None:
        return record, False, (Change("object", f"the stored product is {state}"),)
    return record, manifest.kept, ()


def code_changes(store: Store, record: Record, code: Fingerprint) -> tuple[Change, ...]:
    """The definitions whose code is not what made a record; one change without a name where that is unknown.

    code : its parts may be missing; the store knows them then
    """
    if record.code == code.root:
        return ()
    names = changed_names(store.code_parts(record.code), code.parts or store.code_parts(code.root))
    if len(names) > _MOST_NAMES:
        names[_MOST_NAMES:] = [f"{len(names) - _MOST_NAMES} more definitions"]
    return tuple(Change("code", name) for name in names or [""])


def code_warning(store: Store, stage: str, record: Record, code: Fingerprint, policy: CodePolicy) -> str:
    """Message about a result that other code has made and that is used, "" where the policy asks for nothing."""
    changes = code_changes(store, record, code)
    if policy != "warn" or not changes:
        return ""
    return f"{stage}: {'; '.join(change.text for change in changes)} since its results were made; they are used"


class _Planner:
    """Goes through the tasks in order and keeps what the next ones need.

    unindexed : key and action of every hit that the index did not know
    """

    def __init__(self, graph: Graph, store: Store, pipeline: str, policy: CodePolicy, by_index: bool) -> None:
        self.store = store
        self.policy = policy
        self.pipeline = pipeline
        self.entries: dict[str, PlanEntry] = {}
        self.files: dict[str, Mapping[str, FileStamp]] = {}
        self.unindexed: list[tuple[str, Action]] = []
        self.stamps = FileStamps(store)
        self.indexed = store.index.present(store.path) if by_index else None
        values = {name: parameters(spec.node) for name, spec in graph.stages.items()}
        sources = Sources(kept_sources() or store.files)
        code = {name: sources.fingerprint(type(spec.node), spec.node.uses()) for name, spec in graph.stages.items()}
        sources.save()
        self.keys = {
            (name, is_look): key_maker(spec.node, values[name], is_look)
            for name, spec in graph.stages.items()
            for is_look in (False, True)
        }
        self.plan = Plan(graph, self.entries, values, code, self.files, policy)

    @cached_property
    def last(self) -> dict[str, Entry]:
        """What each task came to in the last run; read where a task must run, since only reasons need it."""
        return latest(self.store, self.pipeline)

    def add(self, task: Task) -> None:
        files = self.stamps.of(task)
        self.files[task.name] = files
        waits_for = tuple(name for name in task.producers() if self.entries[name].state != "hit")
        if waits_for:
            self.entries[task.name] = PlanEntry(task, "pending", waits_for=waits_for)
            return
        inputs = {port: self._refs(source) for port, source in task.inputs.items()}
        digests = {name: file.digest for name, file in files.items()}
        key = self.keys[task.stage, task.is_look](input_digests(inputs), digests)
        self.entries[task.name] = self._indexed(task, key, inputs) or self._found(task, key, inputs, digests)

    def _indexed(self, task: Task, key: str, inputs: dict[str, RefInput]) -> PlanEntry | None:
        """A hit by the index; None where only the record can tell."""
        action = self.indexed.get(key) if self.indexed is not None else None
        if action is None or (self.policy != "ignore" and action.code != self.plan.code[task.stage].root):
            return None
        record = self.store.record(key) if action.warned else None
        return self._hit(task, key, action.digest, action.kept, inputs, record.warnings if record else ())

    def _found(self, task: Task, key: str, inputs: dict[str, RefInput], files: dict[str, str]) -> PlanEntry:
        """A hit by its record and files, or a task that must run."""
        code = self.plan.code[task.stage]
        record, kept, against = find_hit(self.store, key, code, self.policy)
        if record is None or against:
            changes = against or self._reasons(task, key, inputs, files)
            return PlanEntry(task, "run", changes, key)
        self._note(key, record)
        warning = code_warning(self.store, task.stage, record, code, self.policy)
        if warning and warning not in self.plan.warnings:
            self.plan.warnings.append(warning)
        return self._hit(task, key, record.digest, kept, inputs, record.warnings)

    @staticmethod
    def _hit(
        task: Task, key: str, digest: str, kept: bool, inputs: dict[str, RefInput], warnings: tuple[str, ...]
    ) -> PlanEntry:
        ref = Ref(digest, None if kept else Recipe(task.name, task.node, inputs, task.files))
        return PlanEntry(task, "hit", (), key, ref, (), warnings)

    def _note(self, key: str, record: Record) -> None:
        """Remember a hit that the index should have known."""
        if self.indexed is None or not record.code:
            return
        manifest = self.store.manifest(record.digest)
        if manifest is not None and self.indexed.get(key) != (action := action_of(record, manifest)):
            self.unindexed.append((key, action))

    def _reasons(self, task: Task, key: str, inputs: dict[str, RefInput], files: dict[str, str]) -> tuple[Change, ...]:
        last = self.last.get(task.name)
        if last is None:
            return (Change("record", "not made before"),)
        record = self.store.record(last["key"]) if last["key"] != key else None
        if record is None:
            return (Change("record", "its record is no longer in the store"),)
        parts = key_parts(task.node, self.plan.parameters[task.stage], input_digests(inputs), files, task.is_look)
        return tuple(differences(record.parts, parts)) or (Change("record", "made with another key"),)

    def _refs(self, source: TaskInput) -> RefInput:
        if source is None:
            return None
        if isinstance(source, str):
            return self._ref(source)
        return tuple((step, self._ref(name)) for step, name in source)

    def _ref(self, name: str) -> Ref:
        ref = self.entries[name].ref
        assert ref is not None, "every producer is a hit here"
        return ref


def _check_files(graph: Graph, store: Store, on_event: Callable[[Event], None] | None) -> dict[str, Facts]:
    """Let every stage look at its files, one by one and together; returns what each stage found in each file.

    Most of the time goes into unpacking photographs, which threads do side by side.
    """
    paths: dict[str, dict[Path | FilePart, None]] = {}
    facts: dict[str, Facts] = {}
    for task in graph.tasks.values():
        if task.files:
            paths.setdefault(task.stage, {}).update(dict.fromkeys(task.files.values()))
    with ThreadPoolExecutor() as threads:
        for name, found in paths.items():
            node = graph.stages[name].node
            looked = threads.map(partial(file_facts, store, node), found)
            looked = _reported("files", looked, len(found), _MANY_FILES, on_event)
            facts[name] = dict(zip(found, looked, strict=True))
            inputs = {port: graph.steps[source] for port, source in graph.stages[name].inputs.items()}
            node.agree(facts[name], graph.files.get(name, {}), inputs)
    return facts


def _reported(
    what: str, items: Iterable[T], count: int, many: int, on_event: Callable[[Event], None] | None
) -> Iterator[T]:
    """The items, with an event "checking" each time that a hundredth of them is done; none up to ``many`` items."""
    every = max(count // _REPORTS, 1)
    for done, item in enumerate(items, start=1):
        yield item
        if on_event is not None and count > many and done % every == 0:
            on_event(Event("checking", text=what, counts={"done": done, "all": count}))
