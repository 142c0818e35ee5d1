"""Pairs of boards are judged by their residuals, left out, and the rig is solved again."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import served
from PIL import Image

from dicflow.app.calibrations import calibration_of
from dicflow.app.project import open_project
from dicflow.io.configuration import read
from dicflow.kinds.rig import CalibratedRig
from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow
SAMPLES = Path(__file__).resolve().parents[2] / "data_samples"
FILE = "boards.yaml"
STICKER, SHIFT_PX = (219, 425), 5
"""A corner of board_02 in the left photograph, and how far to the right it is stuck over."""
TEXT = """# boards only
dicflow: 1
stages:
  boards: {stage: images, left: "boards/left/*.png", right: "boards/right/*.png"}
  corners: {stage: corners, images: boards, size: [9, 6]}
  rig: {stage: calibrate, square: 14.5 mm, tangential: true}  # the rig
"""


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """Twelve pairs of boards; the right photograph of board_05 is that of board_06, and board_02 has a sticker."""
    folder = tmp_path_factory.mktemp("boards") / "test"
    shutil.copytree(SAMPLES / "boards", folder / "boards")
    shutil.copy(folder / "boards/right/board_06.png", folder / "boards/right/board_05.png")
    photograph = folder / "boards/left/board_02.png"
    grey, (x, y) = np.array(Image.open(photograph)), STICKER
    grey[y - 20 : y + 20, x - 20 + SHIFT_PX : x + 20 + SHIFT_PX] = grey[y - 20 : y + 20, x - 20 : x + 20].copy()
    Image.fromarray(grey).save(photograph)
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
                residuals = np.hypot(*np.array(pair[side]["residuals"]).T)
                mean = residuals[~np.array(pair[side]["gross"])].mean()
                assert mean == pytest.approx(product[f"{side}_px"], rel=0.1, abs=0.001)
    assert set(found["empty"]) == {"left", "right"}
    for side in ("left", "right"):
        said = rig.verdict.partition(f"parts of the {side} photographs: ")[2].partition(";")[0]
        assert ", ".join(found["empty"][side]) == said


def test_without_a_pair_the_rig_is_that_of_a_run_without_it(boards, tmp_path):
    shutil.copytree(boards, tmp_path / "test")
    path = tmp_path / "test" / FILE
    with served(path) as app:
        found = app.found("calibration", file=FILE, boards="boards", rig="rig", without=["board_05", "board_02"])
    assert path.read_text() == TEXT
    for side in ("left", "right"):
        for name in ("board_05", "board_02"):
            (path.parent / "boards" / side / f"{name}.png").unlink()
    assert Pipeline.load(path).run(scheduler="sync").outcome.ok
    rig = CalibratedRig.read(Pipeline.load(path).result().product("rig"))
    assert found["summary"] == dict(rig.summary)
    assert found["verdict"] == rig.verdict


def test_a_corner_below_a_sticker_is_gross(boards):
    (warning,) = CalibratedRig.read(Pipeline.load(boards / FILE).result().product("rig")).warnings[-1:]
    assert warning.startswith("1 corner far off all others is left out: board_02, left, at (22")
    pairs = calibration_of(open_project(boards / FILE), FILE, TEXT)["pairs"]
    gross = {(pair["name"], side): np.array(pair[side]["gross"]) for pair in pairs for side in ("left", "right")}
    assert [place for place, found in gross.items() if found.any()] == [("board_02", "left")]
    (number,) = np.flatnonzero(gross["board_02", "left"])
    left = pairs[2]["left"]
    assert np.abs(np.array(left["marks"][number]) - STICKER - (SHIFT_PX, 0)).max() < 1.0
    assert np.abs(np.add(left["residuals"][number], (SHIFT_PX, 0))).max() < 0.5


def test_a_single_corner_is_left_out_with_the_mouse_and_by_keyboard(boards, tmp_path):
    shutil.copytree(boards, tmp_path / "test")
    path = tmp_path / "test" / FILE
    with served(path) as app, opened_page(app, 1920, 1080) as someone:
        someone.go("calibration")
        page = someone.page
        page.wait_for_selector(".pairs-table")
        page.get_by_role("button", name="board_02").click()
        page.wait_for_selector(".out.over", state="attached")
        someone.until("document.querySelectorAll('.out.over').length === 1")
        assert "gross: left out by itself" in page.locator(".corners-table tbody tr").first.inner_text()
        someone.until("document.querySelector('.viewer').viewer.photograph.step === 'board_02'")
        page.wait_for_timeout(400)
        someone.picture("gross_corner_1920")
        page.get_by_role("button", name="board_01").click()
        someone.until("document.querySelector('.viewer').viewer.photograph.step === 'board_01'")
        marks = next(pair for pair in app.found("calibration", file=FILE)["pairs"] if pair["name"] == "board_01")
        first, second = marks["left"]["marks"][10], marks["left"]["marks"][33]
        someone.click(np.add(first, (2.0, 1.0)).tolist())
        someone.click(second)
        someone.until("document.querySelectorAll('.out.over').length === 2")
        page.get_by_label(f"leave out the corner at {second[0]:.1f}, {second[1]:.1f}").focus()
        page.keyboard.press("Space")
        someone.until("document.querySelectorAll('.out.over').length === 1")
        assert "Without corners of board_01" in page.inner_text(".offer")
        page.click("text=Solve again")
        page.wait_for_selector("text=Leave them out of the file")
        trial = page.inner_text(".stage.wide aside table")
        assert someone.overlaps() == []
        assert "leave_out" not in path.read_text()
        page.click("text=Leave them out of the file")
        someone.said("saved: without corners of board_01")
        entry = read(path).data["stages"]["rig"]["leave_out"]
        assert np.abs(np.array(entry["board_01"]["left"]) - [first]).max() < 0.06
        assert list(entry) == ["board_01"]
        assert "# the rig" in path.read_text()
        assert Pipeline.load(path).run(scheduler="sync").outcome.ok
        rig = CalibratedRig.read(Pipeline.load(path).result().product("rig"))
        assert app.found("calibration", file=FILE)["summary"] == dict(rig.summary)
        assert f"→ {rig.summary['baseline_mm']:.2f} mm" in trial
        page.wait_for_selector("text=Tick pairs to leave out")
        page.keyboard.press("Control+z")
        someone.said("taken back: rig: without corners of board_01")
        assert path.read_text() == TEXT


@pytest.mark.parametrize("size", [(1280, 800), (1920, 1080), (390, 844)])
def test_the_screen_fits(boards, size):
    with served(boards / FILE) as app, opened_page(app, *size) as someone:
        someone.go("calibration")
        someone.page.wait_for_selector(".corners-table")
        someone.page.get_by_role("button", name="board_02").click()
        someone.page.get_by_label("leave out board_05").check()
        someone.page.wait_for_timeout(300)
        for scheme in someone.schemes():
            someone.picture(f"calibration_{size[0]}_{scheme}")
            assert someone.overlaps() == [], scheme
            assert someone.page.evaluate("document.documentElement.scrollWidth <= innerWidth"), scheme


def test_a_bad_pair_is_left_out_with_the_mouse(boards, tmp_path):
    shutil.copytree(boards, tmp_path / "test")
    path = tmp_path / "test" / FILE
    with served(path) as app, opened_page(app) as someone:
        someone.go("calibration")
        page = someone.page
        page.wait_for_selector(".pairs-table")
        assert page.locator(".pairs-table tbody tr").first.locator(".pair-name").inner_text() == "board_05"
        page.get_by_role("button", name="board_01").click()
        page.wait_for_selector(".arrow", state="attached")
        assert page.locator(".mark").count() == 54
        page.get_by_label("leave out board_05").check()
        page.click("text=Solve again")
        page.wait_for_selector("text=Leave them out of the file")
        assert "11 of 11 pairs" in page.inner_text(".verdict")
        assert someone.overlaps() == []
        page.click("text=Leave them out of the file")
        someone.said("saved: without board_05")
        someone.until("document.querySelectorAll('.pairs-table tbody tr').length === 11")
    kept = [f"boards/left/board_{k:02}.png" for k in range(12) if k != 5]
    assert read(path).data["stages"]["boards"]["left"] == kept
    assert "# the rig" in path.read_text()
    assert len(Pipeline.load(path).graph.steps["boards"]) == 11
