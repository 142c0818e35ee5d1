"""Products of a run that were not kept, with the recipes by which they are made again: read from the run's records."""

from __future__ import annotations

from functools import cache
from typing import Any

from dicflow.engine.fingerprint import Fingerprint, fingerprint
from dicflow.engine.journal import RunInfo
from dicflow.engine.node import Node
from dicflow.engine.references import Recipe, Ref, RefInput, refs_in
from dicflow.engine.store import Store
from dicflow.pipeline.registry import node_class

__all__ = ["run_refs"]


def run_refs(store: Store, run: RunInfo) -> dict[str, Ref]:
    """Task → product of everything that a run found or made.

    What was not kept can be made again from what was, as long as the code is the same and no photograph is needed:
    records know files by their contents, not by their places. Else it is lost.
    """
    index = run.index
    owners = {entry["digest"]: (task, entry["key"]) for task, entry in index.items()}

    @cache
    def code(stage: type[Node]) -> Fingerprint:
        return fingerprint(stage, store.files)

    @cache
    def ref(digest: str) -> Ref:
        manifest = store.manifest(digest)
        if manifest is not None and manifest.kept:
            return Ref(digest)
        found = recipe(*owners[digest]) if manifest is not None and digest in owners else None
        return Ref(digest, found, lost=found is None)

    def recipe(task: str, key: str) -> Recipe | None:
        record = store.record(key)
        if record is None or record.parts["files"]:
            return None
        stage = node_class(record.parts["stage"])
        inputs = {port: source(value) for port, value in record.parts["inputs"].items()}
        if record.code != code(stage) or any(one.lost for one in refs_in(inputs)):
            return None
        return Recipe(task, stage(**record.parts["parameters"]), inputs, {})

    def source(value: Any) -> RefInput:
        return ref(value) if isinstance(value, str) else tuple((step, ref(digest)) for step, digest in value)

    return {task: ref(entry["digest"]) for task, entry in index.items()}
