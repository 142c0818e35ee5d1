"""What correlation costs: points per second, what limits it, and another program on the same images.

Part of ``make bench``. The images are 2048 × 2048 px, 8 bit, with noise of two grey levels; subsets of 33 px every
5 px, two threads. The other program is pyvale; ``make peer`` installs it into an environment of its own. Its default is
a Gaussian low-pass on both images; ours get one too, and its time counts.
"""

from __future__ import annotations

import json
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.correlation.follow import Field, correlate_field
from dicflow.core.correlation.subsets import Subset, with_sums
from dicflow.core.correlation.template import Template, template
from dicflow.core.correlation.warp import identity
from dicflow.core.photographs.interpolate import Spline, spline
from dicflow.core.synthetic.planar import planar_pair
from tests.bars import Figure
from tests.figures import ROOT, WORK

SIZE, STEP, SUBSET, MARGIN, THREADS, LOW_PASS_PX = 2048, 5, 33, 40, 2, 0.7
TRUTH = np.array([[1.004, 0.003, 3.37], [-0.002, 0.998, -2.21], [0.0, 0.0, 1.0]])
SETTINGS = {
    "affine, bicubic": ("affine", 3, 90_000),
    "affine, biquintic": ("affine", 5, 50_000),
    "quadratic, bicubic": ("quadratic", 3, 40_000),
}
FLOP_PER_SAMPLE = {3: 74, 5: 152}
"""Of one pixel in one iteration, counted in the source: its place 14, its weights and sum 44 or 122, the sums 16."""
PEER = ROOT / ".venv-peer" / "bin" / "python"
PEER_SCRIPT = """\
import json, sys, time
from pathlib import Path
import numpy as np
import pyvale.dic as dic
folder, shape, (size, subset, step, margin, threads) = Path(sys.argv[1]), sys.argv[2], map(int, sys.argv[3:])
reference, deformed = (np.load(folder / f"{name}.npy") for name in ("reference", "deformed"))
mask = np.zeros((size, size), dtype=bool)
reach = margin - subset // 2
mask[reach : size - reach, reach : size - reach] = True
start = time.perf_counter()
dic.calculate_2d(reference, deformed, mask, [size // 2, size // 2], subset_size=subset, subset_step=step,
                 num_threads=threads, max_displacement=16, method="SINGLEWINDOW_RG", output_basepath=folder,
                 output_prefix="peer_", print_level=0, shape_function=shape)
seconds = time.perf_counter() - start
lines = next(folder.glob("peer_*.csv")).read_text().splitlines()[1:]
values = np.array([[float(cell) for cell in line.split(",")[:4]] for line in lines])
np.save(folder / "peer.npy", values)
print(json.dumps({"seconds": seconds}))
"""


PEER_SHAPES = {"affine": "AFFINE", "quadratic": "QUAD"}
"""Names of shape functions in the other program."""


class Speed(NamedTuple):
    """points per second, their number, mean iterations, and the errors' mean and standard deviation [px]."""

    rate: float
    points: int
    iterations: float
    bias: float
    sigma: float


def pair() -> tuple[np.ndarray, np.ndarray]:
    """The two images, rendered at the first call."""
    return _image("reference", TRUTH), _image("deformed", TRUTH)


def another() -> np.ndarray:
    """A third image, moved otherwise."""
    return _image("other", np.linalg.inv(TRUTH))


def _image(name: str, motion: np.ndarray) -> np.ndarray:
    path = WORK / "speed" / f"{name}.npy"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        images = planar_pair((SIZE, SIZE), motion, noise=2.0, seed=1)
        np.save(path, images.reference if name == "reference" else images.deformed)
    return np.asarray(np.load(path))


def errors(points: np.ndarray, places: np.ndarray) -> tuple[float, float]:
    """Largest mean and standard deviation over x and y of places (..., 2) against the truth [px]."""
    wrong = (places - (points @ TRUTH[:2, :2].T + TRUTH[:2, 2])).reshape(-1, 2)
    return float(np.abs(np.nanmean(wrong, axis=0)).max()), float(np.nanstd(wrong, axis=0).max())


def grid_of(step: int, size: int = SIZE) -> np.ndarray:
    axis = np.arange(MARGIN, size - MARGIN, step, dtype=float)
    return np.stack(np.meshgrid(axis, axis), axis=-1)


def follow(images: tuple[np.ndarray, np.ndarray], shape: str, degree: int, grid: np.ndarray) -> tuple[float, Field]:
    """Seconds from two images to a field, splines included, and the field; started from its first point."""
    starts = np.full((*grid.shape[:2], 2, 3), np.nan)
    starts[0, 0] = identity(grid[0, 0] + TRUTH[:2, 2])
    begin = time.perf_counter()
    smooth = [cv2.GaussianBlur(image.astype(np.float32), (0, 0), LOW_PASS_PX) for image in images]
    reference, target = template(spline(smooth[0], degree)), spline(smooth[1], degree)
    subsets = with_sums(reference, grid, Subset(SUBSET, shape), THREADS)
    field = correlate_field(subsets, target, grid, starts, Subset(SUBSET, shape), threads=THREADS)
    return time.perf_counter() - begin, field


