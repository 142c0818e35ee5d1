"""The app in headless Chromium by Playwright, and a mouse that moves as a person's."""

from __future__ import annotations

import re
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from app_serving import Served
from waiting import PATIENCE_S

__all__ = ["FLAGS", "IS_SHOWN", "Person", "close_browser", "opened_page"]

PICTURES = Path(__file__).resolve().parents[1] / "build" / "app"
"""For a person's eyes."""

FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync", "--disable-dev-shm-usage",
)  # fmt: skip
OVERLAPS = """
() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  const texts = [];
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const around = node.parentElement;
    if (!node.data.trim() || around.closest("svg, option, script, noscript, .skip, #messages")) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    for (const box of range.getClientRects()) {
      const at = document.elementFromPoint(box.x + box.width / 2, box.y + box.height / 2);
      if (box.width > 1 && at && around.contains(at)) texts.push([node.data.trim(), box]);
    }
  }
  const found = [];
  texts.forEach(([one, a], k) => texts.slice(k + 1).forEach(([other, b]) => {
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (wide > 2 && high > 4) found.push([one, other]);
  }));
  return found;
}
"""

IS_SHOWN = """(({ photograph, canvas, size }) =>
  photograph && canvas.width === Math.max(1, Math.round(size[0] * (devicePixelRatio || 1))))
  (document.querySelector(".viewer").viewer)"""
"""Whether the viewer has its photograph, and has taken the size that it has in the window."""

_IS_DRAWN = """[...document.querySelectorAll(".fields")].every(({ explorer: { stage: { canvas, size } } }) =>
  [canvas.width, canvas.height].every((side, k) => side === Math.round(size[k] * Math.min(2, devicePixelRatio))))"""
"""Whether the picture of each explorer has the size of its place in the window."""


class Person:
    """Somebody at the page: moves the mouse in small steps, types, and sees photographs at places in px."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.errors: list[str] = []
        page.on("pageerror", lambda error: self.errors.append(str(error)))

    def go(self, screen: str) -> None:
        """Go to a screen by its link."""
        self.page.click(f'#sidebar a[href="#{screen}"]')
        self.page.wait_for_selector(f"section.screen.{screen}")

    def at(self, place: Sequence[float]) -> tuple[float, float]:
        """Where a place of the photograph lies on the screen, once the photograph is there."""
        self.until(IS_SHOWN)
        x, y = self.page.evaluate(
            "([x, y]) => { const v = document.querySelector('.viewer'); const b = v.getBoundingClientRect();"
            " const [a, c] = v.viewer.toScreen([x, y]); return [a + b.left, c + b.top]; }", list(place),
        )  # fmt: skip
        return x, y

    def click(self, place: Sequence[float]) -> None:
        """Click on a place of the photograph."""
        self.page.mouse.move(*self.at(place), steps=8)
        self.page.mouse.down()
        self.page.mouse.up()

    def drag(self, start: Sequence[float], end: Sequence[float]) -> None:
        """Drag from one place of the photograph to another."""
        self.page.mouse.move(*self.at(start), steps=8)
        self.page.mouse.down()
        self.page.mouse.move(*self.at(end), steps=12)
        self.page.mouse.up()

    def draw_extensometer(self, places: Sequence[Sequence[float]]) -> None:
        """On the screen of the region, the first extensometer of this person, between two places of the photograph."""
        self.page.focus(".viewer")
        self.page.keyboard.press("e")
        for place in places:
            self.click(place)
        self.said("saved: extensometer_1")

    def compare_lengths_of(self, extensometer: str) -> None:
        """Choose what the caliper is compared with."""
        self.go("caliper")
        self.page.get_by_label("extensometer").select_option(extensometer)
        self.said("saved: extensometer of the comparison")

    def drawn(self) -> None:
        """Wait until the picture of each explorer is drawn in the size of its place in the window."""
        self.until(_IS_DRAWN)

    def said(self, words: str) -> None:
        """Wait for a message, and close it."""
        message = self.page.locator("#messages .message", has_text=words)
        message.first.wait_for()
        message.first.locator("button").click()

    def schemes(self) -> Iterator[str]:
        """The names of both colour schemes, each while the page is shown in it."""
        for scheme in ("light", "dark"):
            self.page.emulate_media(color_scheme=scheme)
            yield scheme

    def until(self, condition: str) -> None:
        """Wait until a condition in JavaScript holds; the page's own policy forbids to evaluate text inside it.

        What it asks about may not be there yet.
        """
        end = time.monotonic() + PATIENCE_S
        while not self.page.evaluate(f"(() => {{ try {{ return {condition}; }} catch {{ return false; }} }})()"):
            assert time.monotonic() < end, condition
            self.page.wait_for_timeout(20)

    def tab(self) -> Person:
        """The same person at another tab of the browser, on the same screen."""
        page = self.page.context.new_page()
        other = Person(page)
        page.goto(self.page.url)
        page.wait_for_selector("body[data-ready]")
        return other

    def picture(self, name: str) -> None:
        """Keep a picture of the window."""
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=str(PICTURES / f"{name}.png"))

    def axes_without_unit(self) -> list[str]:
        """Names of axes that have neither a unit nor count steps."""
        names = self.page.evaluate("[...document.querySelectorAll('.x-name')].map((one) => one.textContent)")
        return [name for name in names if not re.search(r"\[.+\]$", name) and not name.startswith("step")]

    def overlaps(self) -> list[list[str]]:
        """Pairs of texts that lie upon one another."""
        return self.page.evaluate(OVERLAPS)


_running: list[Any] = []
"""The driver and its browser, while tests of the app's page go on."""


@contextmanager
def opened_page(app: Served, width: int = 1280, height: int = 800, **options: Any) -> Iterator[Person]:
    """The app's page, in a session of its own; the test is skipped without Playwright or Chromium."""
    session = _browser().new_context(viewport={"width": width, "height": height}, **options)
    session.set_default_timeout(1000 * PATIENCE_S)
    try:
        page = session.new_page()
        person = Person(page)
        page.goto(app.gate.link)
        page.wait_for_selector("body[data-ready]")
        yield person
        assert person.errors == []
    finally:
        session.close()


def _browser() -> Any:
    """The browser of all tests; it starts with the first."""
    playwright = pytest.importorskip("playwright.sync_api", reason="needs Playwright, of the extra dev")
    program = shutil.which("chromium")
    if program is None:
        pytest.skip("needs the program chromium")
    if _running and not _running[1].is_connected():  # it died under an earlier test
        close_browser()
    if not _running:
        driver = playwright.sync_playwright().start()
        _running.extend([driver, driver.chromium.launch(executable_path=program, args=list(FLAGS))])
    return _running[1]


def close_browser() -> None:
    """End the browser; its driver has an event loop, which would be in the way of other tests."""
    if _running:
        driver, browser = _running
        _running.clear()
        browser.close()
        driver.stop()
