"""Compiling before the first task of a stage, and runs that are too short for worker processes."""

from __future__ import annotations

import threading
from functools import partial

import pytest
from test_execute import trouble
from toys import chain, run_sync

from dicflow.engine import processes
from dicflow.engine.compilation import Uncompiled
from dicflow.engine.execute import Options, run
from dicflow.engine.expectation import expected_cpu_s
from dicflow.engine.plan import make_plan


class Calls:
    """Functions that compile a stage, and the events of a run, in their order."""

    def __init__(self, *stages):
        self.stages = stages
        self.seen = []

    def options(self, workers, **more):
        return Options(scheduler="threads", workers=workers, uncompiled=self.uncompiled, on_event=self.on_event, **more)

    def uncompiled(self, nodes):
        return {stage: {stage: partial(self.compile, stage)} for stage in self.stages if stage in nodes}

    def compile(self, stage):
        self.seen.append(f"compile {stage}")

    def on_event(self, event):
        if event.kind in ("compiling", "compiled", "finished"):
            self.seen.append(f"{event.kind} {event.task or event.stage}")


@pytest.mark.parametrize("workers", [1, 2])
def test_a_stage_is_compiled_once_before_its_first_task(folder, store, workers):
    calls = Calls("scale", "total")
    result = run(chain(folder), store, options=calls.options(workers))
    assert result.ok
    for stage in ("scale", "total"):
        assert calls.seen.count(f"compile {stage}") == 1
        first = min(i for i, seen in enumerate(calls.seen) if seen.startswith(f"finished {stage}/"))
        order = [calls.seen.index(f"{word} {stage}") for word in ("compiling", "compile", "compiled")]
        assert [*order, first] == sorted([*order, first])
    assert set(result.compiled_s) == {"scale", "total"}


@pytest.mark.parametrize("workers", [1, 2])
def test_pieces_that_stages_share_are_compiled_once(folder, store, workers):
    calls = Calls()
    pieces = {"scale": ["loops", "sums"], "total": ["sums", "ends"]}
    uncompiled = {stage: {name: partial(calls.compile, name) for name in names} for stage, names in pieces.items()}
    options = Options("threads", workers, uncompiled=lambda _: uncompiled, on_event=calls.on_event)
    result = run(chain(folder), store, options=options)
    assert result.ok
    assert [seen for seen in calls.seen if seen.startswith("compile ")] == [
        f"compile {n}" for n in ("loops", "sums", "ends")
    ]
    for stage, names in pieces.items():
        first = min(i for i, seen in enumerate(calls.seen) if seen.startswith(f"finished {stage}/"))
        assert all(calls.seen.index(f"compile {name}") < first for name in names)
    assert set(result.compiled_s) == {"scale", "total"}


def test_a_stage_waits_until_all_its_pieces_are_compiled():
    uncompiled = Uncompiled({"a": {"x": print, "y": print}, "b": {"y": print}, "c": {}})
    assert [stage in uncompiled for stage in "abc"] == [True, True, False]
    assert [taken and taken[:2] for taken in (uncompiled.take(), uncompiled.take("b"), uncompiled.take())] == [
        ("x", "a"), ("y", "a"), None,
    ]  # fmt: skip
    assert uncompiled.done("y") == ["b"]
    assert uncompiled.done("x") == ["a"]
    assert "a" not in uncompiled


def test_of_what_is_given_up_the_rest_is_still_waited_for():
    uncompiled = Uncompiled({"a": {"x": print}, "b": {"y": print}})
    assert uncompiled.take() == ("x", "a", print)
    assert uncompiled.give_up() == ["b"]
    assert uncompiled.done("x") == ["a"]


def test_other_stages_go_on_while_one_worker_compiles(folder, store):
    """The call ends only after a task of another stage has: without that it would wait for ever."""
    calls, read = Calls("scale"), threading.Event()
    waited = []
    calls.compile = lambda stage: waited.append(read.wait(60.0))

    def on_event(event):
        if event.task == "read/step_06":
            read.set()

    options = Options(scheduler="threads", workers=2, uncompiled=calls.uncompiled, on_event=on_event)
    assert run(chain(folder), store, options=options).ok
    assert waited == [True]


def test_what_cannot_be_compiled_ahead_is_left_to_the_task(folder, store):
    calls = Calls("scale")

    def compile_nothing(stage):
        raise OSError("no space")

    calls.compile = compile_nothing
    assert run(chain(folder), store, options=calls.options(2)).ok


def test_nothing_is_compiled_for_what_is_stored(folder, store):
    run_sync(chain(folder), store)
    calls = Calls("scale")
    assert run(chain(folder), store, options=calls.options(2)).ok
    assert calls.seen == []


def test_after_a_failure_nothing_more_is_compiled(folder, store):
    """The first call ends after the failure, and the second one is not made."""
    calls, ended = Calls(), threading.Event()

    def compile_until_failure(stage):
        calls.compile(stage)
        ended.wait(60.0)

    def on_event(event):
        if event.status == "failed":
            ended.set()

    uncompiled = {stage: {stage: partial(compile_until_failure, stage)} for stage in ("scale", "report")}
    options = Options("threads", 2, uncompiled=lambda _: uncompiled, on_event=on_event)
    assert not run(trouble(folder, "stage"), store, options=options).ok
    assert calls.seen == ["compile scale"]


def test_a_short_run_starts_no_process(folder, store, monkeypatch):
    run_sync(chain(folder, keep="always"), store)
    started = []
    monkeypatch.setattr(processes.WorkerProcesses, "_start", lambda workers: started.append(workers))
    for key in [entry["key"] for name, entry in _last(store).items() if name.startswith("total/")]:
        store.record_path(key).unlink()
    plan = make_plan(chain(folder, keep="always"), store, pipeline="toys")
    assert expected_cpu_s(plan, store, "toys", 1.0) == float("inf"), "of lost records nothing is known"
    run_sync(chain(folder, keep="always"), store)
    for name, entry in _last(store).items():
        if name.startswith("report"):
            store.object_path(entry["digest"]).with_suffix(".json").unlink()
    plan = make_plan(chain(folder, keep="always"), store, pipeline="toys")
    assert plan.counts["hit"] == 23
    assert 0.0 <= expected_cpu_s(plan, store, "toys", 1.0) < 1.0
    result = run(chain(folder, keep="always"), store, pipeline="toys", options=Options(workers=2))
    assert result.ok
    assert started == []


def _last(store):
    from dicflow.engine.journal import latest

    return latest(store, "toys")
