"""The region and the probes are drawn with the mouse and by keyboard, and the files hold what was drawn."""

from __future__ import annotations

import json
import os
import re
import shutil

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, served, small_test

from dicflow.app.answers import Desk
from dicflow.io.configuration import read
from dicflow.io.region import read_geojson
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.region import Region
from dicflow.pipeline import Pipeline
from dicflow.report.words import number

pytestmark = pytest.mark.slow
OUTER = [(30, 25), (170, 28), (165, 120), (35, 118)]
HOLE = [(80, 60), (110, 62), (95, 90)]


@pytest.fixture
def folder(tmp_path):
    return small_test(tmp_path / "test").parent


@pytest.fixture
def person(folder):
    with served(folder) as app, opened_page(app) as someone:
        someone.go("region")
        someone.page.wait_for_selector(".viewer")
        yield someone


def draw(person, key, places, end="f"):
    """Draw a path with the tool of a key."""
    person.page.focus(".viewer")
    person.page.keyboard.press(key)
    for place in places:
        person.click(place)
    if end:
        person.page.keyboard.press(end)


def stage(folder, name):
    return read(folder / FILE).data["stages"].get(name)


def test_a_polygon_with_a_hole_and_a_cut_is_drawn_edited_and_taken_back(person, folder):
    before = (folder / FILE).read_bytes()
    person.page.click(".path-name")
    person.page.click("text=Delete")
    person.said("the region has no polygon")
    draw(person, "o", OUTER)
    person.said("saved: outline")
    person.page.click(".path-name >> nth=0")
    person.page.click("text=Delete")
    person.said("deleted")
    draw(person, "h", HOLE)
    person.said("saved: hole")
    draw(person, "c", [(40, 40), (70, 45)])
    person.said("saved: cut")
    drawn = read_geojson(folder / "region.geojson")
    (polygon,) = drawn.polygons
    assert np.abs(polygon.exterior - OUTER).max() < 1.0
    assert np.abs(polygon.holes[0] - HOLE).max() < 1.0
    assert np.abs(drawn.cuts[0] - [(40, 40), (70, 45)]).max() < 1.0
    assert stage(folder, "region") == {"stage": "region", "images": "photos", "file": "region.geojson"}
    assert b"# what is measured" in (folder / FILE).read_bytes()

    place = polygon.exterior[1]
    person.drag(place, (150, 40))
    person.said("saved: corner")
    moved = read_geojson(folder / "region.geojson").polygons[0].exterior
    assert np.abs(moved[1] - (150, 40)).max() < 1.0
    assert (moved[[0, 2, 3]] == polygon.exterior[[0, 2, 3]]).all()

    person.page.reload()
    person.page.wait_for_selector(".path-name")
    for _ in range(5):
        person.page.keyboard.press("Control+z")
        person.said("taken back")
    assert (folder / FILE).read_bytes() == before
    assert not (folder / "region.geojson").exists()
    assert Pipeline.load(folder / FILE).graph


def test_numbers_are_typed(person, folder):
    person.page.click(".path-name")
    person.page.get_by_label("x of corner 3").fill("175.25")
    person.page.keyboard.press("Tab")
    person.said("saved: corner")
    expected = [(20, 20), (180, 20), (175.25, 130), (20, 130)]
    assert read_geojson(folder / "region.geojson").polygons[0].exterior.tolist() == [list(one) for one in expected]


def test_the_keyboard_alone_draws_and_moves(person, folder):
    page = person.page
    page.keyboard.press("Tab")
    page.focus(".viewer")
    page.keyboard.press("p")
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    page.keyboard.press("Shift+ArrowDown")
    page.keyboard.press("Enter")
    person.said("saved: point_1")
    x, y = stage(folder, "probes")["points"]["point_1"]
    width, height = 200, 150
    assert abs(x - ((width - 1) / 2 + 30)) < 1.0
    assert abs(y - ((height - 1) / 2 + 1)) < 1.0
    page.focus(".viewer")
    page.keyboard.press(".")
    page.keyboard.press("Shift+ArrowLeft")
    person.said("saved: corner of point_1")
    assert stage(folder, "probes")["points"]["point_1"] == [x - 10, y]
    page.focus(".viewer")
    page.keyboard.press("Delete")
    person.said("point_1 deleted")
    assert stage(folder, "probes") is None


def test_probes_of_each_sort_are_placed(person, folder):
    draw(person, "p", [(60, 60)], "")
    person.said("saved: point_1")
    draw(person, "e", [(100, 40), (100, 110)], "")
    person.said("saved: extensometer_1")
    draw(person, "l", [(50, 100), (150, 100)], "")
    person.said("saved: line_1")
    draw(person, "a", [(120, 40), (150, 40), (150, 70)])
    person.said("saved: area_1")
    person.page.get_by_label("name").fill("centre")
    person.page.keyboard.press("Tab")
    person.said("saved: name centre")
    probes = stage(folder, "probes")
    assert probes["stage"] == "probes"
    assert np.abs(np.array(probes["points"]["point_1"]) - (60, 60)).max() < 1.0
    assert np.abs(np.array(probes["extensometers"]["extensometer_1"]) - [(100, 40), (100, 110)]).max() < 1.0
    assert np.abs(np.array(probes["lines"]["line_1"]) - [(50, 100), (150, 100)]).max() < 1.0
    assert np.abs(np.array(probes["areas"]["centre"]) - [(120, 40), (150, 40), (150, 70)]).max() < 1.0
    assert Pipeline.load(folder / FILE).graph


