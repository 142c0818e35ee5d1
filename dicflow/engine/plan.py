"""The plan: for every task whether its product is there, and if not, why not.

All keys are resolved in the main process, from digests alone; no array is read and no numerics are loaded.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, Literal

from dicflow.engine.files import Stamp, stamp
from dicflow.engine.fingerprint import Fingerprint, Sources, changed_names
from dicflow.engine.graph import Graph, Task, TaskInput
from dicflow.engine.hashing import plain
from dicflow.engine.journal import latest
from dicflow.engine.keys import Change, differences, input_digests, key_of, key_parts, parameters
from dicflow.engine.node import Node
from dicflow.engine.records import Record
from dicflow.engine.references import Recipe, Ref, RefInput
from dicflow.engine.store import Store

__all__ = ["CodePolicy", "FileStamp", "Plan", "PlanEntry", "code_changes", "code_warning", "find_hit", "make_plan"]

CodePolicy = Literal["recompute", "warn", "ignore"]
"""What to do with a result that other code has made, though its ``impl_version`` is the same."""

_MOST_NAMES = 5
"""So many definitions are named as changed; of more, their number is given."""


@dataclass(frozen=True)
class FileStamp:
    """The contents of a file, and how to see that it is still the same."""

    digest: str
    stamp: Stamp


@dataclass(frozen=True)
class PlanEntry:
    """What is planned for one task.

    state : "hit": its product is there; "run": it must run; "pending": known once those before it have run
    changes : why it must run, against the last time
    key, parts : once all its inputs are known
    ref : the product of a hit
    """

    task: Task
    state: Literal["hit", "run", "pending"]
    changes: tuple[Change, ...] = ()
    key: str | None = None
    parts: Mapping[str, Any] | None = None
    ref: Ref | None = None
    waits_for: tuple[str, ...] = ()

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


def make_plan(graph: Graph, store: Store, *, pipeline: str = "", code_policy: CodePolicy = "recompute") -> Plan:
    """Look at all files, resolve all keys, and find what is there.

    pipeline : name under which its last run is looked up, for the reasons
    Raises InputError for a file that cannot be used, before anything has run.
    """
    _check_files(graph, store)
    planner = _Planner(graph, store, pipeline, code_policy)
    for task in graph.tasks.values():
        planner.add(task)
    store.files.save()
    return planner.plan


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
    """Goes through the tasks in order and keeps what the next ones need."""

    def __init__(self, graph: Graph, store: Store, pipeline: str, policy: CodePolicy) -> None:
        self.store = store
        self.policy = policy
        self.last = latest(store, pipeline)
        self.entries: dict[str, PlanEntry] = {}
        self.files: dict[str, dict[str, FileStamp]] = {}
        values = {name: parameters(spec.node) for name, spec in graph.stages.items()}
        sources = Sources(store.files)
        code = {name: sources.fingerprint(type(spec.node), spec.node.uses()) for name, spec in graph.stages.items()}
        self.plan = Plan(graph, self.entries, values, code, self.files, policy)

    def add(self, task: Task) -> None:
        files = {name: self._stamped(path) for name, path in task.files.items()}
        self.files[task.name] = files
        waits_for = tuple(name for name in task.producers() if self.entries[name].state != "hit")
        if waits_for:
            self.entries[task.name] = PlanEntry(task, "pending", waits_for=waits_for)
            return
        inputs = {port: self._refs(source) for port, source in task.inputs.items()}
        digests = {name: file.digest for name, file in files.items()}
        parts = key_parts(task.node, self.plan.parameters[task.stage], input_digests(inputs), digests)
        self.entries[task.name] = self._known(task, key_of(parts), parts, inputs)

    def _stamped(self, path: Path) -> FileStamp:
        before = stamp(path)  # first: of a file that changes meanwhile the stamp then no longer fits
        return FileStamp(self.store.files.digest(path), before)

    def _known(self, task: Task, key: str, parts: dict[str, Any], inputs: dict[str, RefInput]) -> PlanEntry:
        code = self.plan.code[task.stage]
        record, kept, against = find_hit(self.store, key, code, self.policy)
        if record is None or against:
            return PlanEntry(task, "run", against or self._reasons(task, key, parts), key, parts)
        warning = code_warning(self.store, task.stage, record, code, self.policy)
        if warning and warning not in self.plan.warnings:
            self.plan.warnings.append(warning)
        ref = Ref(record.digest, None if kept else Recipe(task.name, task.node, inputs, task.files))
        return PlanEntry(task, "hit", (), key, parts, ref)

    def _reasons(self, task: Task, key: str, parts: dict[str, Any]) -> tuple[Change, ...]:
        last = self.last.get(task.name)
        if last is None:
            return (Change("record", "not made before"),)
        record = self.store.record(last["key"]) if last["key"] != key else None
        if record is None:
            return (Change("record", "its record is no longer in the store"),)
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


def _check_files(graph: Graph, store: Store) -> None:
    """Let every stage look at its files, one by one and together.

    Most of the time goes into unpacking photographs, which threads do side by side.
    """
    paths: dict[str, dict[Path, None]] = {}
    for task in graph.tasks.values():
        if task.files:
            paths.setdefault(task.stage, {}).update(dict.fromkeys(task.files.values()))
    with ThreadPoolExecutor() as threads:
        for name, found in paths.items():
            node = graph.stages[name].node
            purpose = f"check:{node.stage}:{node.impl_version}"
            fact = partial(store.files.fact, purpose=purpose, find=partial(_facts, node))
            facts = dict(zip(found, threads.map(fact, found), strict=True))
            inputs = {port: graph.steps[source] for port, source in graph.stages[name].inputs.items()}
            node.agree(facts, graph.files.get(name, {}), inputs)


def _facts(node: Node, path: Path) -> Any:
    return plain(node.check(path))
