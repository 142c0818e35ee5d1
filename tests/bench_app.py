"""Speed and memory of the app with long tests and large photographs; run it with python -m tests.bench_app.

A folder with 3,000 small photographs and one with photographs of 12 megapixels are made, and opened in headless
Chromium.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from app_browser import FLAGS
from app_serving import small_test

STEPS = 3000
LARGE = (4000, 3000)
MOST_MB = 500
FRAMES = """
async () => {
  const viewer = document.querySelector('.viewer').viewer;
  const took = [];
  for (let k = 0; k < 60; k++) {
    const start = performance.now();
    if (k % 20 < 10) viewer.panBy(35, 20); else viewer.zoomAt(null, k % 2 ? 1.25 : 0.82);
    await new Promise(requestAnimationFrame);
    viewer.drawNow();
    took.push(performance.now() - start);
  }
  took.sort((a, b) => a - b);
  return [took[30], took[57]];
}
"""


def main() -> None:
    """Print the figures; the exit code is 1 where the memory is beyond its bar."""
    folder = Path(tempfile.mkdtemp())
    try:
        peak = max(_measured(folder / "long", STEPS, (64, 64)), _measured(folder / "large", 3, LARGE))
    finally:
        shutil.rmtree(folder)
    sys.exit(peak > MOST_MB)


def _measured(folder: Path, steps: int, size: tuple[int, int]) -> float:
    """Peak memory of the app's process [MB] for one test, whose times are printed."""
    path = small_test(folder, steps, size)
    if size[0] < 100:
        path.write_text(path.read_text().replace("[20, 20, 180, 130]", "[4, 4, 58, 58]"))
    print(f"{steps} steps of {size[0]} × {size[1]} px")
    command = [sys.executable, "-m", "dicflow", "app", folder, "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as app:
        assert app.stdout is not None
        try:
            _look(app.stdout.readline().strip())
            peak = _peak_mb(app.pid)
        finally:
            app.terminate()
    print(f"  memory of the app's process, peak     {peak:8.0f} MB")
    return peak


def _look(link: str) -> None:
    from playwright.sync_api import sync_playwright

    with sync_playwright() as driver:
        browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=list(FLAGS))
        page = browser.new_page(viewport={"width": 1280, "height": 800})
        _timed("first time: page with its photograph", lambda: _open(page, link))
        page.wait_for_timeout(1500)
        _timed("again: page with its photograph", lambda: _open(page, link))
        frames = page.evaluate(FRAMES)
        print(f"  a frame of pan and zoom, median, 95 %  {frames[0]:7.1f} ms {frames[1]:.1f} ms")
        for screen in ("settings", "run", "folder"):
            _timed(f"screen {screen}", lambda screen=screen: _go(page, screen))  # type: ignore[misc]
        browser.close()


def _open(page: Any, link: str) -> None:
    page.goto(link)
    page.wait_for_selector("body[data-ready]")
    page.wait_for_selector(".viewer")
    while not page.evaluate(
        "[...document.querySelector('.viewer').viewer.tiles.values()].some((one) => one.naturalWidth)"
    ):
        page.wait_for_timeout(20)


def _go(page: Any, screen: str) -> None:
    ready = {"settings": "table", "run": "h1.state", "folder": ".pair img"}[screen]
    page.click(f'#sidebar a[href="#{screen}"]')
    page.wait_for_selector(f"section.{screen} {ready}")


def _timed(words: str, call: Any) -> None:
    start = time.perf_counter()
    call()
    print(f"  {words:37} {time.perf_counter() - start:8.2f} s")


def _peak_mb(pid: int) -> float:
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1000


if __name__ == "__main__":
    os.environ.setdefault("PYTHONUNBUFFERED", "1")
    main()
