"""Report and files are those that the command line writes, and nothing else is served."""

from __future__ import annotations

import hashlib
import shutil

import numpy as np
import pytest
from app_browser import opened_page
from app_serving import FILE, served, small_test
from PIL import Image
from small import dicflow

from dicflow.app.results import REPORT_POLICY
from dicflow.io.configuration import read
from dicflow.kinds.kind import summary_of
from dicflow.kinds.total import Total
from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow


SIZES = [(1280, 800), (1920, 1080), (390, 844)]


@pytest.fixture(scope="module")
def folder(small_result, tmp_path_factory):
    """A small test that the command line has measured."""
    return shutil.copytree(small_result.parent, tmp_path_factory.mktemp("results") / "test")


@pytest.fixture(scope="module")
def sweep(tmp_path_factory):
    """A small test with three windows and two subsets, measured."""
    path = small_test(tmp_path_factory.mktemp("sweep") / "test")
    grid = "sweep: {grid: {correlation.subset_size: [21, 31], total.window: [30 px, 50 px, 70 px]}}\n"
    path.write_text(path.read_text() + grid)
    assert dicflow("run", path, "--scheduler", "sync").code == 0
    return path


def test_the_report_opens_as_a_page_that_can_ask_the_app_nothing(folder):
    with served(folder) as app, opened_page(app) as someone:
        answer = app.own("GET", f"/report?file={FILE}")
        assert answer.headers["content-security-policy"] == REPORT_POLICY
        assert "allow-same-origin" not in REPORT_POLICY
        someone.go("hand_over")
        with someone.page.context.expect_page() as opened:
            someone.page.click("text=Open the report")
        page = opened.value
        page.wait_for_load_state()
        assert page.evaluate("self.origin") == "null"
        asked = page.evaluate(
            "url => fetch(url, {method: 'POST', body: '{}'}).then((found) => found.status, (error) => String(error))",
            f"http://127.0.0.1:{app.gate.port}/ask/project",
        )
        assert "TypeError" in asked


def test_files_are_those_of_export(folder, tmp_path):
    assert dicflow("export", folder / FILE, "--output", tmp_path / "direct").code == 0
    with served(folder) as app, opened_page(app) as someone:
        someone.go("hand_over")
        page = someone.page
        page.click("text=Write the files")
        page.wait_for_selector(".files li")
        shown = page.locator(".files li").all_inner_texts()
        assert someone.overlaps() == []
        page.click("text=Write the files")
        page.wait_for_selector(".card .problem")
        assert "exists; add --force" in page.inner_text(".card .problem")
        assert app.ask("export", file=FILE, format="csv", folder="../out").status == 422
        assert app.ask("export", file=FILE, format="nothing", folder="x").status == 422
    direct = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in (tmp_path / "direct").iterdir()}
    written = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in (folder / "export").iterdir()}
    assert written == direct
    assert sorted(shown) == sorted(f"export/{name}" for name in direct)


def test_the_title_and_the_report_are_written(folder):
    with served(folder) as app, opened_page(app) as someone:
        someone.go("hand_over")
        page = someone.page
        page.get_by_label("title").fill("Strip: <first>")
        page.keyboard.press("Tab")
        someone.said("saved: title")
        page.click("text=Write the report")
        page.wait_for_selector("text=written: results/pipeline/report.html")
    assert 'title: "Strip: <first>"' in (folder / FILE).read_text()
    assert "Strip: &lt;first&gt;" in (folder / "results/pipeline/report.html").read_text()


def field(someone, fact):
    return someone.page.locator(f".fact:has(.key:text-is('{fact}')) textarea, .fact:has(.key:text-is('{fact}')) input")


def state(someone, fact, words):
    """Fill in a field of the form and leave it."""
    field(someone, fact).fill(words)
    someone.page.keyboard.press("Tab")
    someone.said(f"saved: report.{fact}")


