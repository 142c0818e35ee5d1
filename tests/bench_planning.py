"""What planning costs at 10,000 steps: 14 stages of the engine's toys, 140,000 tasks, all of them stored or none."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from tests.bars import Figure
from tests.figures import ROOT, fresh, made, report

PLANNING = ROOT / "tests" / "engine" / "planning.py"
STEPS = 10_000


def figures() -> Iterator[Figure]:
    """Processor time and peak memory of a plan and a run in which all is stored, and of a plan in which nothing is."""
    full = made("planning", _computed)
    empty = fresh("planning_nothing_stored")
    empty.mkdir(parents=True)
    (empty / "numbers").symlink_to(full / "numbers")
    stored, run, nothing = cost("plan", full), cost("run", full), cost("plan", empty)
    assert (stored["hits"], run["hits"], nothing["hits"]) == (stored["tasks"], stored["tasks"], 0)
    tasks = f"{stored['tasks']:,} tasks"
    yield Figure(f"plan of {tasks}, all stored: processor time", stored["cpu_s"], 6, unit="s")
    yield Figure(f"plan of {tasks}, all stored: peak memory", stored["peak_mib"], 300, unit="MiB")
    yield Figure(f"plan of {tasks}, nothing stored: processor time", nothing["cpu_s"], 3.5, unit="s")
    yield Figure(f"plan of {tasks}, nothing stored: peak memory", nothing["peak_mib"], 300, unit="MiB")
    yield Figure(f"run of {tasks}, all stored: processor time", run["cpu_s"], 10, unit="s")
    yield Figure(f"run of {tasks}, all stored: peak memory", run["peak_mib"], unit="MiB")


def cost(work: str, folder: Path) -> dict[str, float]:
    """Tasks, hits, processor time and peak memory of planning in a process of its own."""
    done = subprocess.run(
        [sys.executable, str(PLANNING), work, str(folder)], cwd=ROOT, stdout=subprocess.PIPE, text=True, check=True
    )
    return dict(json.loads(done.stdout))


def _computed(folder: Path) -> None:
    """The steps' files, and a store of all products; takes some minutes and a million files."""
    (folder / "numbers").mkdir(parents=True)
    then = time.time() - 60
    for step in range(STEPS):
        path = folder / "numbers" / f"step_{step:05}.txt"
        path.write_text(str(step + 1))
        os.utime(path, (then, then))
    cost("run", folder)


if __name__ == "__main__":
    sys.exit(report(figures()))
