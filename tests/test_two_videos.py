"""Two videos of a test, from init to the extensometer's strain, with exact truth."""

import json

import numpy as np
import pytest

from dicflow.core.synthetic.trace import material_at
from dicflow.io.configuration import parse
from dicflow.kinds.images import Images
from dicflow.kinds.probes import ProbeTable
from dicflow.pipeline.pipeline import Pipeline
from tests.small import dicflow
from tests.video_scene import LENGTH, film, write_boards, write_videos, write_videos_of_boards

pytestmark = pytest.mark.slow

OFFSET, RATES, FRAMES = 0.37, (16.0, 15.5), (320, 310)
EVERY = 37
"""One of so many pairs is measured here."""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with two videos and photographs of a board."""
    folder, scene = tmp_path_factory.mktemp("videos"), film(OFFSET)
    write_videos(folder, scene, FRAMES, RATES)
    write_boards(folder, scene)
    return folder


@pytest.fixture(scope="module")
def measured(folder):
    """The pipeline file of ``init``, run for a few of the frames."""
    assert dicflow("init", folder, "--square", "4.5 mm").code == 0
    path = folder / "pipeline.yaml"
    photos = parse(path.read_text(), "pipeline.yaml").data["stages"]["photos"]
    assert photos == {
        "stage": "images",
        "left": "left.mp4",
        "right": "right.mp4",
        "offset": "auto",
        "select": {"every": 2},
    }
    path.write_text(path.read_text().replace("every: 2", f"every: {EVERY}"))
    assert dicflow("plan", path).code == 0
    return json.loads(dicflow("run", path, "--json").out)


def test_the_clocks_are_joined_within_a_third_of_a_frame(measured):
    sentence = next(one for one in map(str, measured["warnings"]) if "begins" in one)
    offset = float(sentence.split("offset: ")[1].split(" ")[0])
    assert offset == pytest.approx(OFFSET, abs=0.3 / max(RATES))


def test_what_remains_between_the_frames_of_a_pair_is_said(measured):
    text = " ".join(map(str, measured["warnings"]))
    assert "left.mp4 (19.94 s, 16 frames/s) and right.mp4 (19.94 s, 15.5 frames/s) give" in text
    assert "ms apart" in text


def test_the_strain_of_the_extensometer(folder, measured):
    result, scene = Pipeline.load(folder / "pipeline.yaml").result(), film(OFFSET)
    times = [Images.read(result.product("photos", step)).time for step in result.steps("photos")]
    material = material_at(scene.stand.rig.left, scene.state(times[0]), _ends(folder), start=(0.0, LENGTH / 2.0))
    truth = [scene.strain(time, times[0], material) for time in times]
    probes = ProbeTable.read(result.product("probes"))
    found = probes.of_extensometer("along_load", "strain")
    assert truth[-1] > 0.045
    np.testing.assert_allclose(found, truth, atol=0.002 * 0.5)


def _ends(folder):
    """Ends of the extensometer in the first photograph [px]."""
    stages = parse((folder / "pipeline.yaml").read_text(), "pipeline.yaml").data["stages"]
    return np.array(stages["probes"]["extensometers"]["along_load"], dtype=float)


def test_boards_in_videos_are_recognised_and_the_sharpest_frames_used(tmp_path):
    scene = film(OFFSET)
    write_videos(tmp_path, scene, (60, 50), RATES)
    (tmp_path / "boards").mkdir()
    write_videos_of_boards(tmp_path / "boards", scene, 8, RATES)
    assert dicflow("init", tmp_path, "--square", "4.5 mm").code == 0
    stages = parse((tmp_path / "pipeline.yaml").read_text(), "pipeline.yaml").data["stages"]
    assert stages["boards"]["select"] == {"sharpest": 30}
    assert stages["corners"]["size"] == [8, 5]
    path = tmp_path / "pipeline.yaml"
    assert len(Pipeline.load(path).graph.steps["boards"]) <= 30
