"""The screen "compare": two results side by side with linked cursors, and a parameter before and after."""

from __future__ import annotations

import re
import shutil

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, measure, served, small_test

from dicflow.engine.journal import runs
from dicflow.kinds.total import Total
from dicflow.pipeline import Pipeline
from tests.explorer.test_results import ROOT, SAMPLES
from tests.made_once import copy_of_store

pytestmark = pytest.mark.slow

ONE, OTHER = (f"document.querySelector('.pair .side{k}.fields').explorer" for k in (0, 1))


CHART_OVERLAPS = """
() => [...document.querySelectorAll(".x-chart svg")].flatMap((svg) => {
  const texts = [...svg.querySelectorAll("text")].map((text) => [text.textContent, text.getBoundingClientRect()]);
  const wide = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left);
  const high = (a, b) => Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
  return texts.flatMap(([one, a], k) =>
    texts.slice(k + 1).filter(([, b]) => wide(a, b) > 1 && high(a, b) > 2).map(([other]) => [one, other]));
})
"""


@pytest.fixture(scope="module")
def quickstart(quickstart_store, tmp_path_factory):
    """The quick start, measured with a window of 40 px, then with one of 60 px."""
    folder = tmp_path_factory.mktemp("compared") / "test"
    shutil.copytree(SAMPLES, folder)
    copy_of_store(quickstart_store, folder / ".dicflow")
    text = (ROOT / "pipelines" / "quickstart.yaml").read_text()
    return measured_twice(folder / FILE, text, text.replace("window: 40 px", "window: 60 px"))


@pytest.fixture
def small(tmp_path):
    """A small test of one camera, without a result."""
    return small_test(tmp_path / "test", steps=3)


@pytest.fixture
def measured(small_result, tmp_path):
    """The same with one result."""
    return shutil.copytree(small_result.parent, tmp_path / "test") / FILE


def measured_twice(path, before, after):
    for text in (before, after):
        path.write_text(text)
        measure(path)
    return path


def changed(path, old, new):
    text = path.read_text()
    assert old in text
    return measured_twice(path, text, text.replace(old, new))


def results(path):
    """What the file gives now, and what its first run gave."""
    pipeline = Pipeline.load(path)
    return pipeline.result(), pipeline.past_result(runs(pipeline.store)[-1].id)


def shown(someone):
    """Wait until both sides are drawn with all steps, and follow one another."""
    someone.until(r"/(\d+) of \1 steps/.test(document.querySelector('.tools .shown')?.textContent)")
    someone.until("document.querySelector('.pair[aria-busy=false]')")
    assert someone.page.evaluate(f"{OTHER}.frame.step.name === {ONE}.frame.step.name")


def point_at(someone, k, side=0):
    """Move the mouse to a point of a side, as a person does; where it is."""
    explorer = (ONE, OTHER)[side]
    stage = someone.page.locator(f".pair .side{side} .x-main > .x-stage")
    stage.scroll_into_view_if_needed()
    someone.drawn()
    box = stage.bounding_box()
    x, y = someone.page.evaluate(f"{explorer}.stage.shownAt({k})")
    someone.page.mouse.move(box["x"] + x - 40, box["y"] + y - 30)
    someone.page.mouse.move(box["x"] + x, box["y"] + y, steps=8)
    return box["x"] + x, box["y"] + y


def views(page):
    """Middle and scale of what either side shows."""
    found = page.evaluate(f"[{ONE}.stage.view, {OTHER}.stage.view]")
    return [[*one["middle"], one["scale"]] for one in found]


def figures(someone):
    return someone.page.inner_text(".pair .figures").replace("−", "-")


def said_difference(text, names="A - B"):
    return float(re.search(rf"{names} (-?[\d.]+)", text)[1])


def middle_of(total, name, places=((0.5, 0.5), (0.3, 0.4), (0.7, 0.6))):
    """Numbers of points with a value about the middle."""
    rows, cols = total[name].shape
    found = [int(rows * row) * cols + int(cols * col) for row, col in places]
    return [k for k in found if np.isfinite(total[name].ravel()[k])]


