"""The keyboard alone does the whole way: region, extensometer, setting, run, stop, fields, lengths, report."""

from __future__ import annotations

import pytest
from app_browser import IS_SHOWN, opened_page
from app_serving import served, small_test

from dicflow.io.caliper import read_caliper
from dicflow.io.configuration import read
from dicflow.kinds.total import Total
from dicflow.pipeline import Pipeline

pytestmark = pytest.mark.slow
MOST_TABS = 150
NAME = """
() => {
  const one = document.activeElement;
  const label = one.labels?.[0]?.textContent ?? one.closest("label")?.textContent ?? "";
  return [one.tagName.toLowerCase(), one.getAttribute("aria-label") || one.innerText || label || one.title || ""];
}
"""


class Keys:
    """Somebody without a mouse: goes from control to control with Tab, and presses keys there."""

    def __init__(self, someone) -> None:
        self.someone, self.page = someone, someone.page

    def reach(self, words, tag="") -> None:
        """Press Tab until a control with these words has the focus."""
        for _ in range(MOST_TABS):
            self.page.keyboard.press("Tab")
            found, name = self.page.evaluate(NAME)
            if name.strip().startswith(words) and tag in ("", found):
                return
        raise AssertionError(f"no control '{words}' is reached with Tab")

    def press(self, *keys) -> None:
        for key in keys:
            self.page.keyboard.press(key)

    def choose(self, words) -> None:
        """Press Enter on a control."""
        self.reach(words)
        self.press("Enter")

    def go(self, title, screen) -> None:
        """Go to a screen by its link."""
        self.reach(title, "a")
        self.press("Enter")
        self.page.wait_for_selector(f"section.screen.{screen}")

    def type(self, words, text) -> None:
        """Type a text over what a field has."""
        self.reach(words)
        self.press("Control+a")
        self.page.keyboard.type(text)
        self.press("Tab")


EXPLORER = "document.querySelector('.fields').explorer"


def places_an_extensometer(keys, path):
    """With the cross of the drawing, 40 px above and below the middle."""
    keys.go("Region and probes", "region")
    keys.page.wait_for_selector(".viewer")
    keys.someone.until(IS_SHOWN)
    keys.reach("", "div")
    keys.press("e", *["ArrowUp"] * 4, "Enter", *["ArrowDown"] * 8, "Enter")
    keys.page.wait_for_selector("text=saved: extensometer_1")
    top, bottom = read(path).data["stages"]["probes"]["extensometers"]["extensometer_1"]
    assert (top[0], bottom[1] - top[1]) == (bottom[0], pytest.approx(80.0, abs=0.1))


def changes_a_setting(keys, path):
    keys.go("Settings", "settings")
    keys.reach("total: ", "a")
    keys.press("Enter")
    keys.page.wait_for_selector(".parameter")
    keys.type("window", "60 px")
    keys.page.wait_for_selector(".would")
    keys.choose("Save to the file")
    keys.someone.until("document.querySelector('.pending') && !document.querySelector('.would')")
    assert read(path).data["stages"]["total"]["window"] == "60 px"


def runs(keys):
    keys.go("Run", "run")
    keys.page.wait_for_selector("h1.state.none")
    keys.choose("Start")
    keys.page.wait_for_selector("h1.state.done")


def reads_and_keeps_a_point(keys, path):
    keys.go("Explore", "explore")
    keys.someone.until("document.querySelector('.fields')?.explorer.firstDrawn > 0")
    keys.someone.until(f"{EXPLORER}.manifest.steps.length === 2")
    keys.reach("", "div")
    keys.press("Home", "Shift+ArrowRight", "Shift+ArrowDown", "Enter")
    keys.someone.until(f"{EXPLORER}.points.length === 1")
    k = keys.page.evaluate(f"{EXPLORER}.points[0].index")
    keys.choose("Keep the point")
    keys.someone.until(f"{EXPLORER}.manifest.probes.length === 2")
    total = Total.read(Pipeline.load(path).result().product("total", 1))
    kept = read(path).data["stages"]["probes"]["points"]["point_1"]
    assert kept == pytest.approx(total["xy_reference"].reshape(-1, 2)[k], abs=0.006)


def compares_with_a_caliper(keys, path):
    keys.go("Caliper", "caliper")
    for step, length in enumerate(("60", "60,05", "60")):
        keys.type(f"load at step_{step:04}", str(10 * step))
        keys.type(f"length at step_{step:04}", length)
    keys.choose("Save the lengths")
    keys.page.wait_for_selector("text=Compute the comparison")
    assert read_caliper(path.parent / "caliper.csv").length_mm.tolist() == [60.0, 60.05, 60.0]
    keys.choose("Compute the comparison")
    keys.page.wait_for_selector(".x-chart polyline")


def hands_over(keys, path):
    keys.go("Hand over", "hand_over")
    keys.page.wait_for_selector(".fact")
    keys.type("title", "By keys")
    keys.someone.until("document.querySelector('#sidebar strong').textContent === 'By keys'")
    keys.choose("Write the report")
    keys.page.wait_for_selector("text=written: results/pipeline/report.html")
    assert "By keys" in (path.parent / "results/pipeline/report.html").read_text()


def test_the_keyboard_alone_goes_the_whole_way(tmp_path):
    path = small_test(tmp_path / "test", steps=3)
    with served(path) as app, opened_page(app) as someone:
        keys = Keys(someone)
        places_an_extensometer(keys, path)
        changes_a_setting(keys, path)
        runs(keys)
        reads_and_keeps_a_point(keys, path)
        compares_with_a_caliper(keys, path)
        hands_over(keys, path)
        keys.press("Control+z")
        someone.said("taken back: title")
        assert "title" not in read(path).data


def test_the_focus_stays_where_it_is_when_the_sidebar_is_drawn_again(tmp_path):
    """It is drawn again when the server has said what a run would compute, which waits here until a link is focused."""
    link = '#sidebar a[href="#settings"]'
    with served(small_test(tmp_path)) as app, opened_page(app) as someone:
        page, waiting = someone.page, []
        page.route("**/plan*", lambda route: waiting.append(route))
        page.reload()
        page.wait_for_selector("body[data-ready]")
        page.focus(link)
        page.evaluate(f"document.querySelector('{link}').isOld = true")
        while not waiting:
            page.wait_for_timeout(50)
        for one in waiting:
            one.continue_()
        someone.until(f"!document.querySelector('{link}').isOld")
        assert page.evaluate("document.activeElement.getAttribute('href')") == "#settings"