def test_what_the_report_states_is_filled_in_and_taken_away(folder):
    path = folder / FILE
    before = path.read_text()
    Image.fromarray(np.full((20, 60, 3), (200, 30, 30), np.uint8)).save(folder / "logo.png")
    stated = {
        "specimen": 'strip <b>"A"</b>: 20 × 100 mm, rubber',
        "camera": "two phones \\ 12 megapixels",
        "lens": "50",
        "light": "# two lamps",
        "operator": "O'Brien",
        "logo": "logo.png",
    }
    with served(folder) as app, opened_page(app) as someone:
        someone.go("hand_over")
        page = someone.page
        for fact, words in stated.items():
            state(someone, fact, words.replace("megapixels", "\n megapixels\n"))
        someone.picture("facts_1280")
        assert "6 of 13 filled in" in page.inner_text("section.hand_over")
        assert read(path).data["report"] == stated
        kept = path.read_text()
        assert kept.startswith(before)
        assert kept.removeprefix(before).splitlines()[0] == "report:"
        assert len(kept.removeprefix(before).splitlines()) == 1 + len(stated)
        field(someone, "logo").fill("../logo.png")
        page.keyboard.press("Tab")
        someone.said("report.logo: must be a path below the pipeline file's folder")
        assert path.read_text() == kept
        assert field(someone, "logo").input_value() == "logo.png"
        page.click("text=Write the report")
        page.wait_for_selector("text=written: results/pipeline/report.html")
        report = (folder / "results/pipeline/report.html").read_text()
        for words in ("strip &lt;b&gt;&#34;A&#34;&lt;/b&gt;: 20 × 100 mm, rubber", "O&#39;Brien", "# two lamps"):
            assert words in report
        page.reload()
        page.wait_for_selector(".fact")
        assert {fact: field(someone, fact).input_value() for fact in stated} == stated
        for fact in stated:
            state(someone, fact, "")
    assert path.read_text() == before


def test_noise_against_resolution_of_a_sweep_is_that_of_the_products(sweep):
    result = Pipeline.load(sweep).result()
    totals = [Total.read(result.product("total", -1, variant)) for variant in range(len(result.values))]
    with served(sweep) as app, opened_page(app) as someone:
        someone.go("settings")
        page = someone.page
        page.wait_for_selector(".variants")
        rows = [row.split("\t") for row in page.inner_text(".variants tbody").splitlines()]
        head = page.inner_text(".variants thead").split("\t")
        assert head[1:3] == ["virtual strain gauge [px]", "σ of εxx [–]"]
        assert len(rows) == len(totals) == 6
        for row, total in zip(rows, totals, strict=True):
            assert float(row[1]) == pytest.approx(total.gauge.side_px, rel=5e-3)
            assert float(row[2]) == pytest.approx(summary_of(total.product)["sigma_exx"], rel=5e-3)
        marks = page.locator(".chart-place svg > circle")
        assert marks.count() == 6 * (len(head) - 2)
        assert page.locator(".chart-place title").first.text_content() == rows[0][0]
        assert "virtual strain gauge [px]" in page.locator(".chart-place").inner_text()
        someone.picture("resolution_1280")
        assert someone.overlaps() == []
        page.locator(".variants a").nth(3).click()
        page.wait_for_selector("section.explore .fields")
        assert page.get_by_label("variant").input_value() == "3"


@pytest.mark.parametrize("size", SIZES)
def test_no_screen_overflows_and_no_texts_overlap(folder, sweep, size):
    screens = {"folder": ".pair", "region": ".path-name", "settings": "table", "run": "table", "explore": ".x-stage"}
    for path, shown in ((folder / FILE, {**screens, "hand_over": ".fact"}), (sweep, {"settings": ".variants"})):
        with served(path) as app, opened_page(app, *size) as someone:
            for screen, ready in shown.items():
                someone.go(screen)
                someone.page.wait_for_selector(f"section.{screen} {ready}")
                if screen == "region":
                    someone.page.click(ready)
                someone.page.wait_for_timeout(150)
                for scheme in someone.schemes():
                    someone.picture(f"{path.parent.parent.name[:5]}_{screen}_{size[0]}_{scheme}")
                    assert someone.overlaps() == [], (screen, scheme)
                    assert someone.page.evaluate("document.documentElement.scrollWidth <= innerWidth"), (screen, scheme)
                assert someone.axes_without_unit() == [], screen


def test_every_control_has_a_name(folder):
    unnamed = """[...document.querySelectorAll("button, a, input, select, textarea")].filter((one) =>
      !(one.innerText || one.getAttribute("aria-label") || one.labels?.length || one.title))
      .map((one) => one.outerHTML)"""
    with served(folder) as app, opened_page(app) as someone:
        for screen in ("folder", "region", "settings", "run", "explore", "hand_over"):
            someone.go(screen)
            someone.page.wait_for_timeout(300)
            assert someone.page.evaluate(unnamed) == [], screen
        someone.page.click('#sidebar a[href="#settings/correlation"]')
        someone.page.wait_for_selector(".parameter")
        assert someone.page.evaluate(unnamed) == []