def test_the_pointer_reads_both_runs_and_their_difference(quickstart):
    now, before = results(quickstart)
    with served(quickstart) as app, opened_page(app) as someone:
        someone.go("compare")
        shown(someone)
        page = someone.page
        assert "total.window 40.0 px (now 60.0 px)" in page.locator(".caption.side1").inner_text()
        step, quantity = page.evaluate(f"[{ONE}.frame.step.name, {ONE}.quantity]")
        name, quantum = quantity["name"], quantity["scale"][1]
        one, other = (result.product("total", step) for result in (now, before))
        title = page.inner_text(".side0 .x-legend-title")
        for total, side in ((one, "A"), (other, "B")):
            assert f"{Total.read(total).gauge.size} ({side})" in title
        points = middle_of(one, name)
        assert len(points) >= 2
        for side, k in ((0, points[0]), (1, points[1])):
            point_at(someone, k, side)
            hovered = page.evaluate(f"[{ONE}.stage.hovered, {OTHER}.stage.hovered]")
            assert hovered == [k, k]
            truth = one[name].ravel()[k] - other[name].ravel()[k]
            found = page.evaluate(f"[{ONE}.frame.point({k}).value, {OTHER}.frame.point({k}).value]")
            assert abs(found[0] - found[1] - truth) <= 1.01 * quantum
            text = figures(someone)
            assert "the same point" in text
            decimals = len(re.search(r"A - B -?\d+\.(\d+)", text)[1])
            assert abs(said_difference(text) - truth) <= 0.5001 * 10.0**-decimals + 1.01 * quantum
            tip = page.inner_text(f".side{side} .x-main .x-tip").replace("−", "-")
            assert said_difference(tip) == said_difference(text)
            assert "A - B" not in page.inner_text(f".side{1 - side} .x-main .x-tip").replace("−", "-")
        assert someone.overlaps() == []


def test_step_quantity_range_zoom_points_and_line_are_linked(quickstart):
    with served(quickstart) as app, opened_page(app) as someone:
        someone.go("compare")
        shown(someone)
        page = someone.page
        stages = [page.locator(f".side{side} .x-main > .x-stage") for side in (0, 1)]
        for side in (0, 1):  # keys on either side
            stages[side].focus()
            page.keyboard.press("Home")
            someone.until(f"[{ONE}, {OTHER}].every((one) => one.frame.step === one.manifest.steps[0])")
            page.keyboard.press("ArrowRight")
            someone.until(f"[{ONE}, {OTHER}].every((one) => one.frame.step === one.manifest.steps[1])")
        page.keyboard.press("+")
        page.keyboard.press("+")
        zoomed = views(page)
        assert zoomed[0] == pytest.approx(zoomed[1])
        box = stages[0].bounding_box()
        page.mouse.move(box["x"] + 200, box["y"] + 100, steps=4)
        page.mouse.down()
        page.mouse.move(box["x"] + 230, box["y"] + 140, steps=6)
        page.mouse.up()
        moved = views(page)
        assert moved[0] == pytest.approx(moved[1])
        assert np.subtract(zoomed[0], moved[0])[:2] * moved[0][2] == pytest.approx([30, 40])
        page.keyboard.press("0")
        names = page.evaluate(f"{ONE}.manifest.quantities.map((one) => one.name)")
        page.locator(".side0 .x-quantity").select_option(str(names.index("V")))
        someone.until(f"[{ONE}, {OTHER}].every((one) => one.frame.quantity.name === 'V')")
        someone.until(f"String({ONE}.range) === String({OTHER}.range)")
        page.get_by_label("upper end of the colours").first.fill("7.5")
        page.keyboard.press("Tab")
        assert page.evaluate(f"[{ONE}.range[1], {OTHER}.range[1]]") == [7.5, 7.5]
        page.get_by_role("button", name="Right", exact=True).first.click()
        someone.until(f"[{ONE}, {OTHER}].every((one) => one.frame.scene.camera === 'right')")
        someone.until(f"[{ONE}, {OTHER}].every((one) => one.stage.photo.naturalWidth > 100)")
        page.get_by_role("button", name="Left", exact=True).first.click()
        someone.until(f"[{ONE}, {OTHER}].every((one) => one.frame.scene.camera === 'left')")
        k = page.evaluate(f"{ONE}.frame.codes.findIndex((code, k) => code && k > {ONE}.frame.codes.length / 2)")
        point_at(someone, k, 1)
        page.mouse.down()
        page.mouse.up()
        assert page.evaluate(f"[{ONE}, {OTHER}].map((one) => one.points.map((each) => each.index))") == [[k], [k]]
        someone.until("document.querySelectorAll('.side0 .x-curve polyline').length === 2")
        assert page.locator(".side0 .x-curve polyline[stroke-dasharray]").count() == 1
        page.get_by_role("button", name="Line", exact=True).first.click()
        lines = page.evaluate(f"[{ONE}.scene.line, {OTHER}.scene.line]")
        assert lines[0] == lines[1]
        someone.until("document.querySelectorAll('.side0 .x-profile polyline').length === 2")
        assert someone.overlaps() == []
        page.keyboard.press("Escape")
        someone.until(f"[{ONE}, {OTHER}].every((one) => one.points.length === 0)")


