"""Report and files are those that the command line writes, and nothing else is served."""

from __future__ import annotations

import hashlib

import pytest
from app_browser import opened_page
from app_serving import FILE, served, small_test
from small import dicflow

from dicflow.app.results import REPORT_POLICY

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A small test that the command line has measured."""
    path = small_test(tmp_path_factory.mktemp("results") / "test", steps=3)
    assert dicflow("run", path, "--scheduler", "sync").code == 0
    return path.parent


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
        page.wait_for_selector(".files li", timeout=60_000)
        shown = page.locator(".files li").all_inner_texts()
        assert someone.overlaps() == []
        page.click("text=Write the files")
        page.wait_for_selector(".card .problem", timeout=60_000)
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
        page.wait_for_selector("text=written: results/pipeline/report.html", timeout=120_000)
    assert 'title: "Strip: <first>"' in (folder / FILE).read_text()
    assert "Strip: &lt;first&gt;" in (folder / "results/pipeline/report.html").read_text()


@pytest.mark.parametrize("size", [(1280, 800), (390, 844)])
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_screen_overflows_and_no_texts_overlap(folder, size, scheme):
    with served(folder) as app, opened_page(app, *size, color_scheme=scheme) as someone:
        for screen in ("folder", "region", "settings", "run", "explore", "hand_over"):
            someone.go(screen)
            someone.page.wait_for_timeout(500)
            assert someone.overlaps() == [], screen
            assert someone.page.evaluate("document.documentElement.scrollWidth <= innerWidth"), screen


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
