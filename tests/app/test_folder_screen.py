"""A folder of photographs becomes a pipeline file as 'dicflow init' makes it, and bad photographs are left out."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest
from app_browser import opened_page
from app_serving import FILE, served, small_test
from small import dicflow

from dicflow.app.project import open_project
from dicflow.app.series import found_in, make_pipeline
from dicflow.errors import ConfigurationError
from dicflow.io.configuration import read
from dicflow.pipeline import Pipeline
from tests.phones import UNLIKE, taken_by_phones

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("boards_recognised_once")]
SAMPLES = Path(__file__).resolve().parents[2] / "data_samples"


def few_photographs(folder):
    """Four steps of the sample, and four of its boards."""
    for part, name in (("photos", "step"), ("boards", "board")):
        for side in ("left", "right"):
            (folder / part / side).mkdir(parents=True)
            for k in range(4):
                shutil.copy(SAMPLES / part / side / f"{name}_{k:02}.png", folder / part / side)


@pytest.fixture
def messy(tmp_path):
    """Photographs of a strip and of boards; the left camera lacks the last step, and one belongs nowhere."""
    few_photographs(tmp_path / "messy")
    (tmp_path / "messy" / "photos" / "left" / "step_03.png").unlink()
    shutil.copy(SAMPLES / "photos" / "left" / "step_00.png", tmp_path / "messy" / "setup.png")
    return tmp_path / "messy"


def test_series_have_the_roles_that_init_would_give_them(messy):
    found = found_in(open_project(messy))
    roles = {one["pattern"]: (len(one["names"]), one["shows"], one["role"]) for one in found["series"]}
    assert roles["photos/left/*.png"] == (3, "specimen", "left")
    assert roles["photos/right/*.png"] == (4, "specimen", "right")
    assert roles["boards/left/*.png"] == (4, "board", "left_boards")
    assert roles["boards/right/*.png"] == (4, "board", "right_boards")
    assert "setup.png" in [*found["single"], *(name for one in found["series"] for name in one["names"])]


def test_the_file_is_that_of_init(tmp_path):
    for name in ("app", "init"):
        few_photographs(tmp_path / name / "test")
    project = open_project(tmp_path / "app" / "test")
    project.path(FILE).write_text("\n")
    series = found_in(project)["series"]
    made = make_pipeline(project, series, "14.5 mm")
    assert dicflow("init", tmp_path / "init" / "test", "--square", "14.5 mm").code == 0
    expected = (tmp_path / "init" / "test" / FILE).read_text()
    assert project.path(FILE).read_text() == expected
    assert any("specimen: 4 pairs" in line for line in made["said"])
    with pytest.raises(ConfigurationError, match="exists"):
        make_pipeline(project, series, "")


def test_ways_to_pair_two_phones_are_shown_with_their_first_and_last_pair(tmp_path):
    """Unlike names and a clock that is an hour ahead; the right phone lacks the second photograph of the specimen."""
    folder = taken_by_phones(tmp_path / "test", steps=4, boards=4, missing=(5,))
    shutil.copy(folder / "IMG_2308.jpg", folder / "IMG_2308 (1).jpg")
    with served(folder) as app, opened_page(app) as someone:
        page = someone.page
        page.wait_for_selector(".way")
        assert "Copies of others, left out: IMG_2308 (1).jpg" in page.inner_text("section.folder")
        assert page.locator(".series", has_text="iPhone 12").count() == 2
        specimen, board = page.locator(".pairings fieldset").all()
        assert specimen.locator(".way").count() == 1
        words = specimen.inner_text()
        assert "By the time taken: 3 pairs" in words
        assert "1 h 2 min ahead; without a partner, left out: IMG_2306.jpg" in words
        assert "first: IMG_2305.jpg with DSC_0011.jpg" in words
        assert "last: IMG_2308.jpg with DSC_0013.jpg" in words
        assert board.locator(".way").count() == 2
        board.get_by_label("Pair in order").check()
        someone.until("[...document.querySelectorAll('.way img')].every((one) => one.naturalWidth > 0)")
        specimen.scroll_into_view_if_needed()
        someone.picture("pairs_1280")
        assert someone.overlaps() == []
        page.fill("#square", "14.5 mm")
        page.get_by_role("button", name="Make the pipeline file").click()
        page.wait_for_selector("section.region .viewer")
    stages = read(folder / FILE).data["stages"]
    assert stages["photos"]["left"] == [f"IMG_{k}.jpg" for k in (2305, 2307, 2308)]
    assert stages["photos"]["right"] == [f"DSC_{k:04}.jpg" for k in (11, 12, 13)]
    assert stages["boards"]["pair_by"] == "order"
    assert list(Pipeline.load(folder / FILE).graph.steps["photos"]) == ["IMG_2305", "IMG_2307", "IMG_2308"]


def test_without_times_pairs_in_order_must_be_chosen(tmp_path):
    """A messenger has taken the metadata away, and one counter jumps."""
    phones = tuple(phone._replace(model="") for phone in UNLIKE)
    folder = taken_by_phones(tmp_path / "test", phones, steps=3, boards=3)
    (folder / "DSC_0012.jpg").rename(folder / "DSC_0019.jpg")
    with served(folder) as app, opened_page(app, 390, 844) as someone:
        page = someone.page
        page.wait_for_selector(".way")
        assert "Not certain: 2 series of the specimen look alike" in page.inner_text("section.folder")
        page.fill("#square", "14.5 mm")
        page.get_by_role("button", name="Make the pipeline file").click()
        page.wait_for_selector("text=Choose what makes the pairs of the specimen first")
        assert page.evaluate("document.activeElement.type") == "radio"
        assert someone.overlaps() == []
        page.keyboard.press("Space")
        page.get_by_role("button", name="Make the pipeline file").click()
        page.wait_for_selector("section.region .viewer")
    assert read(folder / FILE).data["stages"]["photos"]["pair_by"] == "order"
    *_, last = Pipeline.load(folder / FILE).graph.files["photos"].values()
    assert {file.name for file in last.values()} == {"IMG_2306.jpg", "DSC_0019.jpg"}


def test_a_folder_is_sorted_with_the_mouse(messy):
    with served(messy) as app, opened_page(app) as someone:
        page = someone.page
        page.wait_for_selector(".series select")
        assert page.locator(".series img").count() >= 12
        assert "1 without a partner" in page.inner_text("table.narrow")
        someone.until("[...document.querySelectorAll('.series img')].every((one) => one.naturalWidth > 0)")
        page.get_by_label("what photos/right/*.png is").select_option("left")
        page.get_by_label("what photos/left/*.png is").select_option("right")
        page.get_by_label("what boards/right/*.png is").select_option("left_boards")
        page.get_by_label("what boards/left/*.png is").select_option("right_boards")
        page.get_by_role("button", name="Make the pipeline file").click()
        someone.said("Measure one square of the board first")
        page.fill("#square", "14.5 mm")
        assert someone.overlaps() == []
        page.get_by_role("button", name="Make the pipeline file").click()
        someone.said("Choose what makes the pairs of the specimen first")
        assert "By the names: 3 pairs" in page.inner_text(".way")
        assert "without a partner, left out: step_03.png" in page.inner_text(".way")
        page.get_by_label("By the names").check()
        page.get_by_role("button", name="Make the pipeline file").click()
        page.wait_for_selector("section.region .viewer")
    stages = read(messy / FILE).data["stages"]
    kept = ["step_00.png", "step_01.png", "step_02.png"]
    assert stages["photos"]["left"] == [f"photos/right/{name}" for name in kept]
    assert stages["photos"]["right"] == "photos/left/*.png"
    assert stages["photos"]["pair_by"] == "order"
    assert (stages["boards"]["left"], stages["boards"]["right"]) == ("boards/right/*.png", "boards/left/*.png")
    assert stages["rig"]["square"] == "14.5 mm"


def test_bad_photographs_are_left_out_and_come_back(tmp_path):
    path = small_test(tmp_path / "test", steps=12)
    before = path.read_bytes()
    with served(path.parent) as app, opened_page(app) as someone:
        someone.go("folder")
        page = someone.page
        page.wait_for_selector(".pair")
        assert page.locator(".pair").count() == 12
        for name in ("step_0003", "step_0010"):
            page.locator(".pair", has_text=name).locator("input").check()
        page.get_by_role("button", name="Leave out 2").click()
        someone.said("left out: step_0003, step_0010")
        kept = [f"left/step_{k:04}.png" for k in range(12) if k not in (3, 10)]
        assert read(path).data["stages"]["photos"]["left"] == kept
        assert list(Pipeline.load(path).graph.steps["photos"]) == [Path(name).stem for name in kept]
        assert b"# the specimen" in path.read_bytes()
        someone.until("document.querySelectorAll('.pair').length === 10")
        page.keyboard.press("Control+z")
        someone.said("taken back")
        assert path.read_bytes() == before
