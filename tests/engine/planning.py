"""One planning at 10,000 steps in a process of its own, which loads nothing but the engine; for the benchmark.

The folder given holds ``numbers``, the files of the steps, and ``store``.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

from toys import Read, Scale, run_sync

from dicflow.engine.graph import Graph, StageSpec, expand
from dicflow.engine.plan import make_plan
from dicflow.engine.store import Store

STAGES = 14


def graph(folder: Path) -> Graph:
    """As many tasks per step as there are stages, one after the other."""
    stages = {"read": StageSpec(Read(keep="always"), {}, folder / "numbers")}
    for number in range(1, STAGES):
        node = Scale(keep="always", factor=float(number))
        stages[f"scale_{number}"] = StageSpec(node, {"number": list(stages)[-1]}, folder)
    return expand(stages)


def measure(work: str, folder: Path) -> dict[str, float]:
    """Counts, processor time [s] and peak memory of this process [MiB]. work : "plan" or "run" """
    start = time.process_time()
    tasks, store = graph(folder), Store.open(folder / "store")
    counts = (run_sync(tasks, store) if work == "run" else make_plan(tasks, store, pipeline="toys")).counts
    seconds = time.process_time() - start
    return {"tasks": len(tasks.tasks), "hits": counts["hit"], "cpu_s": seconds, "peak_mib": peak_mib()}


def peak_mib() -> float:
    """Peak memory of this process [MiB]; what ``getrusage`` gives starts at the size of the process that began it."""
    lines = Path("/proc/self/status").read_text().splitlines()
    return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM:")) / 1024


if __name__ == "__main__":
    print(json.dumps(measure(sys.argv[1], Path(sys.argv[2]))))
