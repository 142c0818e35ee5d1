"""Where the time of a process goes: all that passes between two marks belongs to one phase, so that phases add up."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from dicflow.engine.processes import called_cpu_s

__all__ = ["Phases", "Spent", "children_cpu_s"]


class Spent(NamedTuple):
    """Wall time, processor time of this process, and that of calls in worker processes [s]."""

    wall_s: float
    cpu_s: float
    workers_s: float

    def since(self, before: Spent) -> Spent:
        """The time between two readings."""
        return Spent(*(now - then for now, then in zip(self, before, strict=True)))


class Phases:
    """The phases of this process, from its start on."""

    def __init__(self) -> None:
        self._readings: dict[str, Spent] = {}
        self._start = Spent(time.perf_counter() - _age_s(), 0.0, 0.0)

    def end(self, phase: str) -> None:
        """All since the end of the phase before belongs to this phase, which ends once."""
        self._readings.setdefault(phase, Spent(time.perf_counter(), time.process_time(), called_cpu_s()))

    @property
    def spent(self) -> Mapping[str, Spent]:
        """Phase → its time, in their order."""
        readings = [self._start, *self._readings.values()]
        return {
            name: after.since(before)
            for name, before, after in zip(self._readings, readings[:-1], readings[1:], strict=True)
        }


def children_cpu_s() -> float:
    """Processor time of all processes that this one has started and seen end [s]; 0 where the system keeps none."""
    times = os.times()
    return times.children_user + times.children_system


def _age_s() -> float:
    """Time since this process started [s]; where the system does not say it, the processor time since then."""
    if sys.platform == "linux":
        with suppress(OSError, ValueError, IndexError):
            ticks = int(Path("/proc/self/stat").read_text().rpartition(")")[2].split()[19])
            return time.clock_gettime(time.CLOCK_BOOTTIME) - ticks / os.sysconf("SC_CLK_TCK")
    return time.process_time()
