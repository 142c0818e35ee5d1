"""A run whose graph grows: what is as it was stays, and the products are those of an ordinary run."""

from __future__ import annotations

import json
from typing import Any, ClassVar, Literal

import pytest
from toys import Difference, Read, Rig, Scale, Total, chain, field, numbers, run_sync, write

from dicflow.engine.execute import Options
from dicflow.engine.graph import StageSpec, expand
from dicflow.engine.growing import GrowingRun
from dicflow.engine.journal import runs
from dicflow.engine.node import At, Node, Port, Scope
from dicflow.engine.store import Store

pytestmark = pytest.mark.slow


class Early(Node):
    """Once: the sum of a few early numbers."""

    title: ClassVar = "early"
    scope: ClassVar = Scope.TEST
    gives: ClassVar = "number"
    takes: ClassVar = {"numbers": Port("number", at=At.EARLY, optional=True)}
    stage: Literal["early"] = "early"

    def run(self, numbers: Any) -> Any:
        """The sum."""
        return field("number", sum(one["values"] for one in numbers or ()))


def stages(folder):
    return {
        "read": StageSpec(Read(), {}, folder),
        "scale": StageSpec(Scale(), {"number": "read"}, folder),
        "difference": StageSpec(Difference(), {"before": "scale", "now": "scale"}),
        "total": StageSpec(Total(), {"difference": "difference", "first": "read"}),
        "early": StageSpec(Early(), {"numbers": "read"}),
    }


@pytest.fixture
def growing(store):
    """A run in one worker, with which several graphs are measured."""
    with GrowingRun(store, "toys", {}, Options(workers=1)) as run:
        yield run


def measure(growing, graph):
    """Grow, do everything; returns the names of the tasks that had to be done."""
    growing.grow(graph, {})
    left = [name for name in graph.tasks if name not in growing.outcomes]
    growing.compute(graph.tasks)
    return left


def digests(outcomes):
    return {name: outcome.ref.digest for name, outcome in outcomes.items()}


def as_run(graph, folder):
    return digests(run_sync(graph, Store.open(folder)).outcomes)


def test_a_step_at_the_end_is_measured_alone(growing, tmp_path):
    folder = numbers(tmp_path / "files", 4)
    measure(growing, expand(stages(folder)))
    before = dict(growing.outcomes)
    write(folder / "step_05.txt", "50")
    graph = expand(stages(folder))
    own = {f"{stage}/step_05" for stage in ("read", "scale", "difference", "total")}
    assert set(measure(growing, graph)) == own | {"early"}  # the fourth after the first is one of the early ones
    write(folder / "step_06.txt", "7")
    graph = expand(stages(folder))
    assert set(measure(growing, graph)) == {name.replace("5", "6") for name in own}
    assert all(growing.outcomes[name] is before[name] for name in before if name != "early")
    assert digests(growing.outcomes) == as_run(graph, tmp_path / "other")


def test_a_step_in_between_changes_what_comes_after_it(growing, tmp_path):
    folder = numbers(tmp_path / "files", 4)
    (folder / "step_02.txt").unlink()
    measure(growing, expand(stages(folder)))
    write(folder / "step_02.txt", "20")
    graph = expand(stages(folder))
    again = {"difference/step_03", "total/step_03", "total/step_04", "early"}
    new = {f"{stage}/step_02" for stage in ("read", "scale", "difference", "total")}
    assert set(measure(growing, graph)) == new | again
    assert digests(growing.outcomes) == as_run(graph, tmp_path / "other")


def test_a_replaced_file_and_one_with_a_new_time(growing, tmp_path):
    folder = numbers(tmp_path / "files", 3)
    measure(growing, expand(stages(folder)))
    write(folder / "step_03.txt", "3", age_s=20.0)
    assert measure(growing, expand(stages(folder))) == []
    write(folder / "step_02.txt", "9")
    graph = expand(stages(folder))
    assert {"read/step_02", "scale/step_02", "difference/step_03"} <= set(measure(growing, graph))
    assert digests(growing.outcomes) == as_run(graph, tmp_path / "other")


