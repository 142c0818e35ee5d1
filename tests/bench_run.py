"""What a person waits for: ``dicflow run`` as a process, against its kernel and against another program.

Part of ``make bench``. One camera: the images, the subsets and the other program of :mod:`tests.bench_correlation`, but
no low pass, and nothing is known of the motion. The kernels are compiled before.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.correlation.material import search_directly
from dicflow.core.correlation.search import Search, first_photograph, points_in_first_photograph
from dicflow.core.correlation.subsets import Subset
from dicflow.core.photographs.exposure import Photograph
from tests import bench_correlation as speckles
from tests.bars import Figure
from tests.figures import WORK, cleared, fresh

DICFLOW = str(Path(sys.executable).with_name("dicflow"))
PIPELINE = """\
dicflow: 1
title: one camera, two threads
stages:
  photos: {{stage: images, left: "*.png"}}
  region: {{stage: region, images: photos, file: region.geojson}}
  points: {{stage: correlate, images: photos, subset_size: {subset}, step_size: {step}, shape_function: {shape}}}
"""
REPEATS = 3
SERIES = (5, 13)
"""Photographs of two series; the longer one tells what a further photograph costs."""


class Library(NamedTuple):
    """Seconds from two images to points, those of the second one alone, the number of points, mean iterations, and the
    errors' mean and deviation [px].
    """

    seconds: float
    search_s: float
    points: int
    iterations: float
    bias: float
    sigma: float


def library(images: tuple[np.ndarray, np.ndarray], shape: str) -> Library:
    """The first image described and the second one searched, starts and splines included."""
    grid, search = speckles.grid_of(speckles.STEP), Search(Subset(speckles.SUBSET, shape), threads=speckles.THREADS)
    begin = time.perf_counter()
    first = first_photograph(Photograph(images[0]), np.ones(images[0].shape, dtype=bool), grid, search)
    points_in_first_photograph(first, search)
    described = time.perf_counter()
    field = search_directly(first, None, first, Photograph(images[1]), search).correlation.field
    end = time.perf_counter()
    found = np.asarray(field.status == 0)
    errors = speckles.errors(grid[found], field.warp[found][..., 0])
    return Library(end - begin, end - described, int(found.sum()), float(field.iterations[found].mean()), *errors)


def photographs(shape: str, count: int) -> Path:
    """A folder with a pipeline and so many photographs: the first one, then two others in turn."""
    folder, images = fresh(f"run_{shape}_{count}"), (*speckles.pair(), speckles.another())
    folder.mkdir()
    for step in range(count):
        if step < len(images):
            cv2.imwrite(str(folder / f"step_{step:02}.png"), images[step])
        else:
            os.link(folder / f"step_{step - 2:02}.png", folder / f"step_{step:02}.png")
    end = speckles.SIZE - speckles.MARGIN - 1
    ring = [[speckles.MARGIN, speckles.MARGIN], [end, speckles.MARGIN], [end, end], [speckles.MARGIN, end]]
    outline = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    region = {"type": "FeatureCollection", "features": [{"type": "Feature", "properties": {}, "geometry": outline}]}
    (folder / "region.geojson").write_text(json.dumps(region))
    settings = {"subset": speckles.SUBSET, "step": speckles.STEP, "shape": shape}
    (folder / "pipeline.yaml").write_text(PIPELINE.format(**settings))
    return folder


def run(folder: Path) -> float:
    """Seconds of a whole process from an empty store."""
    for made in (".dicflow", "results"):
        cleared(folder / made)
    return _process([DICFLOW, "run", str(folder / "pipeline.yaml")])


def peer(shape: str) -> float:
    """Seconds of the other program's whole process with the same shape function."""
    numbers = (speckles.SIZE, speckles.SUBSET, speckles.STEP, speckles.MARGIN, speckles.THREADS)
    settings = [str(WORK / "speed"), speckles.PEER_SHAPES[shape], *map(str, numbers)]
    return _process([str(speckles.PEER), "-c", speckles.PEER_SCRIPT, *settings])


def _process(command: list[str]) -> float:
    begin = time.perf_counter()
    done = subprocess.run(command, capture_output=True, text=True, check=False, cwd=WORK)
    if done.returncode:
        sys.exit(f"{' '.join(command[:3])} ended with {done.returncode}:\n{done.stderr}")
    return time.perf_counter() - begin


def waits() -> Iterator[Figure]:
    """The process against the library's calls, and against the other program where that is installed."""
    images, has_peer = speckles.pair(), speckles.PEER.is_file()
    for shape in ("affine", "quadratic"):
        name, folder = f"two photographs, {shape}", photographs(shape, 2)
        library(images, shape), run(folder)  # compile
        ours, theirs, calls = [], [], []
        for _ in range(REPEATS):
            calls.append(library(images, shape))
            ours.append(run(folder))
            theirs += [peer(shape)] if has_peer else []
        best = min(calls)
        process = float(np.median(ours))
        yield Figure(f"{name}: search and correlation, points per second", best.points / best.seconds, unit="1/s")
        yield Figure("  points", best.points)
        yield Figure("  mean iterations", best.iterations)
        yield Figure("  bias", best.bias, unit="px")
        yield Figure("  standard deviation of the error", best.sigma, unit="px")
        yield Figure("  seconds of these calls", best.seconds, unit="s")
        yield Figure("  dicflow run, whole process", process, unit="s")
        yield Figure("  of it beyond 2.5 times the calls", process - 2.5 * best.seconds, 1.5, unit="s")
        if has_peer:
            yield Figure("  pyvale's process", float(np.median(theirs)), unit="s")
            yield Figure("  dicflow run / pyvale's process", process / float(np.median(theirs)), 0.15)
        further, search = _further(images, shape)
        yield Figure("  a further photograph of a series", further, unit="s")
        yield Figure("  the same / its search", further / search, 1.3)


def _further(images: tuple[np.ndarray, np.ndarray], shape: str) -> tuple[float, float]:
    """Seconds of a further photograph of a series and of its search, measured in turn: the least of each."""
    searches, series = [], []
    for _ in range(REPEATS):
        searches += [library(images, shape).search_s for _ in range(2)]
        series.append([run(photographs(shape, count)) for count in SERIES])
    short, long = np.min(series, axis=0)
    return float(long - short) / (SERIES[1] - SERIES[0]), min(searches)


if __name__ == "__main__":
    from tests.bars import print_figures

    sys.exit(print_figures(waits()))