def test_playing_takes_both_along(quickstart):
    with served(quickstart) as app, opened_page(app) as someone:
        someone.go("compare")
        shown(someone)
        page = someone.page
        page.locator(".side1 .x-main > .x-stage").focus()
        page.keyboard.press("Home")
        someone.until(f"{ONE}.frame.step === {ONE}.manifest.steps[0]")
        page.keyboard.press(" ")
        assert page.evaluate(f"[{ONE}.playing > 0, {OTHER}.playing > 0]") == [True, False]
        someone.until(f"{OTHER}.scene.step === 3")
        page.keyboard.press(" ")
        someone.until(f"{ONE}.frame.step.name === {OTHER}.frame.step.name")


def test_the_map_of_the_difference_has_the_difference_of_the_products(quickstart):
    now, before = results(quickstart)
    with served(quickstart) as app, opened_page(app) as someone:
        someone.go("compare")
        shown(someone)
        page = someone.page
        page.get_by_role("button", name="Difference").click()
        someone.until(f"{OTHER}.manifest.form === 'difference'")
        shown(someone)
        assert page.locator(".caption.side1 .badge").inner_text() == "A − B"
        step, quantity, shape = page.evaluate(f"[{OTHER}.frame.step.name, {OTHER}.quantity, {OTHER}.frame.step.shape]")
        name, (low, quantum) = quantity["name"], quantity["scale"]
        codes = np.array(page.evaluate(f"Array.from({OTHER}.frame.codes)")).reshape(shape)
        found = np.where(codes > 0, low + (codes - 1) * quantum, np.nan)
        one, other = (result.product("total", step)[name] for result in (now, before))
        truth = one - other
        assert (np.isnan(found) == np.isnan(truth)).all()
        assert np.nanmax(np.abs(found - truth)) <= 0.5001 * quantum
        assert np.nanmax(np.abs(truth)) > 100 * quantum
        ends = page.evaluate(f"{OTHER}.range")
        assert ends[0] == -ends[1]
        assert page.evaluate(f"{ONE}.range") != ends
        (k, *_) = middle_of(now.product("total", step), name)
        point_at(someone, k)
        assert page.evaluate(f"{OTHER}.stage.hovered") == k
        assert someone.overlaps() == []


def test_before_and_after_open_from_the_settings(quickstart):
    now, before = results(quickstart)
    with served(quickstart) as app, opened_page(app) as someone:
        page = someone.page
        page.click('#sidebar a[href="#settings/total"]')
        change = page.locator(".change")
        assert change.inner_text() == "total.window: 40.0 → 60.0 px"
        assert someone.overlaps() == []
        page.get_by_role("button", name="See both side by side").focus()
        page.keyboard.press("Enter")
        page.wait_for_selector("section.screen.compare")
        shown(someone)
        assert page.locator(".caption .badge").all_inner_texts() == ["Before", "After"]
        assert "now" in page.inner_text(".caption.side1")
        step, quantity = page.evaluate(f"[{ONE}.frame.step.name, {ONE}.quantity]")
        name, quantum = quantity["name"], quantity["scale"][1]
        one, other = (result.product("total", step)[name].ravel() for result in (before, now))
        (k, *_) = middle_of(now.product("total", step), name)
        point_at(someone, k)
        values = page.evaluate(f"[{ONE}.frame.point({k}).value, {OTHER}.frame.point({k}).value]")
        assert np.abs(np.array(values) - [one[k], other[k]]).max() <= 0.501 * quantum
        said = said_difference(figures(someone), "After - Before")
        assert said == pytest.approx(other[k] - one[k], abs=2e-4)
        assert said * (other[k] - one[k]) >= 0
        page.get_by_role("button", name="Difference").click()
        someone.until(f"{OTHER}.manifest.form === 'difference'")
        shown(someone)
        found = page.evaluate(f"{OTHER}.frame.point({k}).value")
        assert found == pytest.approx(other[k] - one[k], abs=page.evaluate(f"{OTHER}.quantity.scale[1]"))


