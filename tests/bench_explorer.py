"""How fast the explorer is in a browser, with 50,000 points and 200 steps, by the page's own clock.

Run it with ``python -m tests.bench_explorer``. The browser draws by the processor; a card is faster.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from time import process_time

from dicflow.explorer.pack import pack
from dicflow.explorer.page import NOTEBOOK_PAGE, fragment
from tests.bars import Figure
from tests.explorer.chromium import Tabs
from tests.explorer.waves import Waves, reading_of
from tests.figures import report

ROWS, COLS, STEPS = 200, 250, 200
BUDGET_BYTES = 1e9
MEASURED = """(async () => {
  const mean = async (count, act) => {
    const started = performance.now();
    for (let k = 0; k < count; k++) await act(k);
    return (performance.now() - started) / count;
  };
  const { stage, manifest } = explorer;
  const found = {};
  found["first step change"] = await mean(20, (k) => explorer.change({ step: 9 * k }));
  found["step change again"] = await mean(20, (k) => explorer.change({ step: 9 * (19 - k) }));
  found["quantity change"] = await mean(6, (k) => explorer.change({ quantity: k % manifest.quantities.length }));
  found["hover"] = await mean(50, (k) => stage.hover(stage.pointAt(150 + 8 * k, 100 + 3 * k)));
  found["curve of a point over 200 steps, first"] = await mean(1, () => explorer.pick(120 * 250 + 100));
  found["curve of a further point"] = await mean(3, (k) => explorer.pick(100 * 250 + 30 * k));
  await explorer.change({ camera: "space" });
  found["turn of the surface"] = await mean(20, () => { stage.turntable.turn(0.02, 0); stage.draw(); });
  found["hover on the turned surface"] = await mean(10, (k) => {
    stage.turntable.turn(0.02, 0);
    stage.hover(stage.pointAt(250 + 9 * k, 200));
  });
  return found;
})()"""
BARS = {
    "first step change": 150.0,
    "step change again": 150.0,
    "quantity change": 150.0,
    "hover": 50.0,
    "hover on the turned surface": 50.0,
}


def figures(folder: Path) -> Iterator[Figure]:
    """Of a page of formulas. folder : where it is written"""
    reading = reading_of(Waves(ROWS, COLS, STEPS))
    start = process_time()
    found = pack(reading, "waves", lambda _sources, make: make(), BUDGET_BYTES)
    page = folder / "page.html"
    page.write_text(NOTEBOOK_PAGE.replace("{body}", fragment(found)), encoding="utf-8")
    yield Figure("packing of 200 steps of 50,000 points", process_time() - start, unit="s")
    yield Figure("size of the page", page.stat().st_size / 1e6, unit="MB")
    with Tabs() as tabs, tabs.open(webgl=False) as seen:
        seen.show(page.as_uri())
        paint = seen.page.evaluate("performance.getEntriesByName('first-contentful-paint')[0].startTime")
        yield Figure("first paint", paint, 2000.0, unit="ms")
        yield Figure("first field drawn", seen.js("explorer.firstDrawn"), 2000.0, unit="ms")
        for quantity, milliseconds in seen.js(MEASURED).items():
            yield Figure(quantity, milliseconds, BARS.get(quantity), unit="ms")


if __name__ == "__main__":
    with tempfile.TemporaryDirectory() as place:
        sys.exit(report(figures(Path(place))))
