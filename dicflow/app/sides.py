"""What can be seen side by side: the files of the folder, and the earlier runs in their store."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Any

from dicflow.app.project import Project
from dicflow.comparison.difference import changes_of
from dicflow.comparison.sides import settings_of
from dicflow.engine.journal import RunInfo, runs
from dicflow.engine.keys import Change, shown
from dicflow.engine.store import Store
from dicflow.errors import ConfigurationError, DicflowError
from dicflow.pipeline import Pipeline
from dicflow.pipeline.registry import node_class
from dicflow.pipeline.resolved import resolved_of

__all__ = ["sides_of"]

_LISTED = 50


def sides_of(project: Project, name: str) -> dict[str, Any]:
    """The sides of a comparison with a pipeline file.

    ``files``: valid pipeline files in the folder, ``file`` and ``title``; ``runs``: of the store, newest first, each
    with ``run``, ``pipeline``, ``started`` and ``changes``: from its settings to those that the file has now, ``name``
    as ``stage.parameter``, ``text`` (before and after), and ``was``, as a run is described; None if they are unknown.
    """
    pipeline = project.pipeline(name)
    return {"files": list(_files(project)), "runs": list(_runs(pipeline))}


def _files(project: Project) -> Iterator[dict[str, str]]:
    for name in project.pipelines():
        with suppress(ConfigurationError):
            yield {"file": name, "title": project.pipeline(name).title}


def _runs(pipeline: Pipeline) -> Iterator[dict[str, Any]]:
    folder = pipeline.store_folder
    if not folder.is_dir():
        return
    store, now = Store.open(folder, create=False), settings_of(pipeline.name, pipeline.resolved(), 0)
    for run in runs(store)[:_LISTED]:
        yield {
            "run": run.id,
            "pipeline": run.pipeline,
            "started": run.started,
            "changes": _changes(run, now),
        }


def _changes(run: RunInfo, now: Mapping[str, Any]) -> list[dict[str, str]] | None:
    """What was changed in the settings since a run; of a sweep, since its first variant."""
    resolved = resolved_of(run)
    if resolved is None:
        return None
    try:
        before = settings_of(run.id, resolved, 0)
    except (DicflowError, KeyError):
        return None
    changes = changes_of(before, now, ("the run", "the file")) or ()
    return [_described(change, _unit(change.name, now)) for change in changes]


def _described(change: Change, unit: str) -> dict[str, str]:
    """A change as the page says it: of the settings, and of a run that had others."""
    if change.what != "parameter":
        return {"name": change.name, "text": change.text, "was": change.text}
    was = f"{change.name} {shown(change.old)}{unit} (now {shown(change.new)}{unit})"
    return {"name": change.name, "text": f"{change.text}{unit}", "was": was}


def _unit(name: str, settings: Mapping[str, Any]) -> str:
    """Unit of a parameter behind its value; empty without one."""
    stage, _, parameter = name.partition(".")
    if stage not in settings:
        return ""
    facts = node_class(settings[stage]["stage"]).model_json_schema()["properties"].get(parameter, {})
    return f" {facts['unit']}" if facts.get("unit") else ""
