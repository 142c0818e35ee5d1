"""How long tasks may take, by those that have ended."""

from __future__ import annotations

from collections import defaultdict
from statistics import fmean

from dicflow.engine.graph import Task
from dicflow.engine.work import Outcome

__all__ = ["Durations"]


class Durations:
    """A task may take as long as others of its stage, times how long others of its step took beside those of theirs."""

    def __init__(self) -> None:
        self._of_stage: dict[str, list[float]] = defaultdict(list)
        self._of_step: dict[str | None, list[tuple[str, float]]] = defaultdict(list)

    def add(self, outcome: Outcome) -> None:
        """Count a task that was computed."""
        if outcome.status == "computed":
            self._of_stage[outcome.stage].append(outcome.stage_s)
            self._of_step[outcome.step].append((outcome.stage, outcome.stage_s))

    def expected_s(self, task: Task) -> float:
        """Time that a task may take [s]; 0 where none of its stage has ended."""
        if task.stage not in self._of_stage:
            return 0.0
        taken = sum(seconds for _, seconds in self._of_step[task.step])
        usual = sum(fmean(self._of_stage[stage]) for stage, _ in self._of_step[task.step])
        return fmean(self._of_stage[task.stage]) * (taken / usual if usual > 0.0 else 1.0)
