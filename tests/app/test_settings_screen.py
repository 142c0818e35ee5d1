"""Settings: what would be computed is the plan, and a preview is what the run gives."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, served, small_test

from dicflow.app import previews
from dicflow.app.project import open_project
from dicflow.engine.journal import latest
from dicflow.io.configuration import read
from dicflow.kinds.correlation import Correlation
from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow
ROOT = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def measured(small_result, tmp_path_factory):
    """A small test that has been measured."""
    return shutil.copytree(small_result.parent, tmp_path_factory.mktemp("measured") / "test") / FILE


def missing(plan):
    return {stage: counts["run"] + counts["pending"] for stage, counts in plan.by_stage().items() if not counts["hit"]}


def test_parameters_have_words_limits_units_and_what_is_given(measured):
    with served(measured.parent) as app:
        found = app.found("parameters", file=FILE, stage="correlation")
    by_name = {one["name"]: one for one in found["parameters"]}
    assert by_name["subset_size"]["words"] == "side of the squares that are compared; odd"
    assert by_name["subset_size"]["unit"] == "px"
    assert by_name["subset_size"]["allowed"] == "whole number, at least 5"
    assert (by_name["subset_size"]["value"], by_name["subset_size"]["default"]) == ("21", "31")
    assert by_name["subset_size"]["given"]
    assert by_name["interpolation"]["choices"] == ["bicubic", "biquintic"]
    assert by_name["threads"]["affects"] == "speed"
    assert {one["name"]: one["value"] for one in found["inputs"]} == {
        "images": "photos", "region": "region", "matches": None,
    }  # fmt: skip


def test_a_change_shows_what_it_computes_and_is_saved_and_taken_back(measured):
    before = measured.read_bytes()
    with served(measured.parent) as app, opened_page(app) as someone:
        page = someone.page
        page.click('#sidebar a[href="#settings/total"]')
        field = page.locator("label.parameter", has_text="window").first.locator("input")
        field.fill("50 px")
        page.keyboard.press("Tab")
        would = page.locator(".would").inner_text()
        plan = Pipeline.load(measured, settings=["total.window=50 px"]).plan()
        assert would == ", ".join(f"{stage} {count}" for stage, count in missing(plan).items())
        assert missing(plan) == {"total": 2}
        assert measured.read_bytes() == before
        page.click("text=Save to the file")
        someone.said("saved: total.window")
        assert measured.read_bytes() == before.replace(b"window: 40 px", b"window: 50 px")
        page.wait_for_selector('#sidebar a.run[href="#settings/total"]')
        page.keyboard.press("Control+z")
        someone.said("taken back: total.window")
        assert measured.read_bytes() == before
        page.wait_for_selector('#sidebar a.hit[href="#settings/total"]')


def test_a_port_takes_the_stages_that_are_ticked(tmp_path):
    path = tmp_path / FILE
    given = "narrow: {stage: hyperelastic, curves: [narrow_1, narrow_2, narrow_3]}"
    path.write_text((ROOT / "pipelines" / "latex_tables.yaml").read_text())
    for table in (ROOT / "dicflow" / "synth" / "latex").glob("*.csv"):
        shutil.copy(table, tmp_path)
    with served(path) as app, opened_page(app) as someone:
        page = someone.page
        page.click('#sidebar a[href="#settings/narrow"]')
        page.wait_for_selector("fieldset.parameter")
        tick = page.get_by_role("group", name="curves").get_by_role("checkbox")
        assert [one.is_checked() for one in tick.all()] == [False, True, True, True, False, False]
        page.get_by_label("curves: square").check()
        page.get_by_label("curves: narrow_2").uncheck()
        page.wait_for_selector(".would")
        page.click("text=Save to the file")
        someone.said("saved: narrow.curves")
        assert given.replace("narrow_2, narrow_3", "narrow_3, square") in path.read_text()
        page.get_by_label("curves: all that fit").check()
        page.click("text=Save to the file")
        someone.said("saved: narrow.curves")
        assert "narrow: {stage: hyperelastic}" in path.read_text()
        assert all(one.is_checked() for one in page.get_by_role("group", name="curves").get_by_role("checkbox").all())
        for name in ("narrow_1", "narrow_2", "narrow_3", "square", "wide"):
            page.get_by_label(f"curves: {name}").uncheck()
        page.wait_for_selector(".pending .problem")
        assert "needs an input 'curves'" in page.inner_text(".pending .problem")
        assert someone.overlaps() == []


def test_a_wrong_value_is_refused_in_the_words_of_the_command_line(measured):
    with served(measured.parent) as app, opened_page(app) as someone:
        page = someone.page
        page.click('#sidebar a[href="#settings/correlation"]')
        page.locator("label.parameter", has_text="subset_size").locator("input").fill("22")
        page.keyboard.press("Tab")
        page.wait_for_selector(".pending .problem")
        said = page.inner_text(".pending .problem")
    assert "correlation.subset_size: 22 is even; use an odd number (23 is the next)" in said
    assert read(measured).data["stages"]["correlation"]["subset_size"] == 21


def test_the_preview_is_the_product_of_the_first_step(measured):
    result = Pipeline.load(measured).result()
    first, second = (Correlation.read(result.product("correlation", step)) for step in (0, 1))
    found = previews.grid_preview(open_project(measured), FILE, measured.read_text(), "correlation")
    assert found["valid"] == (first["status"] == 0).sum()
    assert np.abs(np.array(found["points"])[found["is_valid"]] - first["xy"][first["status"] == 0]).max() < 0.006
    variance = (second["covariance"] + second["template"])[second["status"] == 0][:, [0, 2]]
    sigma = np.sqrt(np.median(variance, axis=0))
    moved = (second["xy"] - first["xy"])[second["status"] == 0]
    scatter = np.median(np.abs(moved), axis=0) / 0.6745  # of a normal distribution: subsets at the edge scatter more
    assert found["noise_grey"] == pytest.approx(3.0, rel=0.15)
    assert np.abs(found["sigma_px"] / sigma - 1.0).max() < 0.1
    assert np.abs(found["sigma_px"] / scatter - 1.0).max() < 0.25
    other = measured.read_text().replace("step_size: 5", "step_size: 10")
    coarse = previews.grid_preview(open_project(measured), FILE, other, "correlation")
    assert coarse["count"] < found["count"] / 3


def test_the_grid_is_drawn_on_the_speckles(measured):
    with served(measured.parent) as app, opened_page(app) as someone:
        page = someone.page
        page.click('#sidebar a[href="#settings/correlation"]')
        page.click("text=Preview the grid")
        page.wait_for_selector(".grid.good[d^=M]", state="attached")
        assert "can be followed" in page.inner_text(".facts")
        x, y = someone.at((100, 75))
        page.mouse.click(x, y)
        scale = page.evaluate("document.querySelector('.viewer').viewer.scale")
        box = "document.querySelector('.subset.over').getBoundingClientRect()"
        someone.until(f"Math.abs({box}.x + {box}.width / 2 - {x}) <= {3 * scale + 2}")
        assert page.evaluate(f"{box}.width") == pytest.approx(21 * scale, abs=3)
        assert someone.overlaps() == []


def test_the_expected_time_is_that_of_the_last_run(measured):
    pipeline = Pipeline.load(measured)
    last = {name: pipeline.store.record(entry["key"]) for name, entry in latest(pipeline.store, "pipeline").items()}
    seconds = sum(record.made["stage_s"] for name, record in last.items() if name.startswith("total/"))
    with served(measured.parent) as app:
        edits = [{"place": ["stages", "total", "window"], "text": "60 px"}]
        found = app.found("edit", file=FILE, edits=edits, dry=True)
        assert app.found("plan", file=FILE)["seconds"] == 0
    assert found["seconds"] == pytest.approx(seconds, rel=1e-6)


def test_a_file_that_is_not_valid_is_edited_in_the_page(tmp_path):
    path = small_test(tmp_path / "test")
    good = path.read_text()
    path.write_text(good.replace("subset_size: 21", "subset_size: 22"))
    with served(path) as app, opened_page(app) as someone:
        page = someone.page
        page.wait_for_selector(".problems li")
        assert "correlation.subset_size: 22 is even" in page.inner_text(".problems")
        assert someone.overlaps() == []
        page.locator("textarea").fill(good)
        page.get_by_role("button", name="Save").click()
        page.wait_for_selector("section.region .viewer")
    assert path.read_text() == good


def test_photographs_that_are_gone_are_named_and_found_again_stage_by_stage(tmp_path):
    """Each of two problems is solved by itself; a screen that cannot be shown leads to the settings."""
    path = small_test(tmp_path / "test")
    more = '"gone/*.png"}\n  more: {stage: images, left: "lost/*.png"}'
    path.write_text(path.read_text().replace('"left/*.png"}', more))
    with served(path) as app, opened_page(app) as someone:
        page = someone.page
        someone.go("folder")
        page.wait_for_selector(".empty .problem")
        assert "photos: left: no photograph matches 'gone/*.png'" in page.inner_text(".empty .problem")
        page.get_by_role("button", name="Settings").click()
        page.wait_for_selector("table .problem, .card .problem")
        page.locator('section a[href="#settings/photos"]').click()
        page.locator("label.parameter", has_text="photographs of the left camera").locator("input").fill("left/*.png")
        page.keyboard.press("Tab")
        page.wait_for_selector(".pending .problem")
        assert "more: left: no photograph matches 'lost/*.png'" in page.inner_text(".pending .problem")
        page.click("text=Save to the file")
        someone.said("saved: photos.left")
        assert someone.overlaps() == []
    stages = read(path).data["stages"]
    assert (stages["photos"]["left"], stages["more"]["left"]) == ("left/*.png", "lost/*.png")
