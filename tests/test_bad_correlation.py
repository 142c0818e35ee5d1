"""Photographs and settings that subset correlation cannot use, through the command line: one message, no traceback."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from small import dicflow
from test_bad_input import repaint

PIPELINE = """
dicflow: 1
stages:
  photos: {stage: images, left: "photos/left/*.png", right: "photos/right/*.png"}
  boards: {stage: images, left: "boards/left/*.png", right: "boards/right/*.png"}
  corners: {stage: corners, images: boards, size: [9, 6]}
  rig: {stage: calibrate, square: 14.5 mm}
  region: {stage: region, images: photos, file: region.geojson}
  correlation: {stage: correlate, images: photos, subset_size: 21, step_size: 10}
  stereo: {stage: stereo, images: photos}
  points: {stage: triangulate}
"""


@pytest.fixture
def data(pipeline, tmp_path):
    """The experiment's folder, to be spoilt."""
    folder = tmp_path / "data"
    shutil.copytree(pipeline.parent, folder, ignore=shutil.ignore_patterns(".dicflow", "results"))
    (folder / "pipeline.yaml").write_text(PIPELINE)
    return folder


@pytest.fixture
def run(data, measured, tmp_path):
    """Runs the pipeline in that folder, on a copy of a store that holds the boards."""
    store = shutil.copytree(measured, tmp_path / "store")

    def command(*settings):
        given = (data / "pipeline.yaml", "--store", store, "--output", tmp_path / "o", "--scheduler", "sync")
        words = [word for setting in settings for word in ("--set", setting)]
        return dicflow("run", *given, "--workers", 1, "--json", *words)

    return command


def overexpose(folder, steps="*"):
    for path in folder.glob(f"step_{steps}.png"):
        repaint(path, lambda grey: np.clip(3.0 * grey, 0, 255).astype(np.uint8))


def test_the_pipeline_runs_when_nothing_is_spoilt(run):
    assert run().code == 0


@pytest.mark.parametrize(("side", "stage"), [("left", "correlation"), ("right", "stereo")])
def test_overexposed_photographs(run, data, side, stage):
    overexpose(data / "photos" / side)
    answer = run()
    answer.refuses(1, f"{stage}/step_00: ", f"overexposed in the first {side} photograph", "reduce the exposure")
    assert answer.line["stages"][stage]["failed"] == 1
    assert answer.line["stages"]["points"]["computed"] == 0


def test_an_overexposed_later_step_is_in_the_report(run, data, tmp_path):
    overexpose(data / "photos" / "left", "02")
    assert run().code == 0
    page = next((tmp_path / "o").rglob("report.html")).read_text()
    assert "The left photographs of 1 of 3 steps are overexposed in more than" in page


def test_photographs_of_left_and_right_exchanged(run, data):
    photos = data / "photos"
    (photos / "left").rename(photos / "other")
    (photos / "right").rename(photos / "left")
    (photos / "other").rename(photos / "right")
    answer = run()
    answer.refuses(1, "stereo/step_00: left and right photographs look swapped", "; exchange left and right")
    assert answer.line["stages"]["stereo"]["failed"] == 1


def test_a_subset_larger_than_the_region(run):
    run("correlation.subset_size=301").refuses(
        1, "correlation/step_00: no subset of 301 px has 40% of its pixels inside the region", "take a subset_size of"
    )


def test_a_subset_with_fewer_than_three_speckles(run):
    run("correlation.subset_size=5").refuses(
        1, "correlation/step_00: a subset of 5 px holds fewer than 3 speckles of", "px or more"
    )
