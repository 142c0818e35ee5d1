"""Jobs in the order in which they can begin; at the end of a run, those with most behind them first, and long ones.

So the workers have something to do until the last product.
"""

from __future__ import annotations

import heapq
from collections.abc import Container, Iterator, Mapping
from functools import partial

from dicflow.engine.durations import Durations
from dicflow.engine.work import Job, Outcome

__all__ = ["JobQueue"]

_AHEAD = 2000
"""So many jobs may wait for a producer while jobs after them begin; a chained stage may be so far behind the others."""
_END = 32
"""With so many jobs left the end of the run is near."""
_NEXT = 8
"""So many of the jobs that can begin may overtake one another."""
_NEARLY_AS_LONG = 2
"""A chain of jobs shorter by so many tasks than the longest one."""
_STAGE = "stage "
"""Before the name of a stage that is waited for; no task's name begins so."""


class JobQueue:
    """Takes jobs one by one and gives those that can begin, the first ones first, until the end is near.

    jobs : every job after those it takes from
    outcomes : of all tasks that have ended
    begun : tasks under way whose successors in a chain can be given, although they have no outcome
    held : stages whose jobs cannot begin until :meth:`release_stage`
    """

    def __init__(
        self,
        jobs: Iterator[Job],
        outcomes: Mapping[str, Outcome],
        begun: Container[str] = (),
        held: Container[str] = (),
    ) -> None:
        self._jobs = enumerate(jobs)
        self._outcomes = outcomes
        self._begun = begun
        self._held = held
        self._ready: list[tuple[int, Job]] = []
        self._waiting: dict[str, list[tuple[int, Job]]] = {}
        self._waiting_count = 0
        self._durations = Durations()

    def pop(self, free: int = 0) -> tuple[int, Job] | None:
        """Rank and job of the first that can begin; None where none can before another task ends.

        free : id of a process; of the next jobs one whose input it has in its memory is taken first
        """
        while self._wants_more():
            entry = next(self._jobs, None)
            if entry is None:
                return self._pop_at_the_end(free)
            self._place(entry)
        return self._taken(min(heapq.nsmallest(_NEXT, self._ready), key=partial(self._away, free), default=None))

    def release(self, name: str) -> None:
        """Look again at the jobs that wait for a task that has ended or begun."""
        outcome = self._outcomes.get(name)
        if outcome is not None:
            self._durations.add(outcome)
        entries = self._waiting.pop(name, [])
        self._waiting_count -= len(entries)
        for entry in entries:
            self._place(entry)

    def release_stage(self, stage: str) -> None:
        """Look again at the jobs of a stage that is no longer held."""
        self.release(_STAGE + stage)

    def waiting(self) -> list[tuple[int, Job]]:
        """Rank and job of all that wait for a producer."""
        return [entry for entries in self._waiting.values() for entry in entries]

    def _wants_more(self) -> bool:
        """Whether to look at another job, for one that can begin or for the end."""
        left = len(self._ready) + self._waiting_count
        return self._waiting_count < _AHEAD and (not self._ready or left < _END)

    def _pop_at_the_end(self, free: int) -> tuple[int, Job] | None:
        """Of the jobs that can begin the one with most behind it, one after the other; of equal ones the longest."""
        behind = {entry[0]: self._behind(entry[1]) for entry in self._ready}
        near = [entry for entry in self._ready if behind[entry[0]] >= max(behind.values()) - _NEARLY_AS_LONG]

        def order(entry: tuple[int, Job]) -> tuple[bool, int, float, int]:
            rank, job = entry
            return self._away(free, entry)[0], -behind[rank], -self._durations.expected_s(job.task), rank

        return self._taken(min(near, key=order, default=None))

    def _away(self, free: int, entry: tuple[int, Job]) -> tuple[bool, int]:
        """Whether no input of a job is in the memory of a process, and its rank."""
        return free == 0 or free not in entry[1].workers(self._outcomes)[:1], entry[0]

    def _taken(self, entry: tuple[int, Job] | None) -> tuple[int, Job] | None:
        if entry is not None:
            self._ready.remove(entry)
            heapq.heapify(self._ready)
        return entry

    def _behind(self, job: Job) -> int:
        """Length of the longest chain of jobs that wait for this one."""
        waiting = self._waiting.get(job.task.name, [])
        return max((1 + self._behind(other) for _, other in waiting), default=0)

    def _place(self, entry: tuple[int, Job]) -> None:
        missing = self._missing(entry[1])
        if missing is None:
            heapq.heappush(self._ready, entry)
        else:
            self._waiting.setdefault(missing, []).append(entry)
            self._waiting_count += 1

    def _missing(self, job: Job) -> str | None:
        """The first producer that keeps a job from beginning, or its stage."""
        chained = [job.task.inputs[port] for port, declared in job.task.node.takes.items() if declared.own]
        for name in job.awaited():
            if name not in self._outcomes and not (name in chained and name in self._begun):
                return name
        return _STAGE + job.task.stage if job.task.stage in self._held else None
