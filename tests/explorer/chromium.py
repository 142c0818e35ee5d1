"""The explorer in headless Chromium, moved by the mouse and the keyboard."""

from __future__ import annotations

import shutil
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from tests.waiting import PATIENCE_S

__all__ = ["PICTURES", "Seen", "Tabs", "program"]

_FLAGS = (
    "--no-sandbox --disable-quic --no-first-run --disable-background-networking --disable-component-update "
    "--disable-sync"
)
_WEBGL = {True: "--use-angle=swiftshader --enable-unsafe-swiftshader", False: "--disable-gpu --disable-3d-apis"}
_SLOW_IS_FINE = """
const { getParameter } = WebGLRenderingContext.prototype;
WebGLRenderingContext.prototype.getParameter = function (name) {
  return name === 0x9246 ? "some card" : getParameter.call(this, name);
};
"""
"""Hides the name of the renderer, so that WebGL is used although this machine computes it by software."""
PICTURES = Path(__file__).resolve().parents[2] / "build" / "explorer"
"""For a person's eyes."""

_OVERLAPS = """() => {
  const texts = [...document.querySelectorAll("body *")].filter((one) =>
    one.checkVisibility({ visibilityProperty: true })
    && !one.closest(".x-unseen, option, .x-canvas, noscript, script, style, .x-overlay")
    && [...one.childNodes].some((node) => node.nodeType === 3 && node.data.trim()));
  const boxes = texts.flatMap((one) => {
    const range = document.createRange();
    return [...one.childNodes].filter((node) => node.nodeType === 3 && node.data.trim()).flatMap((node) => {
      range.selectNodeContents(node);
      return [...range.getClientRects()].map((box) => [one, box]);
    });
  }).filter(([, box]) => box.width > 1 && box.height > 1);
  const found = [];
  boxes.forEach(([one, a], k) => boxes.slice(k + 1).forEach(([other, b]) => {
    if (one.contains(other) || other.contains(one) || one.closest("nav") !== other.closest("nav")) return;
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (wide > 1 && high > 3) found.push([one.textContent.slice(0, 40), other.textContent.slice(0, 40)]);
  }));
  return found;
}"""


def program() -> str | None:
    """The browser's program; None if it is missing."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next((path for name in names if (path := shutil.which(name))), None)


class Seen:
    """A page with an explorer. ``page`` is playwright's; ``complaints`` what the console said."""

    def __init__(self, page: Any) -> None:
        self.page = page
        self.complaints: list[str] = []
        self.requests: list[str] = []
        page.on(
            "console", lambda message: message.type in ("error", "warning") and self.complaints.append(message.text)
        )
        page.on("pageerror", lambda error: self.complaints.append(str(error)))
        page.on("request", lambda request: self.requests.append(request.url))

    def show(self, address: str) -> None:
        """Open an address and wait until the first field is drawn."""
        self.requests.clear()
        self.page.goto(address)
        self.settled()

    def settled(self) -> None:
        """Wait until all that was asked of the explorer is drawn."""
        self.js("explorer.ready")

    def js(self, expression: str) -> Any:
        """The value of an expression, in which ``explorer`` is the explorer; a promise is awaited."""
        return self.page.evaluate(
            "(async () => { const { explorer } = document.querySelector('.explorer'); "
            f"return await ({expression}); }})()"
        )

    def at(self, x: float, y: float) -> tuple[float, float]:
        """Where a place of the photograph lies in the window [CSS px]."""
        self.page.locator(".x-stage").scroll_into_view_if_needed()
        left, top = self.js(f"explorer.stage.window.toPicture({x}, {y})")
        box = self.page.locator(".x-stage").bounding_box()
        return box["x"] + 1 + left, box["y"] + 1 + top

    def hover(self, x: float, y: float) -> str:
        """Rest the mouse on a place of the photograph; returns the text beside it, empty for none."""
        self.page.mouse.move(*self.at(x, y), steps=3)
        tip = self.page.locator(".x-stage > .x-tip")
        return tip.inner_text() if tip.is_visible() else ""

    def until(self, expression: str) -> None:
        """Wait until an expression is true."""
        end = time.monotonic() + PATIENCE_S
        while not self.js(expression):
            assert time.monotonic() < end, expression
            self.page.wait_for_timeout(20)

    def press(self, *keys: str) -> None:
        """Press keys, one after another, while the picture has the focus."""
        self.page.locator(".x-stage").focus()
        for key in keys:
            self.page.keyboard.press(key)
            self.settled()

    def toggle(self, text: str) -> None:
        """Press a button by its text."""
        self.page.locator(".explorer button", has_text=text).first.click()
        self.settled()

    def pixel(self, x: float, y: float) -> list[int]:
        """Red, green, blue and opacity of the field at a place of the photograph."""
        found: list[int] = self.js(
            f"""(() => {{
              const [x, y] = explorer.stage.window.toPicture({x}, {y});
              const copy = document.createElement("canvas");
              const {{ canvas }} = explorer.stage;
              [copy.width, copy.height] = [canvas.width, canvas.height];
              const context = copy.getContext("2d", {{ willReadFrequently: true }});
              context.drawImage(canvas, 0, 0);
              const ratio = canvas.width / explorer.stage.size[0];
              return [...context.getImageData(Math.floor(x * ratio), Math.floor(y * ratio), 1, 1).data];
            }})()"""
        )
        return found

    def overlaps(self) -> list[list[str]]:
        """Pairs of texts that lie over each other."""
        found: list[list[str]] = self.page.evaluate(_OVERLAPS)
        return found

    def picture(self, name: str, whole: bool = False) -> None:
        """Keep a picture of the window, or of the whole page, for a person."""
        PICTURES.mkdir(parents=True, exist_ok=True)
        self.page.screenshot(path=str(PICTURES / f"{name}.png"), full_page=whole)


class Tabs:
    """Tabs of headless browsers, with WebGL and without, until the block ends."""

    def __enter__(self) -> Tabs:
        api = pytest.importorskip("playwright.sync_api", reason="needs playwright, of the extra 'dev'")
        if program() is None:
            pytest.skip("needs chromium on the PATH")
        self._playwright = api.sync_playwright().start()
        self._browsers: dict[bool, Any] = {}
        return self

    def __exit__(self, *given: object) -> None:
        for browser in self._browsers.values():
            browser.close()
        self._playwright.stop()

    @contextmanager
    def open(self, webgl: bool = True, **options: Any) -> Iterator[Seen]:
        """A tab. options : of playwright's new_page, such as viewport and color_scheme"""
        if webgl not in self._browsers:
            launch = self._playwright.chromium.launch
            self._browsers[webgl] = launch(executable_path=program(), args=[*_FLAGS.split(), *_WEBGL[webgl].split()])
        page = self._browsers[webgl].new_page(**{"viewport": {"width": 1280, "height": 800}, **options})
        page.set_default_timeout(1000 * PATIENCE_S)
        if webgl:
            page.add_init_script(_SLOW_IS_FINE)
        yield Seen(page)
        page.close()
