"""What a run will cost, by what its tasks cost before."""

from __future__ import annotations

import math

from dicflow.engine.journal import latest
from dicflow.engine.plan import Plan
from dicflow.engine.store import Store

__all__ = ["expected_cpu_s"]


def expected_cpu_s(plan: Plan, store: Store, pipeline: str, limit_s: float) -> float:
    """Processor time of the missing tasks in the last run of a pipeline, altogether [s].

    Infinite where that is not known of one of them, or where it is beyond the limit.
    """
    total, last = 0.0, latest(store, pipeline)
    for name, entry in plan.entries.items():
        if entry.state != "hit":
            record = store.record(last[name]["key"]) if name in last else None
            total += math.inf if record is None else record.made.get("stage_cpu_s", math.inf)
            if total > limit_s:
                return math.inf
    return total
