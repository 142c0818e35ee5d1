"""Where the time of a process goes."""

from __future__ import annotations

import time

import pytest

from dicflow.engine import phases
from dicflow.engine.phases import Phases, Spent
from tests.replaced import replace_here


@pytest.fixture
def clock(monkeypatch):
    """Clocks that the test sets: wall time, processor time, that of calls in workers."""
    now = {"wall": 100.0, "cpu": 0.25, "workers": 0.0}
    monkeypatch.setattr(phases, "_age_s", lambda: 2.0)
    monkeypatch.setattr(phases, "called_cpu_s", lambda: now["workers"])
    replace_here(monkeypatch, time, "perf_counter", lambda: now["wall"])
    replace_here(monkeypatch, time, "process_time", lambda: now["cpu"])
    return now


def test_all_between_two_marks_belongs_to_a_phase(clock):
    found = Phases()
    found.end("start")
    clock.update(wall=103.0, cpu=0.75, workers=5.0)
    found.end("tasks")
    clock.update(wall=104.0, cpu=1.75)
    found.end("report")
    assert found.spent == {
        "start": Spent(2.0, 0.25, 0.0),
        "tasks": Spent(3.0, 0.5, 5.0),
        "report": Spent(1.0, 1.0, 0.0),
    }


def test_the_first_phase_begins_with_the_process():
    """The age grows as the wall clock does, and this process is older than the test."""
    first, start = phases._age_s(), time.perf_counter()
    while time.perf_counter() - start < 0.2:
        pass
    assert phases._age_s() - first >= 0.1
    assert first > 0.0
