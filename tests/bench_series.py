"""What a long series costs: thousands of pairs through the precise form, against 22 of them.

``python -m tests.bench_series [STEPS [HEIGHT [FURTHER]]]`` renders a tensile test filmed by two cameras, photographs of
so many pixels high, each with noise of its own, and measures the first 22 pairs, 100 (or FURTHER) further ones, and the
rest, in one store.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import cv2
import numpy as np

from dicflow.kinds.probes import ProbeTable
from dicflow.pipeline import Pipeline
from tests.bars import Figure
from tests.bench import DICFLOW, Cost, cost, size_of
from tests.figures import fresh, report
from tests.video_scene import DURATION, FIELD, LENGTH, SIDES, SQUARE, START, WIDTH, Film, film, write_boards

SHORT = 22
PER_POINT = 16
"""Rows of a photograph for each point across the strip: about as many stand along it."""
NOISE = 1.5
PIPELINE = """\
dicflow: 1
stages:
  photos: {{stage: images, left: "left/*.png", right: "right/*.png", time: name}}
  boards: {{stage: images, left: "boards/left/*.png", right: "boards/right/*.png"}}
  corners: {{stage: corners, images: boards, size: [8, 5]}}
  rig: {{stage: calibrate, square: {square} mm}}
  region: {{stage: region, images: photos, rectangle: {rectangle}}}
  correlation: {{stage: correlate, images: photos, subset_size: {subset}, step_size: {step}}}
  stereo: {{stage: stereo, images: photos}}
  points: {{stage: triangulate}}
  total: {{stage: deformation, points: points, window: {window} px}}
  probes: {{stage: probes, extensometers: {{gauge: {gauge}}}}}
  maps: {{stage: maps}}
"""


def figures(steps: int = 3000, height: int = 240, further: int = 100) -> Iterator[Figure]:
    """Time, memory and room of a run of so many steps."""
    folder, size = fresh("bench_series"), (4 * height // 3, height)
    scene = film(0.0, size)
    path = write_pipeline(folder, scene, height // PER_POINT)
    photographs = _photographs(folder, scene, steps + 1)
    cost([DICFLOW, "warm"])  # which is not measured
    runs = []
    for count in (SHORT, further, steps - SHORT - further):
        runs.append(_run(path, islice(photographs, count)))
        yield Figure(f"run of {count} further steps: processor time", runs[-1].cpu_s, unit="s")
        yield Figure("  peak memory over all processes", runs[-1].peak_bytes / 2**20, unit="MiB")
    few, some, many = runs
    each, rest = some.cpu_s / further, many.cpu_s / (steps - SHORT - further)
    yield Figure(f"processor time per step, of all the rest / of {further}", rest / each, 1.1)
    yield Figure(f"peak memory, {steps} steps / {SHORT} steps", many.peak_bytes / few.peak_bytes, 1.1)
    store = folder / ".dicflow"
    yield Figure("store, per step", size_of(store) / steps / 1e3, unit="kB")
    blocks = sum(path.stat().st_blocks for path in store.rglob("*"))
    yield Figure("  in blocks of the disk", 512 * blocks / steps / 1e3, unit="kB")
    yield from _afterwards(path, steps)
    one = _run(path, photographs)
    yield Figure(f"run of step {steps + 1}: processor time", one.cpu_s, unit="s")
    yield Figure("  of it computed", one.said["counts"]["computed"])


def write_pipeline(folder: Path, scene: Film, across: int) -> Path:
    """A pipeline file of the precise form, photographs of the board, and folders for others.

    across : points across the strip
    """
    write_boards(folder, scene)
    for side in SIDES:
        (folder / side).mkdir()
    size = scene.stand.rig.left.size
    pixels = size[1] / FIELD
    middle, half = np.array(size) / 2.0, 0.42 * pixels * np.array([WIDTH, LENGTH])
    step = round(0.84 * WIDTH * pixels / (across - 1))
    along = 0.3 * LENGTH * pixels
    text = PIPELINE.format(
        square=SQUARE,
        rectangle=[*np.round(middle - half).astype(int).tolist(), *np.round(middle + half).astype(int).tolist()],
        subset=31 if size[1] > 480 else 21,
        step=step,
        window=4 * step,
        gauge=[[round(middle[0]), round(middle[1] - along)], [round(middle[0]), round(middle[1] + along)]],
    )
    path = folder / "pipeline.yaml"
    path.write_text(text)
    return path


def _photographs(folder: Path, scene: Film, steps: int) -> Iterator[None]:
    """Write one pair after the other."""
    for number, time in enumerate(np.linspace(START, START + DURATION, steps)):
        for path, content in pair(folder, scene, time, number):
            path.write_bytes(content)
        yield


def pair(folder: Path, scene: Film, time: float, number: int) -> list[tuple[Path, bytes]]:
    """Files of both photographs at a time [s], and their contents. number : of their noise"""
    return [
        (
            folder / name / f"{name}_{round(1000 * time):06d}.png",
            cv2.imencode(".png", scene.take(side, time, NOISE, number))[1].tobytes(),
        )
        for side, name in enumerate(SIDES)
    ]


def _run(path: Path, photographs: Iterator[None]) -> Cost:
    """Measure further photographs, without pictures and report."""
    for _ in photographs:
        pass
    return cost([DICFLOW, "run", str(path), "--no-pictures", "--no-report", "--json"])


def _afterwards(path: Path, steps: int) -> Iterator[Figure]:
    """Of a series that is measured: the strain in the end, its plan, and its report."""
    strain = ProbeTable.read(Pipeline.load(path).result().product("probes")).of_extensometer("gauge", "strain")
    yield Figure("steps with a strain", np.isfinite(strain).sum(), steps, at_least=True)
    plan = cost([DICFLOW, "plan", str(path)])
    yield Figure(f"plan of {steps} steps, all stored: processor time", plan.cpu_s, 5, unit="s")
    yield Figure("  peak memory", plan.peak_bytes / 2**20, unit="MiB")
    for what in ("pictures and report", "  once more"):
        drawn = cost([DICFLOW, "run", str(path), "--json"])
        yield Figure(f"{what}: processor time of the command", drawn.cpu_s, 20, unit="s")
    yield Figure("  peak memory over all processes", drawn.peak_bytes / 2**20, unit="MiB")
    page = path.parent / "results" / "pipeline" / "report.html"
    yield Figure("report: size", page.stat().st_size / 1e6, 15, unit="MB")


if __name__ == "__main__":
    sys.exit(report(figures(*map(int, sys.argv[1:]))))
