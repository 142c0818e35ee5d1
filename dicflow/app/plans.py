"""What a run would compute, why, and how long that takes by the times of earlier runs."""

from __future__ import annotations

import os
import threading
from collections import Counter, defaultdict
from statistics import mean
from typing import Any

from dicflow.engine.journal import latest
from dicflow.engine.plan import Plan
from dicflow.pipeline import Pipeline

__all__ = ["plan_of"]

_SAMPLES = 5
"""Tasks of a stage whose recorded times are looked at."""
_MOST_REASONS = 4
_at_work = threading.Lock()
"""One plan at a time: that of thousands of steps takes hundreds of megabytes, and two at once are no faster."""


def plan_of(pipeline: Pipeline) -> dict[str, Any]:
    """The plan of a run, as ``dicflow plan`` makes it.

    ``stages``: name → hit, run and pending, ``reasons`` each with how often it holds, and ``seconds`` of one task in
    earlier runs (None if unknown); ``counts``; ``warnings``; ``seconds``: processor time of what is missing, None if a
    stage has no recorded time; ``workers``: that a run would use.
    """
    with _at_work:
        return _described(pipeline, pipeline.plan())


def _described(pipeline: Pipeline, plan: Plan) -> dict[str, Any]:
    """The plan for the page."""
    back = {instance: name for names in pipeline.instances for name, instance in names.items()}
    reasons = _reasons(plan)
    times = {stage: _task_seconds(pipeline, plan, stage) for stage in plan.graph.stages}
    stages = {
        stage: {**counts, "name": back[stage], "reasons": reasons[stage], "seconds": times[stage]}
        for stage, counts in plan.by_stage().items()
    }
    missing = {stage: one["run"] + one["pending"] for stage, one in plan.by_stage().items()}
    known = [times[stage] is not None for stage, count in missing.items() if count]
    total = sum(count * (times[stage] or 0.0) for stage, count in missing.items())
    return {
        "stages": stages,
        "counts": plan.counts,
        "warnings": plan.warnings,
        "seconds": total if all(known) else None,
        "workers": os.cpu_count() or 1,
    }


def _reasons(plan: Plan) -> dict[str, list[list[Any]]]:
    """Stage → its most frequent reasons, each with its number of tasks."""
    found: dict[str, Counter[str]] = defaultdict(Counter)
    for entry in plan.entries.values():
        if entry.state != "hit":
            found[entry.task.stage][entry.reason] += 1
    return defaultdict(list, {stage: [list(one) for one in c.most_common(_MOST_REASONS)] for stage, c in found.items()})


def _task_seconds(pipeline: Pipeline, plan: Plan, stage: str) -> float | None:
    """Mean time of a stage's tasks in the last run; None if unknown [s]."""
    last = _last_run(pipeline)
    names = [task.name for task in plan.graph.tasks_of(stage) if task.name in last]
    chosen = names[:: max(1, len(names) // _SAMPLES)][:_SAMPLES]
    records = (pipeline.store.record(last[name]["key"]) for name in chosen)
    found = [float(one.made["stage_s"]) for one in records if one is not None and "stage_s" in one.made]
    return mean(found) if found else None


def _last_run(pipeline: Pipeline) -> dict[str, Any]:
    return latest(pipeline.store, pipeline.name)
