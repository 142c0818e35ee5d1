"""Pairs of boards are judged by their residuals, left out, and the rig is solved again."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import served

from dicflow.app.calibrations import calibration_of
from dicflow.app.project import open_project
from dicflow.io.configuration import read
from dicflow.kinds.rig import CalibratedRig
from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow
SAMPLES = Path(__file__).resolve().parents[2] / "data_samples"
FILE = "boards.yaml"
TEXT = """# boards only
dicflow: 1
stages:
  boards: {stage: images, left: "boards/left/*.png", right: "boards/right/*.png"}
  corners: {stage: corners, images: boards, size: [9, 6]}
  rig: {stage: calibrate, square: 14.5 mm, tangential: true}  # the rig
"""


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """Twelve pairs of boards; the right photograph of board_05 is that of board_06."""
    folder = tmp_path_factory.mktemp("boards") / "test"
    shutil.copytree(SAMPLES / "boards", folder / "boards")
    shutil.copy(folder / "boards/right/board_06.png", folder / "boards/right/board_05.png")
    (folder / FILE).write_text(TEXT)
    assert Pipeline.load(folder / FILE).run(scheduler="sync").outcome.ok
    return folder


def test_residuals_have_the_errors_of_the_product(boards):
    found = calibration_of(open_project(boards / FILE), FILE, TEXT)
    rig = CalibratedRig.read(Pipeline.load(boards / FILE).result().product("rig"))
    assert found["verdict"] == rig.verdict
    assert len(found["pairs"]) == len(rig.pairs) == 12
    for pair, product in zip(found["pairs"], rig.pairs, strict=True):
        assert pair["used"] == product["used"] == (pair["name"] != "board_05")
        if pair["used"]:
            for side in ("left", "right"):
                mean = np.hypot(*np.array(pair[side]["residuals"]).T).mean()
                assert mean == pytest.approx(product[f"{side}_px"], rel=0.1, abs=0.001)
    assert set(found["empty"]) == {"left", "right"}
    for side in ("left", "right"):
        said = rig.verdict.partition(f"parts of the {side} photographs: ")[2].partition(";")[0]
        assert ", ".join(found["empty"][side]) == said


def test_without_a_pair_the_rig_is_that_of_a_run_without_it(boards, tmp_path):
    shutil.copytree(boards, tmp_path / "test")
    path = tmp_path / "test" / FILE
    with served(path) as app:
        found = app.found("calibration", file=FILE, boards="boards", without=["board_05", "board_02"])
    assert path.read_text() == TEXT
    for side in ("left", "right"):
        for name in ("board_05", "board_02"):
            (path.parent / "boards" / side / f"{name}.png").unlink()
    assert Pipeline.load(path).run(scheduler="sync").outcome.ok
    rig = CalibratedRig.read(Pipeline.load(path).result().product("rig"))
    assert found["summary"] == dict(rig.summary)
    assert found["verdict"] == rig.verdict


def test_a_bad_pair_is_left_out_with_the_mouse(boards, tmp_path):
    shutil.copytree(boards, tmp_path / "test")
    path = tmp_path / "test" / FILE
    with served(path) as app, opened_page(app) as someone:
        someone.go("calibration")
        page = someone.page
        page.wait_for_selector(".pairs-table", timeout=60_000)
        assert page.locator(".pairs-table tbody tr").first.locator(".pair-name").inner_text() == "board_05"
        page.get_by_role("button", name="board_01").click()
        page.wait_for_selector(".arrow", state="attached")
        assert page.locator(".mark").count() == 54
        page.get_by_label("leave out board_05").check()
        page.click("text=Solve again")
        page.wait_for_selector("text=Leave them out of the file", timeout=60_000)
        assert "11 of 11 pairs" in page.inner_text(".verdict")
        assert someone.overlaps() == []
        page.click("text=Leave them out of the file")
        someone.said("left out: board_05")
        someone.until("document.querySelectorAll('.pairs-table tbody tr').length === 11")
    kept = [f"boards/left/board_{k:02}.png" for k in range(12) if k != 5]
    assert read(path).data["stages"]["boards"]["left"] == kept
    assert "# the rig" in path.read_text()
    assert len(Pipeline.load(path).graph.steps["boards"]) == 11