def test_other_grids_are_read_at_the_same_material(small):
    """The coarser grid's points lie between those of the finer one: the value there is the triangle's."""
    changed(small, "step_size: 5", "step_size: 7")
    now, before = results(small)
    with served(small) as app, opened_page(app) as someone:
        someone.go("compare")
        shown(someone)
        page = someone.page
        step, name = page.evaluate(f"[{ONE}.frame.step.name, {ONE}.quantity.name]")
        coarse, fine = (result.product("total", step) for result in (now, before))
        (k, *_) = middle_of(coarse, name)
        point_at(someone, k)
        hovered = page.evaluate(f"{OTHER}.stage.hovered")
        place = coarse["xy_reference"].reshape(-1, 2)[k]
        apart = np.linalg.norm(fine["xy_reference"] - place, axis=-1)
        assert apart.ravel()[hovered] <= np.nanmin(apart) + 0.1
        text = figures(someone)
        assert "the same material, interpolated" in text
        expected = coarse[name].ravel()[k] - at_place(fine, name, place)
        decimals = len(re.search(r"A - B -?\d+\.(\d+)", text)[1])
        quanta = page.evaluate(f"{ONE}.quantity.scale[1] + {OTHER}.quantity.scale[1]")
        assert abs(said_difference(text) - expected) <= 0.5001 * 10.0**-decimals + 2 * quanta
        page.get_by_role("button", name="Difference").click()
        page.wait_for_selector(".tools .note:has-text('grids differ')")
        assert page.evaluate(f"{OTHER}.manifest.form") == "deformation"
        assert someone.overlaps() == []


def at_place(total, name, place):
    """The value at a place by the plane through three corners of its cell: upper left or lower right triangle."""
    xy, values, size = total["xy_reference"], total[name], total.step_size if hasattr(total, "step_size") else 5.0
    origin = xy[0, 0] if np.isfinite(xy[0, 0]).all() else np.nanmin(xy, axis=(0, 1))
    u, v = (place - origin) / size
    row, col = int(v), int(u)
    a, b = u - col, v - row
    corner = values[row : row + 2, col : col + 2]
    if a + b <= 1:
        return corner[0, 0] + a * (corner[0, 1] - corner[0, 0]) + b * (corner[1, 0] - corner[0, 0])
    return corner[1, 1] + (1 - a) * (corner[1, 0] - corner[1, 1]) + (1 - b) * (corner[0, 1] - corner[1, 1])


def test_products_that_were_cleaned_up_are_said_and_so_is_a_run(small):
    changed(small, "window: 40 px", "window: 60 px")
    pipeline = Pipeline.load(small)
    run = runs(pipeline.store)[-1]
    lost = [entry["digest"] for task, entry in run.index.items() if task.startswith("total/")]
    pipeline.store.manifest_path(lost[-1]).unlink()
    with served(small) as app, opened_page(app) as someone:
        page = someone.page
        someone.go("compare")
        page.wait_for_selector(".tools .note")
        assert f"1 of {len(lost)} products of 'total' of run {run.id} were cleaned up" in page.inner_text(".tools")
        shutil.rmtree(run.folder)
        page.evaluate(f"location.hash = '#compare/with%3D{run.id}'")
        page.wait_for_selector(".card.bad .problem")
        assert f"unknown run '{run.id}'; it was cleaned up" in page.inner_text(".card.bad")
        assert someone.overlaps() == []


def test_without_another_result_the_screen_says_how_to_get_one(measured):
    with served(measured) as app, opened_page(app) as someone:
        someone.go("compare")
        someone.page.get_by_role("button", name="Go to the settings").click()
        someone.page.wait_for_selector("section.screen.settings")


