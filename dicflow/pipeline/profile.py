"""Where the time of a run goes."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from dicflow.engine.execute import RunResult
from dicflow.engine.phases import Phases, Spent, children_cpu_s

__all__ = ["TASKS", "Share", "shares"]

TASKS = "tasks"
"""The phase in which the tasks are done."""


class Share(NamedTuple):
    """A part of the time.

    tasks : number of tasks that were computed in it
    wall_s : time that passed [s]; None for parts of the phase ``tasks``, which go on at once
    cpu_s : processor time of all processes [s]
    """

    name: str
    tasks: int | None
    wall_s: float | None
    cpu_s: float


def shares(phases: Phases, outcome: RunResult) -> list[Share]:
    """The parts of the time: the phases, those of the tasks in detail, and the worker processes' starts and ends.

    Worker processes must have ended. The processor times add up to that of this process and its workers.
    """
    found: list[Share] = []
    spent = phases.spent
    for name, phase in spent.items():
        if name == TASKS:
            found.append(Share(name, None, phase.wall_s, 0.0))
            found += _of_tasks(phase, outcome)
        else:
            found.append(Share(name, None, phase.wall_s, phase.cpu_s + phase.workers_s))
    around = children_cpu_s() - sum(phase.workers_s for phase in spent.values())
    found.append(Share("workers: start and end", None, None, max(around, 0.0)))
    return found


def _of_tasks(phase: Spent, outcome: RunResult) -> Iterator[Share]:
    """Compiling, the stages, and the engine: reading, hashing, storing and handing out."""
    compiled_s = sum(outcome.compiled_s.values())
    if compiled_s:
        yield Share("  compiling", None, None, compiled_s)
    done = [one for one in outcome.outcomes.values() if one.status == "computed"]
    for stage in dict.fromkeys(one.stage for one in done):
        own = [one.stage_cpu_s for one in done if one.stage == stage]
        yield Share(f"  {stage}", len(own), None, sum(own))
    inside = sum(one.cpu_s - one.stage_cpu_s for one in outcome.outcomes.values())
    all_tasks = sum(one.cpu_s for one in outcome.outcomes.values())
    around = phase.cpu_s + phase.workers_s - all_tasks - compiled_s  # tasks elsewhere took none of this machine's
    yield Share("  engine", None, None, inside + max(around, 0.0))
