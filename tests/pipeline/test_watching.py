"""A folder that is watched: products equal to those of a run afterwards, also of what came half, late or twice."""

from __future__ import annotations

import io
import os
import re
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import cv2
import psutil
import pytest

from dicflow.cli.watch import _print_step, _say_link
from dicflow.engine.processes import WorkerLost
from dicflow.errors import InputError
from dicflow.pipeline import Pipeline
from dicflow.pipeline.arrivals import Arrivals
from dicflow.pipeline.watching import Watch
from tests.fed_folder import STRAIN, feed, pairs, watched, write_pipeline
from tests.small import dicflow
from tests.waiting import PATIENCE_S, started, until

STEPS = 8


def digests(result):
    return {name: ref.digest for name, ref in result.refs.items()}


def afterwards(pipeline, store):
    """The products of a run in another store."""
    return digests(Pipeline.load(pipeline, store=store).run(scheduler="sync", workers=1))


@pytest.fixture(scope="module")
def fed(tmp_path_factory):
    """What came of eight pairs: one half-written, one late partner, one replaced; and of a ninth, which is cut off."""
    folder = tmp_path_factory.mktemp("watched")
    pipeline = write_pipeline(folder)
    found = pairs(folder, STEPS)
    broken = folder / "left" / "left_099.png"

    def act(*_):
        feed(found[0])
        feed([found[1][0]._replace(after_s=0.3, pause_s=0.5), found[1][1]])
        feed([found[2][0], *found[3], found[2][1]._replace(after_s=1.5)])
        broken.write_bytes(found[4][0].content[:2000])
        (folder / "right" / "right_099.png").write_bytes(found[4][1].content)
        for pair in found[4:7]:
            feed(pair)
        time.sleep(1.0)
        wrong = found[0][0].content
        feed([found[7][0]._replace(content=wrong), found[7][1]])
        time.sleep(1.5)
        feed([found[7][0]])

    result, measured, notes = watched(pipeline, act, STEPS)
    broken.unlink()
    (folder / "right" / "right_099.png").unlink()
    return pipeline, result, measured, notes


@pytest.mark.slow
def test_products_are_those_of_a_run_afterwards(fed, tmp_path):
    pipeline, result, *_ = fed
    found = digests(result)
    assert found == afterwards(pipeline, tmp_path / "other")
    assert len([name for name in found if name.startswith("total/")]) == STEPS - 1


@pytest.mark.slow
def test_the_run_at_the_end_computes_what_needs_the_whole_test_alone(fed):
    _, result, *_ = fed
    assert result.outcome.counts == {"hit": len(result.refs) - 1, "computed": 1, "failed": 0, "skipped": 0}
    assert result.outcome.outcomes["probes"].status == "computed"


@pytest.mark.slow
def test_values_of_a_step_are_those_of_the_table(fed):
    """The last word about each step; the strain is that of the speckles."""
    _, result, measured, _ = fed
    last = {one.step: one for one in measured}
    assert set(last) == {f"left_{number:03d}" for number in range(STEPS)}
    table = {row["step"]: row for row in result.product("probes").attrs["rows"]}
    for number in range(1, STEPS):
        (row,) = last[f"left_{number:03d}"].readings
        assert row == table[f"left_{number:03d}"]
        assert row["strain"] == pytest.approx(number * STRAIN, abs=6 * row["sigma_strain"] + 1e-4)
    assert last["left_000"].readings == ()


@pytest.mark.slow
def test_what_cannot_be_read_is_said_once(fed):
    *_, notes = fed
    said = [note for note in notes if "left_099.png" in note]
    assert len(said) == 1
    assert said[0].startswith("waiting: ")


@pytest.mark.slow
def test_the_newest_step_is_measured_first_and_the_others_follow(tmp_path):
    """Six pairs lie there at once; the chain of the correlation goes through all of them for the newest one."""
    pipeline = write_pipeline(tmp_path)
    for pair in pairs(tmp_path, 6):
        feed(pair)
    _, measured, notes = watched(pipeline, lambda *_: None, 6)
    assert [one.step[-1] for one in measured] == list("051234")
    assert notes == ["6 steps are not measured yet: the newest is measured first, then the others",
                     "all steps are measured"]  # fmt: skip


