"""What pictures and report of a test cost: at first, and where one window of the strain has changed."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path
from time import process_time

from dicflow.pipeline import Pipeline
from dicflow.report.build import write_report
from dicflow.views.publish import publish
from tests.bars import Figure
from tests.figures import ROOT, fresh, replica, report

PIPELINE = ROOT / "pipelines" / "precise_latex_experiment_1.yaml"
WINDOWS = {"all drawn": "50 px", "window changed": "60 px"}
BARS = {"all drawn": (2.5, 5.0), "window changed": (1.5, 1.5)}


def drawn(loaded: Pipeline, folder: Path) -> tuple[float, float, int]:
    """Processor time of the pictures and of the report [s], and the number of files."""
    result, start = loaded.result(), process_time()
    files = publish(result, folder)
    middle = process_time()
    write_report(loaded, result, folder)
    return middle - start, process_time() - middle, len(files)


def figures(data: Path, store: Path) -> Iterator[Figure]:
    """Of a precise run of 22 pairs, in one process with one thread.

    store : of the run; the products of the changed window are computed into it
    """
    folder = fresh("bench_pictures")
    for name, window in WINDOWS.items():
        loaded = Pipeline.load(PIPELINE, data=data, store=store, settings=[f"total.window={window}"])
        loaded.run(workers=2)
        pictures, page, count = drawn(loaded, folder)
        most_pictures, most_page = BARS[name]
        yield Figure(f"pictures of 22 steps, {name}: processor time", pictures, most_pictures, unit="s")
        yield Figure("  of each of all files", 1e3 * pictures / count, unit="ms")
        yield Figure(f"report of 22 steps, {name}: processor time", page, most_page, unit="s")


if __name__ == "__main__":
    sys.exit(report(figures(replica(1), fresh("bench_pictures_store"))))
