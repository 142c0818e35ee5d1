"""Which photograph a point has left: from the status of the points in each."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image

from dicflow.core.status import Status
from dicflow.explorer.entries import reasons
from dicflow.explorer.fields import field_source
from dicflow.explorer.outside import Outside, status_by_photograph
from dicflow.pipeline import Pipeline

VALID, OUT, LOST = int(Status.VALID), int(Status.OUTSIDE), int(Status.UNTRACKED)


def test_each_photograph_and_the_region_have_a_code_of_their_own():
    """In order: valid, outside the region, left, right, right at the first step, and lost for another reason."""
    status = np.array([[VALID, OUT, OUT, OUT, OUT, LOST]], dtype=np.uint8)
    inside = np.array([[True, False, True, True, True, True]])
    left = np.array([[VALID, OUT, OUT, VALID, VALID, LOST]], dtype=np.uint8)
    right = np.array([[VALID, OUT, OUT, OUT, OUT, LOST]], dtype=np.uint8)
    first = np.array([[VALID, OUT, VALID, VALID, OUT, VALID]], dtype=np.uint8)
    found = status_by_photograph(status, inside, left, right, first)
    assert found.tolist() == [[VALID, OUT, Outside.LEFT, Outside.RIGHT, Outside.FIRST_RIGHT, LOST]]
    assert status.tolist() == [[VALID, OUT, OUT, OUT, OUT, LOST]], "the product is not changed"


def test_one_camera_has_a_left_photograph_alone():
    status, inside = np.array([[OUT, OUT]], dtype=np.uint8), np.array([[True, False]])
    assert status_by_photograph(status, inside, status, None, None).tolist() == [[Outside.LEFT, OUT]]


def test_every_code_has_words_and_a_colour():
    found = {one["code"]: one for one in reasons()}
    assert found[OUT]["label"] == "outside the region"
    assert found[Outside.RIGHT]["label"] == "outside the right photograph"
    assert found[Outside.FIRST_RIGHT]["sentence"].startswith(
        "Its subset reaches beyond the right photograph of the first"
    )
    assert all(one["sentence"].endswith(".") for one in found.values())
    assert all(found[code]["colour"].startswith("#") for code in Outside)
    assert len({found[code]["colour"] for code in found if code}) == len(found) - 2, "left keeps the colour of outside"


@pytest.mark.slow
def test_points_that_move_out_of_the_photograph_say_which(tmp_path):
    """Speckles that move to the left by 40 px: the points of the first columns are gone."""
    rng = np.random.default_rng(4)
    coarse = rng.integers(0, 256, (40, 80), dtype=np.uint8)
    speckles = np.asarray(Image.fromarray(coarse).resize((320, 160), Image.Resampling.BICUBIC))
    (tmp_path / "left").mkdir()
    for step in range(2):
        Image.fromarray(speckles[:, 40 * step : 40 * step + 240]).save(tmp_path / "left" / f"step_{step}.png")
    (tmp_path / "p.yaml").write_text(
        'dicflow: 1\nstages:\n  photos: {stage: images, left: "left/*.png"}\n'
        "  region: {stage: region, images: photos, rectangle: [15, 20, 220, 140]}\n"
        "  correlation: {stage: correlate, images: photos, subset_size: 21, step_size: 5}\n"
        "  total: {stage: deformation, points: correlation, window: 40 px}\n"
    )
    result = Pipeline.load(tmp_path / "p.yaml").run(scheduler="sync")
    source = field_source(result)
    assert source is not None
    status, total = source.read("step_1").status, result.product("total", "step_1")["status"]
    gone = status == Outside.LEFT
    assert gone.any()
    assert (total[gone] == OUT).all()
    assert (status[~gone] == total[~gone]).all()
    assert source.at_first()[gone][:, 0].max() < 40.0 + 21.0