@pytest.mark.slow
def test_a_folder_that_vanishes_is_waited_for(tmp_path):
    pipeline = write_pipeline(tmp_path)
    first, second, third = pairs(tmp_path, 3)
    feed([*first, *second])

    def act(measured, notes):
        until(lambda: len(measured) == 2)
        (tmp_path / "left").rename(tmp_path / "away")
        until(lambda: any("no such folder" in note for note in notes))
        (tmp_path / "away").rename(tmp_path / "left")
        feed(third)

    result, _, notes = watched(pipeline, act, 3)
    assert any(re.search("left: no such folder; it is waited for", note) for note in notes), notes
    assert digests(result) == afterwards(pipeline, tmp_path / "other")


def test_a_watch_without_photographs_says_so(tmp_path):
    pipeline, notes = write_pipeline(tmp_path), []
    watch = Watch(Pipeline.load(pipeline), lambda _: None, notes.append)
    watch.end()
    watch.run()
    with pytest.raises(InputError, match="no step was measured"):
        watch.pipeline_so_far()


def arriving(pipeline):
    """What comes into the folder of a pipeline, and the stages that look for photographs there."""
    loaded = Pipeline.load(pipeline)
    return Arrivals(loaded.store), {name: loaded.stages[name] for name in loaded.searched}


def test_photographs_of_another_size_are_in_no_step(tmp_path):
    pipeline = write_pipeline(tmp_path)
    first, second = pairs(tmp_path, 2)
    feed([*first, *second])
    small = cv2.imencode(".png", cv2.imread(str(second[0].path), 0)[:100])[1].tobytes()
    feed([second[0]._replace(content=small)])
    arrivals, specs = arriving(pipeline)
    arrivals.look(specs)
    time.sleep(0.25)
    assert list(arrivals.look(specs)["photos"]) == ["left_000"]
    assert "120 × 100" in arrivals.waiting[str(second[0].path)]
    assert dicflow("plan", pipeline).code == 2


def looking(pipeline):
    """What looks at the photographs of a pipeline, and a function that looks."""
    arrivals, specs = arriving(pipeline)
    return lambda: list(arrivals.look(specs)["photos"])


def test_a_photograph_that_is_deleted_and_written_anew_is_in_no_step_before_it_rests(tmp_path):
    pipeline, found = write_pipeline(tmp_path), pairs(tmp_path, 3)
    for pair in found:
        feed(pair)
    look, (path, content, *_) = looking(pipeline), found[2][0]
    look()
    time.sleep(0.25)
    assert look() == ["left_000", "left_001", "left_002"]
    path.unlink()
    assert look() == ["left_000", "left_001"]
    path.write_bytes(content[:2000])
    assert look() == ["left_000", "left_001"]


def test_what_fits_is_not_compared_again_because_of_a_photograph_that_does_not(tmp_path):
    compared = []

    def agree(facts, steps, inputs):
        compared.append(len(steps))
        if len(set(facts.values())) > 1:
            raise InputError("another size")

    spec = SimpleNamespace(node=SimpleNamespace(agree=agree))
    steps = {f"{n}": {"left": Path(f"{n}.png")} for n in range(50)}
    facts = {own["left"]: 1 for own in steps.values()} | {Path("20.png"): 2}
    arrivals = Arrivals(Pipeline.load(write_pipeline(tmp_path)).store)
    fitting = {step: own for step, own in steps.items() if step != "20"}
    assert arrivals._agreeing("photos", spec, steps, facts) == fitting
    assert arrivals.waiting == {"20.png": "another size"}
    compared.clear()
    assert arrivals._agreeing("photos", spec, steps, facts) == fitting
    assert compared == [50, 49, 50]


def test_nothing_is_read_while_a_known_photograph_is_written_again(tmp_path):
    pipeline, growing = write_pipeline(tmp_path), Refusing()
    first, second = pairs(tmp_path, 2)
    feed(first)
    watch = Watch(Pipeline.load(pipeline), lambda _: None, lambda _: None)
    watch._look(growing)
    time.sleep(0.25)
    assert watch._look(growing)
    grown = growing.grown
    feed(second)
    first[0].path.write_bytes(second[0].content[:2000])
    assert not watch._look(growing)
    assert growing.grown == grown
    first[0].path.write_bytes(second[0].content)
    assert not watch._look(growing)
    time.sleep(0.25)
    assert watch._look(growing)
    assert growing.grown > grown


def test_a_photograph_whose_partner_stays_away_is_named_after_a_while(tmp_path, monkeypatch):
    pipeline, (first, second) = write_pipeline(tmp_path), pairs(tmp_path, 2)
    feed([*first, second[0]])
    arrivals, specs = arriving(pipeline)
    arrivals.look(specs)
    time.sleep(0.25)
    assert list(arrivals.look(specs)["photos"]) == ["left_000"]
    assert arrivals.alone == []
    monkeypatch.setattr("dicflow.pipeline.arrivals._LATE_S", 0.2)
    arrivals.look(specs)
    (said,) = arrivals.alone
    assert "1 photograph has no partner" in said
    assert "left left_001.png" in said
    feed(second[1:])
    arrivals.look(specs)
    time.sleep(0.25)
    assert list(arrivals.look(specs)["photos"]) == ["left_000", "left_001"]
    assert arrivals.alone == []


