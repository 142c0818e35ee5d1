"""The resolved pipeline that a run keeps, as :meth:`dicflow.pipeline.Pipeline.resolved` describes it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from dicflow.engine.journal import RunInfo
from dicflow.engine.stored_json import anything, fields, is_text, list_of, mapping_of
from dicflow.errors import StoreError

__all__ = ["instances_of", "kept_settings", "resolved_of"]

_STAGE = mapping_of(anything)
_NAMES = mapping_of(is_text)
_RESOLVED = fields(
    {"stages": mapping_of(lambda stage: _STAGE(stage) and _NAMES(stage.get("inputs"))), "variants": list_of(_STAGE)},
    {"title": is_text, "instances": list_of(_NAMES), "steps": mapping_of(list_of(is_text)), "data": is_text},
)


def resolved_of(run: RunInfo) -> dict[str, Any] | None:
    """The resolved pipeline of a run; None if it is unknown."""
    found = run.resolved
    return found if _RESOLVED(found) else None


def kept_settings(run: RunInfo) -> dict[str, Any]:
    """The same of a run that is needed. Raises StoreError if it is unknown."""
    found = resolved_of(run)
    if found is None:
        path = run.folder / "pipeline.json"
        raise StoreError(f"{path}: is damaged, so the settings of this run are unknown; name another run")
    return found


def instances_of(resolved: Mapping[str, Any]) -> list[Mapping[str, str]]:
    """Per variant the stage of the graph for each stage of the file, also of runs that did not keep it."""
    return list(resolved.get("instances") or [{name: name for name in resolved["stages"] if "@" not in name}])
