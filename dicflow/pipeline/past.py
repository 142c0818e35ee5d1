"""Results of earlier runs, from what the store keeps of them: settings, names of steps, and a product of each task."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from dicflow.engine.graph import Graph, StageSpec, expand
from dicflow.engine.journal import RunInfo
from dicflow.engine.references import Ref
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError, StoreError
from dicflow.io.text import printable
from dicflow.pipeline.recipes import run_refs
from dicflow.pipeline.registry import node_class
from dicflow.pipeline.resolved import instances_of, kept_settings
from dicflow.pipeline.result import Result

__all__ = ["check_steps", "past_result"]


def past_result(store: Store, run: RunInfo, known: Mapping[str, Ref] | None = None) -> Result:
    """The products of an earlier run by the names that its pipeline file had then; nothing is computed.

    known : digest → reference of a product that can be made again from files, which the store does not name
    ``notes`` of the result says which products are gone. Raises StoreError where the settings or the steps of the run
    are unknown, or where other code made it, which has other parameters.
    """
    resolved = kept_settings(run)
    if "steps" not in resolved:
        raise StoreError(f"{run.folder}: does not say which steps the run had; name another run")
    check_steps(store.path, resolved["steps"])
    graph, instances, values = _graph(run, resolved), instances_of(resolved), resolved["variants"] or [{}]
    named = {instance for names in instances for instance in names.values()}
    if len(instances) != len(values) or not graph.stages.keys() >= named:
        raise StoreError(f"{run.folder}: its variants do not fit its stages; name another run")
    return Result(graph, store, run_refs(store, run, known), instances, values, None, list(_gone(store, run)))


def _graph(run: RunInfo, resolved: Mapping[str, Any]) -> Graph:
    """The tasks that a run had."""
    try:
        stages = {name: _spec(entry) for name, entry in resolved["stages"].items()}
        starts = [name for name, spec in stages.items() if spec.node.searches(spec.folder)]
        named = {**dict.fromkeys(starts, ()), **resolved["steps"]}
        return expand(stages, {start: {step: {} for step in steps} for start, steps in named.items()})
    except (ConfigurationError, ValidationError, KeyError) as error:
        raise StoreError(
            f"run {run.id} has stages or parameters that this version of dicflow does not know; open it with the "
            "version that made it, or run its pipeline again"
        ) from error


def _spec(entry: Mapping[str, Any]) -> StageSpec:
    parameters = {name: value for name, value in entry.items() if name != "inputs"}
    return StageSpec(node_class(entry["stage"]).model_validate(parameters), entry["inputs"])


def _gone(store: Store, run: RunInfo) -> Iterator[str]:
    """A sentence for each stage with products that the store no longer has."""
    stages = {task: task.partition("/")[0] for task in run.index}
    made = Counter(stages.values())
    gone = Counter(stages[task] for task, entry in run.index.items() if store.manifest(entry["digest"]) is None)
    for stage, count in gone.items():
        yield f"{count} of {made[stage]} products of '{stage}' of run {run.id} were cleaned up or set aside as damaged."


def check_steps(store: Path, steps: Mapping[str, Sequence[str]]) -> None:
    """Refuse names of steps that a store gives and no photograph can have: files are named after them."""
    for name in itertools.chain.from_iterable(steps.values()):
        if name in ("", "..") or Path(name).name != name:
            problem = f"a run of it names a step '{printable(name)}'"
            raise StoreError(str(store), problem, "do not use this store, or measure again with the photographs")