def test_variants_and_other_files_are_chosen_by_keys_alone(small):
    text = small.read_text()
    small.write_text(f"{text}sweep: {{grid: {{total.window: [40 px, 60 px]}}}}\n")
    (small.parent / "other.yaml").write_text(text.replace("window: 40 px", "window: 50 px"))
    for path in (small, small.parent / "other.yaml"):
        measure(path)
    with served(small) as app, opened_page(app) as someone:
        page = someone.page
        page.focus('#sidebar a[href="#compare"]')
        page.keyboard.press("Enter")
        shown(someone)
        assert "total.window = 60 px" in page.inner_text(".caption.side1")
        page.get_by_label("B", exact=True).focus()
        page.keyboard.type("other.yaml")
        page.keyboard.press("Enter")
        someone.until("document.querySelector('.caption.side1').textContent.includes('other.yaml')")
        shown(someone)
        assert page.evaluate("document.activeElement.getAttribute('aria-label')") == "B"
        page.get_by_role("button", name="Difference").focus()
        page.keyboard.press("Enter")
        someone.until(f"{OTHER}.manifest.form === 'difference'")
        shown(someone)
        assert page.evaluate("document.activeElement.textContent") == "Difference"
        step, name = page.evaluate(f"[{OTHER}.frame.step.name, {OTHER}.quantity.name]")
        one, other = (Pipeline.load(path).result().product("total", step)[name] for path in (small, path))
        (k, *_) = middle_of({name: one}, name)
        found, quantum = page.evaluate(f"[{OTHER}.frame.point({k}).value, {OTHER}.quantity.scale[1]]")
        assert abs(found - (one - other).ravel()[k]) <= 0.501 * quantum


def test_the_run_screen_leads_to_a_comparison(quickstart):
    with served(quickstart) as app, opened_page(app) as someone:
        someone.go("run")
        link = someone.page.get_by_role("link", name="Compare run").last
        link.wait_for()
        link.click()
        shown(someone)
        first = runs(Pipeline.load(quickstart).store)[-1]
        assert someone.page.evaluate("decodeURIComponent(location.hash)") == f"#compare/with={first.id}"


def test_the_preview_shows_before_and_after(quickstart):
    with served(quickstart) as app, opened_page(app) as someone:
        page = someone.page
        page.click('#sidebar a[href="#settings/correlation"]')
        page.locator("label.parameter", has_text="subset_size").locator("input").fill("41")
        page.keyboard.press("Tab")
        page.click("text=Preview the grid")
        page.wait_for_selector(".facts thead")
        assert page.locator(".facts thead th").all_inner_texts() == ["", "before", "after"]
        cells = page.locator(".facts tbody tr").first.locator("td").all_inner_texts()
        before, after = (int(cell.split(" of ")[0].replace(",", "")) for cell in cells)
        assert before > after
        scale = page.evaluate("document.querySelector('.viewer').viewer.scale")
        for look, size in (("before", 21), ("over", 41)):
            assert page.locator(f".subset.{look}").bounding_box()["width"] == pytest.approx(size * scale, abs=3)
        assert someone.overlaps() == []


STRANGE = ({"run": "../../etc"}, {"file": "../pipeline.yaml"}, {"minus": {"file": "/etc/passwd"}})


def test_only_runs_and_files_of_the_folder_are_opened(measured):
    with served(measured) as app:
        for asked in STRANGE:
            answer = app.ask("explore", **{"file": FILE, "steps": 5, **asked})
            assert answer.status == 422, (asked, answer.body)


@pytest.mark.parametrize("size", [(1280, 800), (1920, 1080), (390, 844)])
def test_no_texts_overlap_at_any_size(quickstart, size):
    with served(quickstart) as app, opened_page(app, *size) as someone:
        page = someone.page
        page.evaluate("location.hash = '#compare'")
        shown(someone)
        for form in ("deformation", "difference"):
            if form == "difference":
                page.get_by_role("button", name="Difference").click()
            someone.until(f"{OTHER}.manifest.form === '{form}'")
            shown(someone)
            page.wait_for_timeout(300)
            for scheme in someone.schemes():
                assert page.evaluate("document.documentElement.scrollWidth <= innerWidth"), scheme
                assert someone.overlaps() == [], scheme
                assert page.evaluate(CHART_OVERLAPS) == [], scheme
            for axis in page.locator(".x-curve .x-name").all_text_contents():
                assert axis in ("step", "load [g]") or re.fullmatch(r".* \[.+\]", axis), axis
