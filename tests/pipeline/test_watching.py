"""A folder that is watched: products equal to those of a run afterwards, whatever came half, late or twice."""

from __future__ import annotations

import re
import time

import cv2
import pytest

from dicflow.errors import InputError
from dicflow.pipeline import Pipeline
from dicflow.pipeline.arrivals import Arrivals
from dicflow.pipeline.watching import Watch
from tests.fed_folder import STRAIN, feed, pairs, watched, write_pipeline
from tests.small import dicflow

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

    def act():
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
    _, measured, notes = watched(pipeline, lambda: None, 6)
    assert [one.step[-1] for one in measured] == list("051234")
    assert notes == ["6 steps are not measured yet: the newest is measured first, then the others",
                     "all steps are measured"]  # fmt: skip


@pytest.mark.slow
def test_a_folder_that_vanishes_is_waited_for(tmp_path):
    pipeline = write_pipeline(tmp_path)
    first, second, third = pairs(tmp_path, 3)
    feed([*first, *second])

    def act():
        time.sleep(2.0)
        (tmp_path / "left").rename(tmp_path / "away")
        time.sleep(2.5)
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


def test_photographs_of_another_size_are_in_no_step(tmp_path):
    pipeline = write_pipeline(tmp_path)
    first, second = pairs(tmp_path, 2)
    feed([*first, *second])
    small = cv2.imencode(".png", cv2.imread(str(second[0].path), 0)[:100])[1].tobytes()
    feed([second[0]._replace(content=small)])
    loaded = Pipeline.load(pipeline)
    arrivals = Arrivals(loaded.store)
    specs = {name: loaded.stages[name] for name in loaded.searched}
    arrivals.look(specs)
    time.sleep(0.25)
    assert list(arrivals.look(specs)["photos"]) == ["left_000"]
    assert "120 × 100" in arrivals.waiting[str(second[0].path)]
    assert dicflow("plan", pipeline).code == 2