def test_what_is_not_asked_for_is_not_done(growing, tmp_path):
    graph = expand({**stages(numbers(tmp_path / "files", 4)), "rig": StageSpec(Rig(), {"numbers": "read"})})
    growing.grow(graph, {})
    growing.compute(["difference/step_03"])
    assert set(growing.outcomes) == {
        "read/step_02", "read/step_03", "scale/step_02", "scale/step_03", "difference/step_03"
    }  # fmt: skip


def test_a_failed_step_stops_no_other_and_is_not_tried_again(growing, tmp_path):
    folder = numbers(tmp_path / "files", 2)
    bad = {"read": StageSpec(Read(), {}, folder), "scale": StageSpec(Scale(table="t.csv"), {"number": "read"}, folder)}
    write(folder / "t.csv", "no number")
    measure(growing, expand(bad))
    assert [one.status for one in growing.outcomes.values()].count("failed") == 2
    assert measure(growing, expand(bad)) == []


@pytest.mark.parametrize("lost", ["scale/step_02", "total/step_03"])
def test_what_turns_out_damaged_is_made_again_and_holds_up_no_later_step(growing, store, tmp_path, lost):
    folder = numbers(tmp_path / "files", 3)
    spoil(store, run_sync(chain(folder, keep="always"), store).outcomes[lost].ref.digest)
    for step in "45":
        write(folder / f"step_0{step}.txt", step)
        graph = chain(folder, keep="always")
        measure(growing, graph)
        assert [one.error for one in growing.outcomes.values() if one.error] == []
    assert digests(growing.outcomes) == as_run(graph, tmp_path / "other")


def spoil(store, digest):
    """Make zeros of the arrays of a product."""
    for chunk in store.object_path(digest).glob("*/c*"):
        chunk.write_bytes(bytes(chunk.stat().st_size))


def test_the_journal_names_all_steps(store, tmp_path):
    folder = numbers(tmp_path / "files", 2)
    with GrowingRun(store, "toys", {}, Options(workers=1)) as growing:
        measure(growing, expand(stages(folder)))
        write(folder / "step_03.txt", "3")
        graph = expand(stages(folder))
        growing.grow(graph, {"steps": {"read": list(graph.steps["read"])}})
        growing.compute(graph.tasks)
        (found,) = runs(store)
        assert found.result is None
        assert found.resolved == {"steps": {"read": ["step_01", "step_02", "step_03"]}}
        assert set(found.index) == set(graph.tasks)
    assert runs(store)[0].result == {
        "counts": {"hit": 0, "computed": len(graph.tasks), "failed": 0, "skipped": 0}, "interrupted": False
    }  # fmt: skip


def test_a_run_that_waits_shows_that_it_lives(store, tmp_path, monkeypatch):
    monkeypatch.setattr("dicflow.engine.growing._SIGN_OF_LIFE_S", -1.0)
    with GrowingRun(store, "toys", {}, Options(workers=1)) as growing:
        growing.show_life()
        measure(growing, expand(stages(numbers(tmp_path / "files", 2))))
        growing.show_life()
    assert [event.kind for event in runs(store)[0].events()][-1] == "checking"


def test_a_run_that_ends_before_all_is_done_counts_as_interrupted(store, tmp_path):
    graph = expand(stages(numbers(tmp_path / "files", 2)))
    with GrowingRun(store, "toys", {}, Options(workers=1)) as growing:
        growing.grow(graph, {})
        growing.compute(["read/step_01"])
    assert runs(store)[0].result["interrupted"]


def test_code_that_cannot_be_compiled_ahead_ends_no_run(store):
    said = []
    pieces = {"read": {"one": json.loads, "other": json.loads}}
    options = Options(workers=1, uncompiled=lambda nodes: pieces, on_event=said.append)
    with GrowingRun(store, "toys", {}, options) as growing:
        growing.compile_ahead(lambda: len(said) < 1)
        assert [(event.kind, event.stage) for event in said] == [("compiling", "read")]