def ours(images: tuple[np.ndarray, np.ndarray], shape: str, degree: int) -> Speed:
    grid = grid_of(STEP)
    follow(images, shape, degree, grid[:12, :12])  # compiles
    seconds, field = min((follow(images, shape, degree, grid) for _ in range(3)), key=lambda run: run[0])
    points = int((field.status == 0).sum())
    return Speed(points / seconds, points, float(field.iterations.mean()), *errors(grid, field.warp[..., 0]))


def peer(images: tuple[np.ndarray, np.ndarray]) -> Speed | None:
    """The other program's affine setting, one start for all; None where it is not installed."""
    if not PEER.is_file():
        return None
    numbers = [str(number) for number in (SIZE, SUBSET, STEP, MARGIN, THREADS)]
    command = [str(PEER), "-c", PEER_SCRIPT, str(WORK / "speed"), PEER_SHAPES["affine"], *numbers]
    said = subprocess.run(command, capture_output=True, text=True, check=True, cwd=WORK).stdout
    seconds = json.loads(said.strip().splitlines()[-1])["seconds"]
    values = np.load(WORK / "speed" / "peer.npy")
    points, places = values[:, :2], values[:, :2] + values[:, 2:4]
    return Speed(len(values) / seconds, len(values), np.nan, *errors(points, places))


def peak_gflops() -> float:
    """Single precision multiply-adds per second that the machine reaches in a matrix product [GFLOP/s]."""
    n = 1536
    matrix = np.random.default_rng(0).random((n, n), dtype=np.float32)
    seconds = min(_timed(lambda: matrix @ matrix) for _ in range(5))
    return 2e-9 * n**3 / seconds


def _timed(work: Callable[[], object]) -> float:
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def speed() -> Iterator[Figure]:
    """Points per second in three settings, against the other program, and what share of the machine that is."""
    images, peak = pair(), peak_gflops()
    for name, (shape, degree, bar) in SETTINGS.items():
        found = ours(images, shape, degree)
        yield Figure(f"correlation, {name}", found.rate, bar, at_least=True, unit="1/s")
        yield Figure("  points", found.points)
        yield Figure("  mean iterations", found.iterations)
        yield Figure("  bias", found.bias, unit="px")
        yield Figure("  standard deviation of the error", found.sigma, unit="px")
        samples = found.rate * found.iterations * SUBSET**2
        yield Figure("  arithmetic of the iterations", 1e-9 * samples * FLOP_PER_SAMPLE[degree], unit="GFLOP/s")
        yield Figure("  share of the matrix product's", 1e-9 * samples * FLOP_PER_SAMPLE[degree] / peak)
        yield Figure("  coefficients loaded", 4e-9 * samples * (degree + 1) ** 2, unit="GB/s")
        if name == "affine, bicubic":
            yield from against(found, peer(images))


def against(found: Speed, other: Speed | None) -> Iterator[Figure]:
    if other is None:
        print("pyvale is not installed ('make peer' does it): not compared", file=sys.stderr)
        return
    yield Figure("  times as many as pyvale", found.rate / other.rate, 9.0, at_least=True)
    yield Figure("  pyvale", other.rate, unit="1/s")
    yield Figure("  pyvale: points", other.points)
    yield Figure("  bias over pyvale's", found.bias / other.bias)
    yield Figure("  standard deviation over pyvale's", found.sigma / other.sigma)


def _found(reference: Template, target: Spline, grid: np.ndarray, starts: np.ndarray) -> Field:
    subsets = with_sums(reference, grid, Subset(SUBSET), THREADS)
    return correlate_field(subsets, target, grid, starts, Subset(SUBSET), threads=THREADS)


def growth() -> Iterator[Figure]:
    """Seconds per point from 10⁴ to 10⁶ points, without the splines of the images."""
    images = pair()
    reference, target = template(spline(images[0], 3)), spline(images[1], 3)
    costs = []
    for step in (20, 6, 2):
        grid = grid_of(step)
        starts = identity(grid + TRUTH[:2, 2])
        costs.append(_timed(partial(_found, reference, target, grid, starts)) / grid[..., 0].size)
        yield Figure(f"  {grid[..., 0].size} points, seconds per 10,000", 1e4 * costs[-1], unit="s")
    yield Figure("cost per point, most over least from 10⁴ to 10⁶", max(costs) / min(costs))
