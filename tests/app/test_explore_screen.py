"""The screen "explore": the fields of results, whose numbers are those of the products."""

from __future__ import annotations

import shutil

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, measure, served, small_test

from dicflow.app import explored
from dicflow.app.project import open_project
from dicflow.core.probes.weights import point_probe, value_of
from dicflow.explorer.packing import LinearScale, LogScale, unpacked
from dicflow.kinds.total import Total
from dicflow.pipeline import Pipeline
from tests.explorer.test_results import PAIR, POINTS, SAMPLES

pytestmark = pytest.mark.slow

EXPLORER = "document.querySelector('.fields').explorer"


@pytest.fixture(scope="module")
def file(small_result, tmp_path_factory):
    """A small test of one camera that the command line has measured."""
    return shutil.copytree(small_result.parent, tmp_path_factory.mktemp("explored") / "test") / FILE


def opened(app, steps=400, **asked):
    return app.found("explore", file=FILE, steps=steps, **asked)


def blob(app, found, step, key, parts=1):
    """Codes of a blob, as the page gets them."""
    entry = found["manifest"]["steps"][step]
    answer = app.own("GET", f"/field/{found['view']}/{entry['blobs'][key]}")
    assert answer.status == 200
    assert answer.headers["cache-control"] == "private, max-age=31536000, immutable"
    return unpacked(answer.body, (*entry["shape"], parts) if parts > 1 else tuple(entry["shape"]))


def screen(app, someone):
    """Go to the screen, and wait until all steps are shown and the last one is drawn."""
    someone.go("explore")
    count = len(opened(app)["manifest"]["steps"])
    someone.until(f"document.querySelector('.fields')?.explorer.manifest.steps.length === {count}")
    someone.page.evaluate(f"{EXPLORER}.ready.then(() => null)")
    someone.drawn()


def test_blobs_are_the_fields_of_the_products_within_the_stated_rounding(file):
    result = Pipeline.load(file).result()
    with served(file) as app:
        found = opened(app)
        for step, entry in enumerate(found["manifest"]["steps"]):
            total = result.product("total", entry["name"])
            assert (blob(app, found, step, "status") == total["status"]).all()
            for quantity in found["manifest"]["quantities"]:
                scale, name = LinearScale(*quantity["scale"]), quantity["name"]
                values = scale.values(blob(app, found, step, f"value/{name}"))
                assert np.allclose(values, total[name], rtol=1e-12, atol=0.5001 * scale.quantum, equal_nan=True)
                for part in quantity["errors"].keys() & {"u", "sigma"}:
                    scale = LogScale(*quantity["errors"][part])
                    errors = scale.values(blob(app, found, step, f"{part}/{name}"))
                    assert np.allclose(errors, total[f"{part}_{name}"], rtol=scale.error + 1e-3, equal_nan=True)
        assert sum(1 for one in found["manifest"]["quantities"] if one["errors"].keys() >= {"u", "sigma"}) >= 5


def test_a_result_is_opened_without_a_photograph_and_shown_further_without_a_plan(file, monkeypatch):
    project, side = open_project(file), explored.Side(FILE)
    monkeypatch.setattr("dicflow.io.images.read_photograph", None)
    found = explored.opened(project, explored.Asked(side, None, 1))["manifest"]
    assert [set(step["photos"]) for step in found["steps"]] == [{"left"}]
    monkeypatch.setattr(Pipeline, "load", None)
    further = explored.opened(project, explored.Asked(side, None, 9), is_more=True)
    assert [step["name"] for step in further["manifest"]["steps"]] == ["step_0001", "step_0002"]
    assert further["steps"] == 2


