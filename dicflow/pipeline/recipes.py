"""Products of a run that were not kept, with the recipes by which they are made again: read from the run's records."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from typing import Any

from pydantic import ValidationError

from dicflow.engine.fingerprint import Sources, kept_sources
from dicflow.engine.journal import RunInfo
from dicflow.engine.node import Node
from dicflow.engine.records import Record
from dicflow.engine.references import Recipe, Ref, RefInput, refs_in
from dicflow.engine.store import Store
from dicflow.pipeline.registry import node_class

__all__ = ["run_refs"]


def run_refs(store: Store, run: RunInfo, known: Mapping[str, Ref] | None = None) -> dict[str, Ref]:
    """Task → product of everything that a run found or made.

    known : digest → reference of a product that can be made again
    A product that was not kept can be made again from kept ones while the code is unchanged and no photograph is
    needed: records hold the digests of files, not their paths. Otherwise its reference is marked as lost.
    """
    index, known = run.index, known or {}
    sources = Sources(kept_sources() or store.files)
    owners = {entry["digest"]: (task, entry["key"]) for task, entry in index.items()}

    @cache
    def ref(digest: str) -> Ref:
        manifest = store.manifest(digest)
        if manifest is not None and manifest.kept:
            return Ref(digest)
        if manifest is not None and digest in known:
            return known[digest]
        found = recipe(*owners[digest]) if manifest is not None and digest in owners else None
        return Ref(digest, found, lost=found is None)

    def recipe(task: str, key: str) -> Recipe | None:
        record = store.record(key)
        if record is None or record.parts["files"]:
            return None
        node = _same_node(record, sources)
        inputs = {port: source(value) for port, value in record.parts["inputs"].items()}
        if node is None or any(one.lost for one in refs_in(inputs)):
            return None
        return Recipe(task, node, inputs, {})

    def source(value: Any) -> RefInput:
        return ref(value) if isinstance(value, str) else tuple((step, ref(digest)) for step, digest in value)

    return {task: ref(entry["digest"]) for task, entry in index.items()}


def _same_node(record: Record, sources: Sources) -> Node | None:
    """The node that made a record, None if the code has changed."""
    try:
        node = node_class(record.parts["stage"])(**record.parts["parameters"])
    except ValidationError:  # other code knows other parameters
        return None
    return node if sources.fingerprint(type(node), node.uses()).root == record.code else None
