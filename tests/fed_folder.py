"""A folder into which cameras write while it is watched: half-written files, and partners that come late."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.synthetic.motion import Motion, render_pattern, speckle_pattern
from dicflow.pipeline import Pipeline, Result
from dicflow.pipeline.watching import Measured, Watch
from tests.waiting import PATIENCE_S

__all__ = ["Arrival", "feed", "pairs", "watched", "write_pipeline"]

SIZE = 120
STRAIN = 0.004
"""Per step."""
PIPELINE = """\
dicflow: 1
stages:
  photos: {stage: images, left: "left/*.png", right: "right/*.png"}
  region: {stage: region, images: photos, file: region.geojson}
  correlation: {stage: correlate, images: photos, subset_size: 21, step_size: 10}
  total: {stage: deformation, points: correlation, window: 30 px}
  probes: {stage: probes, extensometers: {gauge: [[60, 40], [60, 80]]}}
"""
REGION = '{"type": "Polygon", "coordinates": [[[15, 15], [105, 15], [105, 105], [15, 105], [15, 15]]]}'


class Arrival(NamedTuple):
    """A photograph that comes. after_s : since the one before; pause_s : in the middle of writing it"""

    path: Path
    content: bytes
    after_s: float = 0.0
    pause_s: float = 0.0


def write_pipeline(folder: Path) -> Path:
    """A pipeline of one camera's strain, which reads pairs, beside folders without photographs."""
    for side in ("left", "right"):
        (folder / side).mkdir(parents=True)
    (folder / "region.geojson").write_text(REGION)
    (folder / "pipeline.yaml").write_text(PIPELINE)
    return folder / "pipeline.yaml"


def pairs(folder: Path, count: int) -> list[tuple[Arrival, Arrival]]:
    """Both photographs of each step: speckles that are stretched along y by STRAIN per step."""
    pattern = speckle_pattern((SIZE, SIZE), seed=3)
    rng = np.random.default_rng(4)
    found = []
    for number in range(count):
        image = render_pattern(pattern, (SIZE, SIZE), stretched(number * STRAIN), order=2)
        noisy = np.clip(image + rng.normal(0.0, 1.0, image.shape), 0, 255).round().astype(np.uint8)
        content = cv2.imencode(".png", noisy)[1].tobytes()
        found.append(tuple(Arrival(folder / side / f"{side}_{number:03d}.png", content) for side in ("left", "right")))
    return found


def stretched(strain: float) -> Motion:
    """A stretch along y around the middle."""
    gradient = np.diag([1.0, 1.0 + strain])
    return lambda points: ((points - SIZE / 2) @ gradient + SIZE / 2, np.broadcast_to(gradient, (*points.shape, 2)))


def feed(arrivals: Sequence[Arrival]) -> None:
    """Write photographs in turn, as cameras do."""
    for path, content, after_s, pause_s in arrivals:
        time.sleep(after_s)
        half = len(content) // 2 if pause_s else len(content)
        with path.open("wb") as file:
            file.write(content[:half])
            file.flush()
            time.sleep(pause_s)
            file.write(content[half:])


def watched(
    pipeline: Path,
    act: Callable[[list[Measured], list[str]], None],
    steps: int,
    workers: int = 1,
) -> tuple[Result, list[Measured], list[str]]:
    """Watch a pipeline's folder while something is done to it, until so many steps lie in it and are measured.

    act : called with the steps that are measured and what is said, both of which grow
    Returns the complete result, the steps in the order in which they were measured, and what was said.
    """
    measured: list[Measured] = []
    notes: list[str] = []
    watch = Watch(Pipeline.load(pipeline), measured.append, notes.append, workers)

    def drive() -> None:
        try:
            act(measured, notes)
            end = time.monotonic() + PATIENCE_S
            while len({one.step for one in measured}) < steps and time.monotonic() < end:
                time.sleep(0.05)
            time.sleep(0.5)
        finally:
            watch.end()

    thread = threading.Thread(target=drive)
    thread.start()
    watch.run()
    thread.join()
    return watch.pipeline_so_far().run(scheduler="sync", workers=1), measured, notes
