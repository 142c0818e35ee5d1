"""What a measurement costs: cold and warm runs, two workers against one, memory, disk, the engine's share.

Run it with ``make bench``. Uses the replica of experiment 1: 22 pairs of 1440 × 1920 px and 20 board pairs.
"""

from __future__ import annotations

import csv
import json
import os
import resource
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import psutil

from tests import bench_correlation, bench_flow, bench_pictures, bench_planning, bench_run, bench_stereo, bench_waits
from tests.bars import Figure
from tests.data_folder import SHARED
from tests.figures import ROOT, WORK, forth_and_back, fresh, replica, report

PIPELINE = ROOT / "pipelines" / "latex_experiment_1.yaml"
DICFLOW = str(Path(sys.executable).with_name("dicflow"))
PRECISE = ROOT / "pipelines" / "precise_latex_experiment_1.yaml"
MEASURE = """\
import json, sys
from dicflow.pipeline import Pipeline
if __name__ == "__main__":
    pipeline, data, store, workers = sys.argv[1:]
    outcome = Pipeline.load(pipeline, data=data, store=store).run(workers=int(workers)).outcome
    if not outcome.ok:
        sys.exit("; ".join(outcome.errors))
    done = outcome.outcomes.values()
    totals = {name: sum(getattr(one, name) for one in done) for name in ("stage_s", "engine_s", "remake_s")}
    print(json.dumps({"seconds": outcome.seconds, **totals}))
"""


class Cost(NamedTuple):
    """Cost of one process with its children.

    seconds, cpu_s : wall and processor time; peak_bytes : largest sum of the resident sizes; said : last line of output
    """

    seconds: float
    cpu_s: float
    peak_bytes: int
    said: dict[str, Any]


def cost(command: list[str]) -> Cost:
    """Run a command and watch the memory of all its processes."""
    start, cpu, peak, stop = time.perf_counter(), _cpu_of_children(), [0], threading.Event()
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    watcher = threading.Thread(target=_watch, args=(process.pid, peak, stop))
    watcher.start()
    output, errors = process.communicate()
    stop.set()
    watcher.join()
    if process.returncode:
        sys.exit(f"{' '.join(command)} ended with {process.returncode}:\n{errors}")
    lines = output.strip().splitlines()
    said = json.loads(lines[-1]) if lines and lines[-1].startswith("{") else {}
    return Cost(time.perf_counter() - start, _cpu_of_children() - cpu, peak[0], said)


def _cpu_of_children() -> float:
    """Processor time of all processes that this one started and that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _watch(pid: int, peak: list[int], stop: threading.Event) -> None:
    while not stop.wait(0.2):
        try:
            family = [psutil.Process(pid), *psutil.Process(pid).children(recursive=True)]
            peak[0] = max(peak[0], sum(member.memory_info().rss for member in family))
        except psutil.NoSuchProcess:
            continue


def computed(data: Path, store: Path, workers: int, pipeline: Path = PIPELINE) -> Cost:
    """A cold run without pictures, through the library."""
    script = WORK / "measure.py"
    script.write_text(MEASURE)
    return cost([sys.executable, str(script), str(pipeline), str(data), str(store), str(workers)])


def of_length(folder: Path, steps: int) -> Path:
    """An experiment of so many steps, as hard links: its own steps forth and back again."""
    made = fresh(f"replica_{steps}_steps")
    for side in ("boards/left", "boards/right"):
        (made / side).mkdir(parents=True)
        for path in sorted((folder / side).glob("*.png")):
            os.link(path, made / side / path.name)
    for side in ("photos/left", "photos/right"):
        (made / side).mkdir(parents=True)
        for step, path in enumerate(forth_and_back(sorted((folder / side).glob("*.png")), steps)):
            os.link(path, made / side / f"step_{step:03}.png")
    shutil.copy(folder / "region.geojson", made)
    head, *rows = [line for line in (folder / "caliper.csv").read_text().splitlines() if not line.startswith("#")]
    with (made / "caliper.csv").open("w", newline="") as file:
        csv.writer(file).writerows(line.split(",") for line in [head, *forth_and_back(rows, steps)])
    return made


def reports(data: Path, store: Path) -> Iterator[Figure]:
    """Building the report of a precise run of 22 steps, and again of the same run."""
    output = fresh("bench_report")
    command = [DICFLOW, "report", str(PRECISE), "--data", str(data), "--store", str(store), "--output", str(output)]
    first, second = cost(command), cost(command)
    yield Figure("report of 22 steps: building", first.seconds, 15, unit="s")
    yield Figure("report of 22 steps: peak memory", first.peak_bytes / 2**30, 1, unit="GiB")
    yield Figure("report of 22 steps: building again", second.seconds, 2, unit="s")
    yield Figure("report of 22 steps: size", (output / "report.html").stat().st_size / 1e6, 10, unit="MB")


def size_of(folder: Path) -> int:
    return sum(path.stat().st_size for path in folder.rglob("*") if path.is_file())


def cold_and_warm(data: Path) -> Iterator[Figure]:
    """The thesis form with pictures from an empty store, and again with nothing to do."""
    store, output = fresh("bench"), fresh("bench_out")
    folders = ["--data", str(data), "--store", str(store), "--output", str(output)]
    command = [DICFLOW, "run", str(PIPELINE), *folders, "--json"]
    cold, warm = cost(command), min((cost(command) for _ in range(3)), key=lambda run: run.seconds)
    yield Figure("cold run with pictures, 2 workers", cold.seconds, 150, unit="s")
    yield Figure("store", size_of(store) / 1e9, 1.5, unit="GB")
    yield Figure("run with nothing to do, whole process", warm.seconds, 1.5, unit="s")
    yield Figure("  of it computed", warm.said["counts"]["computed"], 0)


def workers(data: Path) -> Iterator[Figure]:
    """Two workers against one, the engine's share, and memory over the number of steps."""
    two, one = computed(data, fresh("bench_two"), 2), computed(data, fresh("bench_one"), 1)
    yield Figure("one worker / two workers, same run", one.said["seconds"] / two.said["seconds"], 1.7, at_least=True)
    yield Figure("engine / stages, one worker", one.said["engine_s"] / stage_seconds(one), 0.1)
    yield Figure("engine / stages, two workers", two.said["engine_s"] / stage_seconds(two), 0.1)
    yield Figure("making again what is not kept / stages", two.said["remake_s"] / stage_seconds(two))
    short, long = (computed(of_length(data, steps), fresh(f"bench_{steps}"), 2) for steps in (8, 40))
    yield Figure("peak memory, 22 steps / 8 steps", two.peak_bytes / short.peak_bytes)
    yield Figure("peak memory, 40 steps / 22 steps", long.peak_bytes / two.peak_bytes)


