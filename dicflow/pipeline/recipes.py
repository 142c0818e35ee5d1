"""Products of a run that were not kept, with the recipes by which they are made again: read from the run's records."""

from __future__ import annotations

from functools import cache
from typing import Any

from dicflow.engine.fingerprint import Fingerprint, fingerprint
from dicflow.engine.journal import RunInfo
from dicflow.engine.node import Node
from dicflow.engine.references import Recipe, Ref, RefInput
from dicflow.engine.store import Store
from dicflow.pipeline.registry import node_class

__all__ = ["run_refs"]


def run_refs(store: Store, run: RunInfo) -> dict[str, Ref]:
    """Task → product of everything that a run found or made.

    What was not kept can be made again from what was, as long as the code is the same and no photograph is needed:
    records know files by their contents, not by their places. Else its reference has no recipe.
    """
    index = run.index
    owners = {entry["digest"]: (task, entry["key"]) for task, entry in index.items()}

    @cache
    def code(stage: type[Node]) -> Fingerprint:
        return fingerprint(stage, store.files)

    @cache
    def ref(digest: str) -> Ref:
        manifest = store.manifest(digest)
        if manifest is None or manifest.kept or digest not in owners:
            return Ref(digest)
        task, key = owners[digest]
        record = store.record(key)
        if record is None or record.parts["files"]:
            return Ref(digest)
        stage = node_class(record.parts["stage"])
        if record.code != code(stage):
            return Ref(digest)
        inputs = {port: source(value) for port, value in record.parts["inputs"].items()}
        return Ref(digest, Recipe(task, stage(**record.parts["parameters"]), inputs, {}))

    def source(value: Any) -> RefInput:
        return ref(value) if isinstance(value, str) else tuple((step, ref(digest)) for step, digest in value)

    return {task: ref(entry["digest"]) for task, entry in index.items()}
