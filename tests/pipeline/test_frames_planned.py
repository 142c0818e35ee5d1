"""Frames of a video in the plan: a key by the whole file and the frame's number, found without decoding."""

import numpy as np
import pytest

from dicflow.io.images import video_stream
from dicflow.pipeline import Pipeline
from tests.io.test_videos import DARKEST, STEP, Counting, pictures
from tests.video_scene import write_video

PIPELINE = 'dicflow: 1\nstages:\n  photos: {stage: images, left: "*.mp4", keep: always}\n'
COUNT = 40


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "p.yaml").write_text(PIPELINE)
    write_video(tmp_path / "a.mp4", pictures(COUNT), 30.0)
    return tmp_path


@pytest.fixture
def counts(monkeypatch):
    """Calls of the captures that decode, by name."""
    found, start = {}, video_stream.start
    monkeypatch.setattr(video_stream, "start", lambda path: Counting(start(path), found))
    return found


def states(folder):
    return {entry.state for entry in Pipeline.load(folder / "p.yaml").plan().entries.values()}


def test_a_plan_decodes_nothing_and_a_run_each_frame_once(folder, counts):
    assert states(folder) == {"run"}
    assert not counts
    result = Pipeline.load(folder / "p.yaml").run(scheduler="sync")
    assert counts["grab"] == COUNT
    levels = [result.product("photos", step)["left"][20:, 8:24].mean() for step in result.steps("photos")]
    np.testing.assert_allclose(levels, DARKEST + STEP * (np.arange(COUNT) % 12), atol=4.0)


def test_known_frames_are_hits_also_in_another_selection(folder, counts):
    Pipeline.load(folder / "p.yaml").run(scheduler="sync")
    assert states(folder) == {"hit"}
    (folder / "p.yaml").write_text(PIPELINE.replace("keep", "select: {from: 3, every: 4}, reference: 7, keep"))
    assert states(folder) == {"hit"}
    assert counts["grab"] == COUNT


def test_another_video_of_this_name_is_read_again(folder):
    Pipeline.load(folder / "p.yaml").run(scheduler="sync")
    write_video(folder / "a.mp4", list(pictures(COUNT))[::-1], 30.0)
    assert states(folder) == {"run"}


def test_a_video_that_goes_on_with_the_same_frames_gives_the_same_products(folder):
    """So that what follows them is not measured again."""
    before = Pipeline.load(folder / "p.yaml").run(scheduler="sync")
    write_video(folder / "a.mp4", pictures(COUNT + 12), 30.0)
    after = Pipeline.load(folder / "p.yaml").run(scheduler="sync")
    for step in before.steps("photos")[:12]:
        assert before.ref("photos", step).digest == after.ref("photos", step).digest