def test_lines_of_a_sweep_name_the_variant(tmp_path, capsys):
    settings = ["total.window=30 px,50 px", "total.measure=engineering,green_lagrange"]
    watch = Watch(Pipeline.load(write_pipeline(tmp_path), settings=settings), lambda _: None, lambda _: None)
    watch._found, watch._arrivals.age = {"photos": {"step": {}}}, lambda files: 1.0
    growing = SimpleNamespace(
        outcomes={}, ref=lambda name: name, call=lambda *_: [{"probe": "gauge", "strain": 0.0123456, "u_strain": 1e-4}]
    )
    _print_step(watch._measured(growing, "photos", "step", []))
    assert capsys.readouterr().out == (
        "step: window 30 px, measure engineering gauge strain 0.01235 ± 0.00010, "
        "window 30 px, measure green_lagrange gauge strain 0.01235 ± 0.00010, "
        "window 50 px, measure engineering gauge strain 0.01235 ± 0.00010, "
        "window 50 px, measure green_lagrange gauge strain 0.01235 ± 0.00010 (1.0 s after the photograph)\n"
    )
    assert watch._variant("photos") == watch._variant("correlation") == {}


class Refusing:
    """A run under way that may refuse to grow."""

    def __init__(self):
        self.tasks, self.refuses, self.grown = {"one": None}, False, 0

    def grow(self, graph, resolved):
        if self.refuses:
            raise InputError("region.geojson: cannot be read")
        self.grown += 1


def test_a_replaced_photograph_counts_although_another_file_cannot_be_read_at_that_moment(tmp_path):
    pipeline, growing = write_pipeline(tmp_path), Refusing()
    first, second = pairs(tmp_path, 2)
    feed(first)
    watch = Watch(Pipeline.load(pipeline), lambda _: None, lambda _: None)

    def look_twice():
        watch._look(growing)
        time.sleep(0.25)
        watch._look(growing)

    look_twice()
    before = growing.grown
    feed([first[0]._replace(content=second[0].content)])
    growing.refuses = True
    look_twice()
    growing.refuses = False
    watch._look(growing)
    watch._look(growing)
    assert growing.grown == before + 1


@pytest.mark.parametrize(
    ("error", "words"), [(WorkerLost(), "out of memory"), (ZeroDivisionError("zero"), "ZeroDivisionError: zero")]
)
def test_values_that_cannot_be_read_are_a_problem_of_their_step_alone(tmp_path, error, words):
    watch = Watch(Pipeline.load(write_pipeline(tmp_path)), lambda _: None, lambda _: None)
    watch._found = {"photos": {"step": {}}}
    watch._arrivals.age = lambda files: 0.0

    def call(*arguments):
        raise error

    growing = SimpleNamespace(outcomes={}, ref=lambda name: name, call=call)
    (problem,) = watch._measured(growing, "photos", "step", []).problems
    assert problem.startswith("probes: ")
    assert words in problem


@pytest.mark.parametrize(("line", "code", "words"), [("", 2, "did not start"), ("http://x\n", 0, "open http://x#")])
def test_a_page_is_announced_or_missed(capsys, line, code, words):
    _say_link(SimpleNamespace(stdout=io.StringIO(line), wait=lambda: code))
    assert words in capsys.readouterr().err


@pytest.mark.skipif(os.name == "nt", reason="needs SIGKILL")
def test_a_page_ends_with_the_watch_however_that_ends(tmp_path):
    pytest.importorskip("tornado")
    code = (
        "import sys, time; from dicflow.pipeline import Pipeline; from dicflow.cli.watch import _page_of\n"
        "with _page_of(Pipeline.load(sys.argv[1])): time.sleep(600)"
    )
    with started([sys.executable, "-c", code, write_pipeline(tmp_path)]) as watch:
        (page,) = until(psutil.Process(watch.pid).children)
    assert psutil.wait_procs([page], timeout=PATIENCE_S)[1] == []


def test_a_page_that_the_end_of_the_watch_ends_is_not_missed(capsys):
    _say_link(SimpleNamespace(stdout=io.StringIO(""), wait=lambda: -15))
    assert capsys.readouterr().err == ""
