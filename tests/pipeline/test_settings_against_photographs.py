"""Settings that the photographs rule out: refused by ``plan``, with their places, before anything runs."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from dicflow.errors import ConfigurationError
from dicflow.pipeline import Pipeline

TEXT = """\
dicflow: 1
stages:
  photos: {stage: images, left: "left/*", right: "right/*"}
  boards: {stage: images, left: "left/*", right: "right/*"}
  corners: {stage: corners, images: boards, size: [9, 6]}
  rig:
    stage: calibrate
    square: 10 mm
    LEAVE_OUT
  refined: {stage: refine, images: photos, REFINE}
  region: {stage: region, images: photos, rectangle: [5, 5, 50, 40]}
  correlation:
    stage: correlate
    images: photos
    CORRELATE
  stereo: {stage: stereo, images: photos}
  points: {stage: triangulate}
  total: {stage: deformation, points: points, window: 20 px}
  rest:
    stage: noise_floor
    STILL
"""
USUAL = {
    "LEAVE_OUT": "leave_out: {step_1: {left: [[1, 1]]}}",
    "REFINE": "subset_size: 31",
    "CORRELATE": "subset_size: 21",
    "STILL": "still: [step_2, step_4]",
}


@pytest.fixture(scope="module")
def photographs(tmp_path_factory):
    """Of two cameras, 60 × 48 px, four steps."""
    folder = tmp_path_factory.mktemp("photographs")
    rng = np.random.default_rng(3)
    for step in range(1, 5):
        for side in ("left", "right"):
            (folder / side).mkdir(exist_ok=True)
            Image.fromarray(rng.integers(0, 255, (48, 60), dtype=np.uint8)).save(folder / side / f"step_{step}.png")
    return folder


def plan(photographs, tmp_path, **changed):
    text = TEXT
    for word, line in {**USUAL, **changed}.items():
        text = text.replace(word, line)
    (tmp_path / "p.yaml").write_text(text)
    return Pipeline.load(tmp_path / "p.yaml", data=photographs, store=tmp_path / "store").plan()


def test_settings_that_fit_are_planned(photographs, tmp_path):
    assert plan(photographs, tmp_path).counts["run"] == 8


@pytest.mark.parametrize(
    ("changed", "place", "message"),
    [
        ({"STILL": "still: [step_2, stp_3]"}, "21:5: rest.still", "'stp_3' is none of the 3 steps step_2 … step_4"),
        ({"STILL": "still: [step_1]"}, "21:5: rest.still", "'step_1' is none of the 3 steps"),
        (
            {"LEAVE_OUT": "leave_out: {step_9: {left: [[1, 1]]}}"},
            "9:5: rig.leave_out",
            "'step_9' is none of the 4 steps step_1 … step_4, did you mean 'step_",
        ),
        (
            {"CORRELATE": "subset_size: 9999"},
            "15:5: correlation.subset_size",
            "a subset of 9999 px does not fit into the photographs of 60 × 48 px",
        ),
        ({"CORRELATE": "subset_size: 49"}, "15:5: correlation.subset_size", "a subset of 49 px does not fit"),
        ({"REFINE": "subset_size: 61"}, "10:44: refined.subset_size", "a subset of 61 px does not fit"),
    ],
)
def test_a_setting_that_does_not_fit_is_refused_with_its_place(photographs, tmp_path, changed, place, message):
    with pytest.raises(ConfigurationError) as caught:
        plan(photographs, tmp_path, **changed)
    (line,) = str(caught.value).splitlines()
    assert f"p.yaml:{place}: {message}" in line


def test_all_settings_that_do_not_fit_are_listed(photographs, tmp_path):
    with pytest.raises(ConfigurationError) as caught:
        plan(photographs, tmp_path, STILL="still: [sstep_3]", CORRELATE="subset_size: 301")
    first, second = str(caught.value).splitlines()
    assert "correlation.subset_size" in first
    assert second.endswith("did you mean 'step_3'?")