def test_what_an_editor_changes_meanwhile_is_not_overwritten(person, folder):
    path = folder / FILE
    path.write_text(path.read_text().replace("subset_size: 21", "subset_size: 31"))
    draw(person, "p", [(60, 60)], "")
    person.said("changed meanwhile")
    assert "subset_size: 31" in path.read_text()
    assert stage(folder, "probes") is None
    draw(person, "p", [(60, 60)], "")
    person.said("saved: point_1")
    assert stage(folder, "correlation")["subset_size"] == 31


def test_before_a_run_nothing_is_loaded_to_read_what_is_at_rest(folder, monkeypatch):
    monkeypatch.setattr(Desk, "work", None)
    with served(folder) as app:
        assert app.found("rest", file=FILE) == []


def test_what_an_extensometer_reads_at_rest_stands_below_the_probes(small_result, tmp_path):
    path = shutil.copytree(small_result.parent, tmp_path / "test") / FILE
    path.write_text(path.read_text() + "  probes: {stage: probes, extensometers: {gauge: [[60, 75], [140, 75]]}}\n")
    pipeline = Pipeline.load(path)
    table = ProbeTable.read(pipeline.run(scheduler="sync").product("probes"))
    strain, sigma = (np.array([row[key] for row in table.rows if row[key]]) for key in ("strain", "sigma_strain"))
    found, stated = np.sqrt(np.mean(strain**2)), np.sqrt(np.mean(sigma**2))
    with served(path) as app, opened_page(app) as someone:
        someone.go("region")
        someone.page.wait_for_selector(".rest p")
        (words,) = someone.page.locator(".rest p").all_inner_texts()
    assert len(strain) == 2
    scatter, ratio = re.fullmatch(
        r"At rest \(2 steps\) the strain of gauge scatters by (.+), (.+) times.*", words
    ).groups()
    assert scatter == number(found, 3)
    assert float(ratio) == pytest.approx(found / stated, abs=0.06)


def test_the_automatic_region_is_a_proposal_to_edit(person, folder):
    person.page.click("text=Propose the region")
    person.said("saved: the proposed region")
    whole = json.loads((folder / "region.geojson").read_text())
    ring = np.array(whole["coordinates"][0][0])
    assert np.ptp(ring[:, 0]) > 150
    assert np.ptp(ring[:, 1]) > 100


def test_where_the_photographs_cannot_be_written_the_region_stands_in_the_pipeline_file(tmp_path, monkeypatch):
    data = small_test(tmp_path / "photographs").parent
    (tmp_path / "test").mkdir()
    path = (data / FILE).rename(tmp_path / "test" / FILE)
    before = path.read_bytes()
    data.chmod(0o555)
    if os.geteuid() == 0:  # who may write everywhere
        monkeypatch.setattr(
            "dicflow.app.drawing._can_be_written", lambda path: bool(path.parent.stat().st_mode & 0o200)
        )
    try:
        with served(path, data) as app, opened_page(app) as someone:
            someone.go("region")
            someone.page.wait_for_selector(".path-name")
            draw(someone, "h", HOLE)
            someone.said("saved: hole")
            draw(someone, "c", [(40, 40), (70, 45)])
            someone.said("saved: cut")
            assert [one.name for one in data.iterdir()] == ["left"]
            kept = stage(tmp_path / "test", "region")
            (polygon,) = kept["polygons"]
            assert np.abs(np.array(polygon["holes"][0]) - HOLE).max() < 1.0
            assert np.abs(np.array(kept["cut"][0]) - [(40, 40), (70, 45)]).max() < 1.0
            assert "rectangle" not in kept
            product = Pipeline.load(path, data=data).run(scheduler="sync").product("region")
            outlines = Region.read(product).polygons
            assert sum(len(one.holes) for one in outlines) == 2  # the hole, and the slit of the cut
            someone.page.reload()
            someone.page.wait_for_selector(".path-name >> nth=2")
            for _ in range(2):
                someone.page.keyboard.press("Control+z")
                someone.said("taken back")
            assert path.read_bytes() == before
    finally:
        data.chmod(0o755)


def test_zoom_keeps_the_place_under_the_pointer(person):
    x, y = map(round, person.at((150, 40)))  # a wheel's event has whole pixels
    scale = "document.querySelector('.viewer').viewer.scale"
    before = person.page.evaluate(scale)
    place = np.array((150, 40)) + np.subtract((x, y), person.at((150, 40))) / before
    person.page.mouse.move(x, y)
    person.page.mouse.wheel(0, -600)
    person.until(f"{scale} > {2 * before}")
    assert np.hypot(*np.subtract(person.at(place), (x, y))) < 0.1
    person.page.focus(".viewer")
    person.page.keyboard.press("0")
    assert person.overlaps() == []


def test_names_that_are_html_stay_text(folder):
    path = folder / FILE
    evil = "<img src=x onerror=document.body.dataset.evil=1>"
    probe = f'  probes: {{stage: probes, points: {{"{evil}": [50, 50]}}}}\n'
    path.write_text(path.read_text().replace("dicflow: 1", f'dicflow: 1\ntitle: "{evil}"') + probe)
    with served(folder) as app, opened_page(app) as someone:
        someone.go("region")
        someone.page.wait_for_selector(".path-name")
        assert evil in someone.page.inner_text("#sidebar")
        assert evil in someone.page.inner_text(".paths >> nth=1")
        for screen in ("settings", "run", "folder", "explore", "hand_over", "calibration"):
            someone.go(screen)
            someone.page.wait_for_timeout(200)
        assert someone.page.evaluate("document.body.dataset.evil") is None
        assert someone.page.locator("img[src=x]").count() == 0
