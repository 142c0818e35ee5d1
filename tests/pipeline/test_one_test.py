"""A file that measures several specimens: what is shown of it is one of them."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from dicflow.pipeline import Pipeline
from dicflow.synth.pictures import outline_text

pytestmark = pytest.mark.slow

PIPELINE = Path(__file__).resolve().parents[2] / "pipelines" / "latex_material.yaml"
SHARED = {"boards", "corners", "rig", "material", "strips_alone"}


@pytest.fixture
def data(tmp_path):
    """Files of all names that the pipeline reads."""
    for place in ("boards", "strip/photos", "square/photos", "wide/photos"):
        for side in ("left", "right"):
            folder = tmp_path / place / side
            folder.mkdir(parents=True)
            for step in range(2):
                cv2.imwrite(str(folder / f"step_{step:02d}.png"), np.zeros((40, 40), np.uint8))
    for name in ("strip", "square", "wide"):
        outline = np.array([[10.0, 5.0], [30.0, 5.0], [30.0, 35.0], [10.0, 35.0], [10.0, 5.0]])
        (tmp_path / name / "region.geojson").write_text(outline_text(outline))
        (tmp_path / name / "weights.csv").write_text("step,load_g\nstep_00,0.0\nstep_01,9.0\n")
    return tmp_path


def loaded(data, text):
    path = data / "pipeline.yaml"
    path.write_text(text, encoding="utf-8")
    return Pipeline.load(path, store=data / "store").result()


def names(result):
    return set(result.stages) - SHARED


def test_the_last_specimen_is_shown_with_what_all_share(data):
    whole = loaded(data, PIPELINE.read_text(encoding="utf-8"))
    one = whole.of_one_test()
    assert set(one.stages) >= SHARED
    assert names(one) == {stage for stage in names(whole) if stage.startswith("wide")}


def test_the_specimen_that_maps_draw_is_shown(data):
    one = loaded(
        data, PIPELINE.read_text(encoding="utf-8") + "  maps: {stage: maps, total: strip_total}\n"
    ).of_one_test()
    assert all(stage.startswith("strip") for stage in names(one) - {"maps"})
    assert "maps" in one.stages


def test_a_file_of_one_specimen_is_shown_whole(data):
    lines = PIPELINE.read_text(encoding="utf-8").splitlines()
    kept = [line for line in lines if not line.strip().startswith(("square", "wide", "material:", "strips_alone:"))]
    whole = loaded(data, "\n".join(kept) + "\n")
    assert whole.of_one_test() is whole
