"""Speed and memory of the app with long tests and large photographs; run it with python -m tests.bench_app.

Photographs of 12 megapixels, fields of 50,000 points, and 22, 200 and 3,000 steps are made and opened in headless
Chromium, which draws by the processor. Each figure is printed beside its bar as it comes; the exit code is 1 where one
is missed. Times are of the wall clock, so nothing else may run meanwhile. Memory is that of all processes of the app.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).parent))

from app_browser import FLAGS

from tests.bars import Figure
from tests.figures import report
from tests.long_result import environment, long_results

STEPS = (22, 200, 3000)
MOST_MB, PAINT_MS, CHANGE_MS, HOVER_MS, FRAME_MS = 500.0, 2000.0, 150.0, 50.0, 50.0
"""Of the longest quantity."""
EXPLORER = "document.querySelector('.fields').explorer"
CHANGED = f"""
async () => {{
  const started = performance.now();
  await {EXPLORER}.change({{ step: 1 }});
  return performance.now() - started;
}}
"""
ALL_SHOWN = """
() => {
  const [shown, , all] = document.querySelector('.shown').innerText.split(' ').map(Number);
  return shown >= Math.min(400, all);
}
"""
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
  return took.sort((a, b) => a - b)[57];
}
"""
EXPLORED = """
async () => {
  const explorer = document.querySelector('.fields').explorer;
  const { stage, manifest } = explorer;
  const timed = async (count, act) => {
    const took = [];
    for (let k = 0; k < count; k++) {
      const started = performance.now();
      await act(k);
      took.push(performance.now() - started);
    }
    return took.sort((a, b) => a - b)[Math.ceil(0.9 * count) - 1];
  };
  const last = manifest.steps.length - 1;
  const place = (k) => Math.round((k * last) / 19);
  const found = {};
  found["change of step, first time"] = await timed(20, (k) => explorer.change({ step: place(k) }));
  found["change of step, again"] = await timed(20, (k) => explorer.change({ step: place(19 - k) }));
  found["change of quantity"] = await timed(6, (k) => explorer.change({ quantity: k % manifest.quantities.length }));
  found["hover"] = await timed(50, (k) => stage.hover(stage.pointAt(150 + 8 * k, 100 + 3 * k)));
  found["curve of a point, first"] = await timed(1, () => explorer.pick(120 * 250 + 100));
  found["curve of a further point"] = await timed(3, (k) => explorer.pick(100 * 250 + 30 * k));
  return found;
}
"""
BARS = {
    "change of step, first time": CHANGE_MS,
    "change of step, again": CHANGE_MS,
    "change of quantity": CHANGE_MS,
    "hover": HOVER_MS,
}


def figures(folder: Path) -> Iterator[Figure]:
    """Of three tests, one after the other. folder : where they are made"""
    print(f"making tests of {', '.join(map(str, STEPS))} steps …", file=sys.stderr, flush=True)
    for path, steps in zip(long_results(folder, STEPS), STEPS, strict=True):
        for figure in _measured(path, folder):
            yield figure._replace(quantity=f"{steps:5} steps: {figure.quantity}")


def _measured(path: Path, folder: Path) -> Iterator[Figure]:
    from playwright.sync_api import sync_playwright

    command = [sys.executable, "-m", "dicflow", "app", str(path), "--no-browser"]
    with subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True, env=environment(folder)
    ) as app:
        assert app.stdout is not None
        try:
            link = app.stdout.readline().strip()
            with sync_playwright() as driver, _watched(app.pid) as peaks:
                browser = driver.chromium.launch(executable_path=shutil.which("chromium"), args=list(FLAGS))
                page = browser.new_page(viewport={"width": 1280, "height": 800})
                yield from _looked_at(page, link)
                browser.close()
            yield Figure("memory of the app, peak", max(peaks), MOST_MB, unit="MB")
        finally:
            app.terminate()


def _looked_at(page: Any, link: str) -> Iterator[Figure]:
    yield Figure("photograph, first time", _timed(lambda: _photograph(page, link)), PAINT_MS, unit="ms")
    page.wait_for_timeout(1500)
    yield Figure("photograph, again", _timed(lambda: _photograph(page, link)), PAINT_MS, unit="ms")
    yield Figure("pan and zoom, 95 % of frames", page.evaluate(FRAMES), FRAME_MS, unit="ms")
    for screen in ("settings", "run", "folder"):
        yield Figure(f"screen {screen}", _timed(lambda: _go(page, screen)), PAINT_MS, unit="ms")  # noqa: B023
    yield Figure("explore, first time", _timed(lambda: _explore(page)), PAINT_MS, unit="ms")
    page.wait_for_timeout(300)
    yield Figure("change of step while more steps are read", page.evaluate(CHANGED), CHANGE_MS, unit="ms")
    yield Figure("all steps can be shown", _timed(lambda: _all_steps(page)), unit="ms")
    page.evaluate(f"{EXPLORER}.ready.then(() => null)")
    for quantity, milliseconds in page.evaluate(EXPLORED).items():
        yield Figure(quantity, milliseconds, BARS.get(quantity), unit="ms")
    yield Figure("explore, again", _timed(lambda: _again(page)), PAINT_MS, unit="ms")


@contextmanager
def _watched(pid: int) -> Iterator[list[float]]:
    """Memory [MB] of a process and its children, four times a second."""
    peaks, ended = [_memory_mb(pid)], threading.Event()

    def watch() -> None:
        while not ended.wait(0.25):
            peaks.append(_memory_mb(pid))

    thread = threading.Thread(target=watch)
    thread.start()
    try:
        yield peaks
    finally:
        ended.set()
        thread.join()


def _memory_mb(pid: int) -> float:
    """Memory of a process and its children; what they share counts once."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()
        children = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()
        others = [
            one for task in Path(f"/proc/{pid}/task").iterdir() for one in (task / "children").read_text().split()
        ]
    except OSError:  # it has ended meanwhile
        return 0.0
    own = next((int(line.split()[1]) for line in lines if line.startswith("Pss:")), 0) / 1000
    return own + sum(_memory_mb(int(one)) for one in {*children, *others})


def _photograph(page: Any, link: str) -> None:
    page.goto(f"{link}#region" if "token" in link else link)
    page.wait_for_selector("body[data-ready]")
    page.wait_for_selector(".viewer")
    while not page.evaluate(
        "[...document.querySelector('.viewer').viewer.tiles.values()].some((one) => one.naturalWidth)"
    ):
        page.wait_for_timeout(20)


def _explore(page: Any) -> None:
    page.click('#sidebar a[href="#explore"]')
    _drawn(page)


def _again(page: Any) -> None:
    page.reload()
    _drawn(page)


def _drawn(page: Any) -> None:
    while not page.evaluate("document.querySelector('.fields')?.explorer.firstDrawn > 0"):
        page.wait_for_timeout(10)


def _all_steps(page: Any) -> None:
    """Wait until the screen shows what it shows without being asked for more."""
    while not page.evaluate(ALL_SHOWN):
        page.wait_for_timeout(50)


def _go(page: Any, screen: str) -> None:
    ready = {"settings": "table", "run": "h1.state", "folder": ".pair img"}[screen]
    page.click(f'#sidebar a[href="#{screen}"]')
    page.wait_for_selector(f"section.{screen} {ready}")


def _timed(call: Callable[[], None]) -> float:
    """How long a call takes [ms]."""
    start = time.perf_counter()
    call()
    return 1000.0 * (time.perf_counter() - start)


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        sys.exit(report(figures(Path(place))))