def test_the_pointer_reads_the_value_of_the_product(file):
    result = Pipeline.load(file).result()
    with served(file) as app, opened_page(app) as someone:
        screen(app, someone)
        page = someone.page
        shown = page.evaluate(f"{EXPLORER}.quantity")
        step = result.steps("total")[page.evaluate(f"{EXPLORER}.scene.step")]
        total = result.product("total", step)
        rows, cols = total["U"].shape
        k = (rows // 2) * cols + cols // 3
        at = page.evaluate(f"{EXPLORER}.stage.shownAt({k})")
        box = page.locator(".x-stage").bounding_box()
        page.mouse.move(box["x"] + at[0] - 40, box["y"] + at[1] - 40)
        page.mouse.move(box["x"] + at[0], box["y"] + at[1], steps=6)
        assert page.evaluate(f"{EXPLORER}.stage.hovered") == k
        read = page.evaluate(f"{EXPLORER}.frame.point({k})")
        assert abs(read["value"] - total[shown["name"]].ravel()[k]) <= 0.5001 * shown["scale"][1]
        assert someone.overlaps() == []


def test_a_curve_is_that_of_the_products(file):
    """At every step the exact number of the product, with its uncertainty."""
    result = Pipeline.load(file).result()
    with served(file) as app, opened_page(app) as someone:
        screen(app, someone)
        page = someone.page
        name = page.evaluate(f"{EXPLORER}.quantity.name")
        totals = [result.product("total", step) for step in result.steps("total")]
        rows, cols = totals[0]["U"].shape
        k = (rows // 2) * cols + cols // 4
        x, y = page.evaluate(f"{EXPLORER}.stage.shownAt({k})")
        box = page.locator(".x-stage").bounding_box()
        page.mouse.move(box["x"] + x - 30, box["y"] + y - 30)
        page.mouse.move(box["x"] + x, box["y"] + y, steps=6)
        page.mouse.down()
        page.mouse.up()
        someone.until(f"{EXPLORER}.points.length === 1")
        curve = page.evaluate(f"{EXPLORER}.fields.curve({EXPLORER}.quantity, {k})")
        assert curve["values"] == [float(total[name].flat[k]) for total in totals]
        assert curve["errors"] == [float(total[f"u_{name}"].flat[k]) for total in totals]
        view = opened(app)["view"]
        lost = np.flatnonzero(np.isnan(totals[0][name]))
        if lost.size:
            found = app.found("curve", view=view, quantity=name, point=int(lost[0]))
            assert found["values"][0] is None
        assert app.found("curve", view=view, quantity=name, point=10**6)["values"] == [None] * len(totals)
        for wrong in ({"quantity": "nothing"}, {"point": -1}, {"view": "0" * 32}):
            assert app.ask("curve", **{"view": view, "quantity": name, "point": 1, **wrong}).status == 422


def test_the_keyboard_goes_from_step_to_step_and_photographs_lie_below(file):
    with served(file) as app, opened_page(app) as someone:
        screen(app, someone)
        page = someone.page
        page.locator(".x-stage").focus()
        page.keyboard.press("Home")
        someone.until(f"{EXPLORER}.scene.step === 0")
        page.keyboard.press("ArrowRight")
        someone.until(f"{EXPLORER}.scene.step === 1")
        someone.until(f"{EXPLORER}.stage.photo.naturalWidth > 100")


def test_photographs_that_are_elsewhere_are_said_to_be_missing(small_result, tmp_path):
    path = shutil.copytree(small_result.parent, tmp_path / "test") / FILE
    (path.parent / "left").rename(tmp_path / "elsewhere")
    with served(path) as app, opened_page(app) as someone:
        screen(app, someone)
        found = opened(app)
        assert "photographs are missing" in " ".join(found["manifest"]["left_out"])
        assert "without photographs" in someone.page.inner_text(".tools .note")
        assert someone.page.evaluate(f"Number.isFinite({EXPLORER}.frame.point({EXPLORER}.frame.cols * 8 + 8).value)")
        assert someone.overlaps() == []


def test_a_variant_of_a_sweep_is_chosen(small_result, tmp_path):
    path = shutil.copytree(small_result.parent, tmp_path / "test") / FILE
    path.write_text(f"{path.read_text()}sweep: {{grid: {{total.window: [40 px, 60 px]}}}}\n")
    measure(path)
    result = Pipeline.load(path).result()
    with served(path) as app, opened_page(app) as someone:
        screen(app, someone)
        for variant in (1, 0):
            someone.page.get_by_label("variant").select_option(str(variant))
            view = opened(app, variant=variant)["view"]
            found = opened(app, variant=variant)
            someone.until(f"{EXPLORER}.photograph.includes('{view}')")
            scale = LinearScale(*next(one["scale"] for one in found["manifest"]["quantities"] if one["name"] == "eyy"))
            values = scale.values(blob(app, found, 1, "value/eyy"))
            total = result.product("total", found["manifest"]["steps"][1]["name"], variant)
            assert np.allclose(values, total["eyy"], rtol=0, atol=0.5001 * scale.quantum, equal_nan=True)


def test_steps_appear_while_a_run_makes_them_and_the_scene_stays(tmp_path):
    path = small_test(tmp_path / "test", steps=5)
    late = [path.parent / "left" / f"step_{number:04}.png" for number in (3, 4)]
    kept = [one.rename(tmp_path / one.name) for one in late]
    measure(path)
    with served(path) as app, opened_page(app) as someone:
        screen(app, someone)
        page = someone.page
        assert "2 of 2 steps" in page.inner_text(".tools")
        page.locator(".x-stage").focus()
        page.keyboard.press("Home")
        page.locator(".x-quantity").select_option(label=page.locator(".x-quantity option").nth(1).inner_text())
        shown = page.evaluate(f"{EXPLORER}.quantity.name")
        for one, place in zip(kept, late, strict=True):
            one.rename(place)
        measure(path)
        page.get_by_role("button", name="Read again").click()
        someone.until("document.querySelector('.tools').innerText.includes('4 of 4 steps')")
        someone.until(f"{EXPLORER}.manifest.steps.length === 4 && {EXPLORER}.scene.step === 0")
        assert page.evaluate(f"{EXPLORER}.quantity.name") == shown


def test_the_curve_over_the_load_begins_at_zero_and_the_probe_lies_on_the_material(sample_result):
    """The extensometer's ends move as the points there do, and are at their first places over the first photograph."""
    result = Pipeline.load(sample_result).result()
    with served(sample_result) as app, opened_page(app) as someone:
        screen(app, someone)
        page = someone.page
        assert "7 of 7 steps, each against the first photograph" in page.inner_text(".tools")
        assert "Yes, the rig is still calibrated" in page.inner_text(".x-rig")
        page.get_by_role("button", name="Load", exact=True).click()
        curve = page.evaluate(f"{EXPLORER}.side.curve.content.series[0]")
        assert (curve["x"][0], curve["y"][0]) == (0, 0)
        assert curve["x"][1:] == pytest.approx(result.product("comparison")["load_g"][1:])
        stretched = page.evaluate(f"{EXPLORER}.manifest.probes[0].places.map(([x, y]) => {EXPLORER}.frame.nowAt(x, y))")
        total = Total.read(result.product("total", result.steps("total")[page.evaluate(f"{EXPLORER}.scene.step")]))
        first = total["xy_reference"].reshape(-1, 2)
        for place, end in zip([(362, 134), (362, 455)], stretched, strict=True):
            near = np.nanargmin(np.hypot(*(first - place).T))
            assert np.hypot(*(total["xy"].reshape(-1, 2)[near] + (place - first[near]) - end)) < 4.0
        page.get_by_role("button", name="Undeformed").click()
        someone.until(f"{EXPLORER}.frame.scene.over === 'first'")
        ends = page.evaluate(
            "[...document.querySelectorAll('.x-probe-end')].map((one) => [one.cx, one.cy].map((v) => v.baseVal.value))"
        )
        places = page.evaluate(
            f"{EXPLORER}.manifest.probes[0].places.map(([x, y]) => {EXPLORER}.stage.window.toPicture(x, y))"
        )
        assert np.abs(np.array(ends) - places).max() < 0.1


def test_the_slider_of_the_steps_reaches_both_ends(file):
    """No padding keeps its handle away from them."""
    with served(file) as app, opened_page(app) as someone:
        screen(app, someone)
        found = someone.page.evaluate(
            "(() => { const look = getComputedStyle(document.querySelector('.x-transport input'));"
            " return ['paddingLeft', 'paddingRight', 'borderLeftWidth', 'borderRightWidth'].map((k) => look[k]); })()"
        )
        assert found == ["0px"] * 4


def test_before_a_run_the_screen_says_where_to_go(tmp_path):
    path = small_test(tmp_path / "test")
    with served(path) as app, opened_page(app) as someone:
        someone.go("explore")
        someone.page.get_by_role("button", name="Go to the run").click()
        someone.page.wait_for_selector("section.screen.run")


def test_only_parts_of_opened_results_are_served(file):
    with served(file) as app:
        view = opened(app)["view"]
        for name in ("99999_0", "0_999", "manifest", "1_right"):
            assert app.own("GET", f"/field/{view}/{name}").status == 422
        for name in (f"{'0' * 32}/0_0", "surveys/0_0"):
            assert app.own("GET", f"/field/{name}").status == 422
        assert app.own("GET", f"/field/../{view}/0_0").status == 404
        assert app.request("GET", f"/field/{view}/0_0", Host=f"127.0.0.1:{app.gate.port}").status == 403
        for name in ("view.js", "source.js", "explorer.css"):
            assert app.own("GET", f"/explorer/{name}").status == 200
        assert app.own("GET", "/explorer/page.py").status == 404


@pytest.fixture
def shape(tmp_path):
    """A pair alone, measured."""
    path = shutil.copytree(SAMPLES, tmp_path / "test") / FILE
    path.write_text(PAIR + POINTS)
    measure(path)
    return path


@pytest.mark.parametrize("form", ["deformation", "shape"])
def test_two_cameras_show_both_photographs_and_a_surface(form, request):
    """A pair alone shows its shape."""
    path = request.getfixturevalue("sample_result" if form == "deformation" else "shape")
    with served(path) as app, opened_page(app) as someone:
        screen(app, someone)
        page = someone.page
        assert opened(app)["manifest"]["form"] == form
        for camera in ("Right", "Left"):
            page.locator(".x-choice").get_by_role("button", name=camera).first.click()
            someone.until(
                f"{EXPLORER}.stage.photo.naturalWidth > 100 && {EXPLORER}.photograph.endsWith('{camera.lower()}')"
            )
        page.locator(".x-choice").get_by_role("button", name="Surface").first.click()
        someone.until(f"{EXPLORER}.frame.places.some(Number.isFinite) && !{EXPLORER}.frame.isFlat")
        assert someone.overlaps() == []


def test_points_and_lines_are_kept_as_probes_where_the_material_lay_at_first(small_result, tmp_path):
    path = shutil.copytree(small_result.parent, tmp_path / "test") / FILE
    with served(path) as app, opened_page(app) as someone:
        screen(app, someone)
        page = someone.page
        result = Pipeline.load(path).result()
        step = result.steps("total")[page.evaluate(f"{EXPLORER}.scene.step")]
        name = page.evaluate(f"{EXPLORER}.quantity.name")
        total = Total.read(result.product("total", step))
        rows, cols = total["U"].shape
        k = (rows // 2) * cols + cols // 2
        box = page.locator(".x-stage").bounding_box()
        x, y = page.evaluate(f"{EXPLORER}.stage.shownAt({k})")
        page.mouse.move(box["x"] + x - 30, box["y"] + y - 30)
        page.mouse.move(box["x"] + x, box["y"] + y, steps=6)
        page.mouse.down()
        page.mouse.up()
        page.get_by_role("button", name="Keep the point").click()
        someone.said("saved: point_1")
        page.get_by_role("button", name="Line", exact=True).click()
        page.get_by_role("button", name="Keep as extensometer").click()
        someone.said("saved: extensometer_1")
        line = np.array(page.evaluate(f"{EXPLORER}.scene.line"))
        assert someone.overlaps() == []
        kept = Pipeline.load(path).document.data["stages"]["probes"]
        at_first = total["xy_reference"].reshape(-1, 2)[k]
        assert np.abs(np.array(kept["points"]["point_1"]) - at_first).max() <= 0.006
        moved = np.array([np.nanmean(total[one]) for one in "UV"])
        assert np.abs(np.array(kept["extensometers"]["extensometer_1"]) + moved - line).max() < 0.1
        measure(path)
        page.get_by_role("button", name="Read again").click()
        someone.until(f"{EXPLORER}.manifest.curves.length === 2")
        curves = {one["name"]: one for one in opened(app)["manifest"]["curves"]}
        probes = Pipeline.load(path).result().product("probes")
        assert curves["point_1"]["quantity"] == name
        assert np.array_equal(curves["point_1"]["values"], probes[name][0])
        assert np.array_equal(curves["extensometer_1"]["values"], probes["strain"][0])
        number = curves["point_1"]["numbers"].index(page.evaluate(f"{EXPLORER}.scene.step") + 1)
        spread = np.nanmax(total[name]) - np.nanmin(total[name])
        probe = point_probe(total["xy_reference"], np.isfinite(total["U"]), at_first, total.step_size)
        expected = value_of(probe, total[name])
        assert abs(curves["point_1"]["values"][number] - expected) < 5e-3 * spread
        page.keyboard.press("Control+z")
        someone.said("taken back: probes")
        assert "extensometers" not in Pipeline.load(path).document.data["stages"]["probes"]