def memory(data: Path) -> Iterator[Figure]:
    """Most memory of whole runs, resident sizes added up; the bars are what version 0.1 took, taken alike."""
    runs = [("replica, precise form", PRECISE, data, 1.22), ("replica, thesis form", PIPELINE, data, 1.52)]
    if (SHARED / "d_specimen").is_dir():
        pairs = ROOT / "pipelines" / "precise_d_specimen.yaml"
        runs.insert(0, ("two cameras, 7 real pairs", pairs, SHARED / "d_specimen", 1.42))
    for name, pipeline, photographs, bar in runs:
        folder = fresh("bench_memory")
        arguments = ["--data", photographs, "--store", folder / "store", "--output", folder / "output"]
        taken = cost([DICFLOW, "run", *map(str, (pipeline, *arguments))])
        yield Figure(f"{name}: most memory", taken.peak_bytes / 1e9, bar, unit="GB")


def stage_seconds(run: Cost) -> float:
    """Seconds of all stages, those included that were done again."""
    return float(run.said["stage_s"] + run.said["remake_s"])


def precise_form(data: Path) -> Iterator[Figure]:
    """The precise form: seconds, memory over the number of steps, its report and pictures."""
    lengths = (of_length(data, steps) for steps in (8, 22, 40))
    short, whole, long = (computed(series, fresh(f"bench_{series.name}"), 2, PRECISE) for series in lengths)
    yield Figure("precise form: cold run of 22 steps", whole.seconds, unit="s")
    yield Figure("precise form: peak memory", whole.peak_bytes / 2**30, 2, unit="GiB")
    yield Figure("precise form: peak memory, 22 steps / 8 steps", whole.peak_bytes / short.peak_bytes)
    yield Figure("precise form: peak memory, 40 steps / 22 steps", long.peak_bytes / whole.peak_bytes)
    yield from reports(WORK / "replica_22_steps", WORK / "bench_replica_22_steps")
    yield from bench_pictures.figures(WORK / "replica_22_steps", WORK / "bench_replica_22_steps")


def figures() -> Iterator[Figure]:
    """All of them; what a person waits for comes first."""
    data = replica(1)
    computed(of_length(data, 3), fresh("bench_first"), 2)  # compiles the kernels, which is not measured
    yield from bench_waits.figures()
    yield from bench_run.waits()
    yield from memory(data)
    yield from workers(data)
    yield from bench_correlation.speed()
    yield from bench_correlation.growth()
    yield from bench_stereo.step_cost()
    yield from bench_flow.figures()
    yield from cold_and_warm(data)
    yield from precise_form(data)
    yield from bench_planning.figures()


if __name__ == "__main__":
    sys.exit(report(figures()))
