"""A bar and the time left for the whole run, and a sign of life every two seconds."""

from __future__ import annotations

import io
import time

import pytest
from rich.console import Console

from dicflow.engine.journal import Event
from dicflow.views import progress
from dicflow.views.progress import Progress
from tests.waiting import PATIENCE_S

STAGES = {"photos": {"hit": 1, "run": 1, "pending": 0}, "pair": {"hit": 0, "run": 0, "pending": 4}}


class Clock:
    """A clock that a test sets forward."""

    now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    found = Clock()
    monkeypatch.setattr(progress, "time", found)
    return found


def shown(afterwards=None):
    return Progress(Console(file=io.StringIO()), afterwards)


def finish(one, stage, seconds, status="computed"):
    one.on_event(Event("finished", stage=stage, status=status, seconds=seconds))


def test_the_time_left_follows_what_each_stage_takes(clock):
    """Two workers: 3 s of work in 2 s; then three tasks of 2 s are left, which they do in 4 s."""
    one = shown()
    one.on_event(Event("planned", stages=STAGES))
    assert one._left() is None
    assert one._done() == 0.0
    clock.now += 2.0
    finish(one, "photos", 1.0)
    finish(one, "pair", 2.0)
    assert one._left() == pytest.approx(4.0)
    assert one._done() == pytest.approx(2.0 / 6.0)


def test_a_thread_that_draws_while_a_plan_comes_has_all_stages_or_none(clock):
    one = shown()
    before = one._stages
    one.on_event(Event("planned", stages=STAGES))
    assert before == {}
    assert one._stages.keys() == one._totals.keys() == one._seconds.keys() == STAGES.keys()


def test_what_no_task_has_told_yet_is_taken_for_one_like_the_others(clock):
    one = shown()
    one.on_event(Event("planned", stages=STAGES))
    clock.now += 1.0
    finish(one, "photos", 1.0)
    assert one._left() == pytest.approx(4.0)


def test_pictures_and_report_count_before_and_while_they_are_drawn(clock):
    one = shown({"pictures": 3.0, "report": 5.0})
    one.on_event(Event("planned", stages={"photos": {"hit": 2, "run": 0, "pending": 0}}))
    assert one._left() == pytest.approx(8.0)
    note = one.drawing("pictures")
    note(0, 10)
    clock.now += 1.0
    note(4, 10)
    assert one._left() == pytest.approx(1.5 + 5.0)
    assert one._line().startswith("pictures 4 of 10: ")
    clock.now += 1.5
    note(10, 10)
    one.drawing("report")(9, 9)
    assert one._left() == 0.0
    assert one._done() == 1.0


def test_the_bar_never_goes_back(clock):
    """A stage turns out to be slow."""
    one = shown()
    one.on_event(Event("planned", stages={"quick": {"run": 2}, "slow": {"run": 4}}))
    clock.now += 2.0
    finish(one, "quick", 1.0)
    finish(one, "quick", 1.0)
    assert one._done() == pytest.approx(2.0 / 6.0)
    clock.now += 1.0
    finish(one, "slow", 100.0)
    assert one._left() == pytest.approx(3.0 * 300.0 / 102.0)
    assert one._done() == pytest.approx(2.0 / 6.0)


def test_a_file_gets_a_line_whenever_nothing_else_was_printed_for_a_while(monkeypatch):
    monkeypatch.setattr(progress, "_SILENT_S", 0.05)
    buffer = _Lines()
    with Progress(Console(file=buffer, width=200)) as one:
        one.on_event(Event("checking", text="files", counts={"done": 5, "all": 9000}))
        assert buffer.holds("checking files: 5 of 9,000\n")
        one.on_event(Event("planned", stages=STAGES))
        finish(one, "pair", 1.0)
        assert buffer.holds("pair 1 of 4: ")
    assert not one._ticker.is_alive()
    assert " s left\n" in buffer.getvalue()


class _Lines(io.StringIO):
    """A file that somebody waits for."""

    def holds(self, text):
        """Whether it gets a text soon."""
        end = time.monotonic() + PATIENCE_S
        while text not in self.getvalue() and time.monotonic() < end:
            time.sleep(0.01)
        return text in self.getvalue()


def test_a_terminal_shows_a_bar_that_renews_itself(clock):
    buffer = io.StringIO()
    with Progress(Console(file=buffer, force_terminal=True, width=120), {"report": 6.0}) as one:
        one.on_event(Event("planned", stages={"photos": {"hit": 1, "run": 0, "pending": 0}}))
        clock.now += 2.0
        one._live.refresh()
        assert "25 %" in buffer.getvalue()
        clock.now += 1.0
        one._live.refresh()
    assert "33 % 3 s, about 6 s left" in buffer.getvalue()
    assert "report" in buffer.getvalue()
