"""How exact correlated subsets of one camera are, at the level of the core: `make accuracy`."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from dicflow.core.correlation.subsets import Correlated, Subset, correlate
from dicflow.core.correlation.template import Template, template
from dicflow.core.correlation.warp import identity
from dicflow.core.photographs.interpolate import Spline, spline
from dicflow.core.status import Status
from dicflow.core.synthetic.motion import Motion, render_pattern, speckle_pattern
from dicflow.core.synthetic.render import add_noise_and_round
from tests.bars import Figure
from tests.data_folder import SHARED

SAMPLE3, SAMPLE14 = SHARED / "challenge_2d" / "sample3", SHARED / "challenge_2d" / "sample14"
WHOLE = Subset(31)
WAYS = [Subset(size) for size in (15, 21, 31)] + [Subset(size, "quadratic") for size in (21, 31, 41)]
SIZE = (260, 260)
NOISE = 2.0


def planar() -> Iterator[Figure]:
    """Shifts and noise of one camera."""
    yield from every_shift()
    yield from coverage()
    if SHARED.is_dir():
        yield from shifted_photographs()
        yield from growing_frequency()


def photograph(path: Path) -> np.ndarray:
    return cv2.imread(str(path), cv2.IMREAD_UNCHANGED)


def grid(shape: tuple[int, ...], margin: int, step: int) -> np.ndarray:
    """Points (rows, cols, 2), whole pixels."""
    return np.stack(
        np.meshgrid(np.arange(margin, shape[1] - margin, step), np.arange(margin, shape[0] - margin, step)), axis=-1
    ).astype(float)


def from_rest(reference: Template, target: Spline, points: np.ndarray, subset: Subset) -> Correlated:
    """Correlate points (..., 2) that hardly move."""
    centres = points.reshape(-1, 2)
    return correlate(reference, target, centres, identity(centres, subset.shape_function), subset)


def motion_of(points: np.ndarray, found: Correlated) -> np.ndarray:
    """Displacement in the shape of the points (..., 2) [px]; NaN where nothing was found."""
    return found.warp[..., 0].reshape(points.shape) - points


def shifted(by: float) -> Motion:
    shift = np.array([by, -0.5 * by])
    return lambda points: (points + shift, np.broadcast_to(np.eye(2), (*points.shape, 2)))


def every_shift() -> Iterator[Figure]:
    """Bias over the fractions of a pixel, without noise, of grey levels as they are and rounded to 8 bits."""
    pattern = speckle_pattern(SIZE, (4.0, 8.0), 3.0, 0.5, seed=3)
    points, shifts = grid(SIZE, 24, 7), np.arange(0.05, 1.0, 0.1)
    images = [render_pattern(pattern, SIZE, shifted(by), order=5) for by in (0.0, *shifts)]
    for name, kept in (("not rounded", images), ("8 bits", [add_noise_and_round(image, 0.0, [1]) for image in images])):
        reference = template(spline(kept[0]))
        biases = [
            motion_of(points, from_rest(reference, spline(image), points, WHOLE)).mean(axis=(0, 1)) - [by, -0.5 * by]
            for by, image in zip(shifts, kept[1:], strict=True)
        ]
        bar = 5e-4 if name == "not rounded" else None
        yield Figure(f"any shift, {name}: largest bias of u and v", float(np.abs(biases).max()), bar, unit="px")


def coverage() -> Iterator[Figure]:
    """How often the true motion is within one and two reported σ."""
    pattern, points = speckle_pattern(SIZE, (3.0, 6.0), 2.0, 0.5, seed=5), grid(SIZE, 22, 24)
    clean = [render_pattern(pattern, SIZE, shifted(by)) for by in (0.0, 0.3)]
    ways = [Subset(21), Subset(31), Subset(31, "quadratic"), Subset(31, "affine", 6.0), Subset(31, "quadratic", 8.0)]
    for subset in ways:
        scaled = np.concatenate([scaled_errors(clean, points, subset, seed) for seed in range(30)])
        name = f"{subset.shape_function} {subset.size}" + (f", weight σ {subset.gaussian:g} px" * (subset.gaussian > 0))
        for sigmas, share, tolerance in ((1, 68.0, 3.0), (2, 95.0, 2.0)):
            inside = 100.0 * float((np.abs(scaled) < sigmas).mean())
            yield Figure(
                f"{name}: |share within {sigmas}σ of u and v − {share:g} %|", abs(inside - share), tolerance, unit="%"
            )
        yield Figure(f"{name}: |scatter over reported σ − 1|", abs(float(scaled.std()) - 1.0), 0.1)


def scaled_errors(clean: list[np.ndarray], points: np.ndarray, subset: Subset, seed: int) -> np.ndarray:
    """Errors of u and v over their reported σ in one pair of noisy 8-bit images."""
    images = [spline(add_noise_and_round(image, NOISE, [seed, side])) for side, image in enumerate(clean)]
    found = from_rest(template(images[0]), images[1], points, subset)
    sigma = np.sqrt((NOISE**2 + 1.0 / 12.0) * found.covariance[:, [0, 2]])
    return ((motion_of(points, found).reshape(-1, 2) - [0.3, -0.15]) / sigma).ravel()


def shifted_photographs() -> Iterator[Figure]:
    """Sample 3 of the first challenge: shifts of 0 to 1 px, 31 px, step 7; the file names are the truth."""
    inside = photograph(SAMPLE3 / "roi.tif") > 0
    reference_image = photograph(SAMPLE3 / "Sample3 Reference.tif")
    points = grid(inside.shape, 20, 7)
    points = points[inside[points[..., 1].astype(int), points[..., 0].astype(int)]]
    for degree in (3, 5):
        reference, biases, scatters = template(spline(reference_image, degree)), [], []
        for path in sorted(SAMPLE3.glob("Sample3-*.tif")):
            truth = [float(path.name.split(f" {axis}")[1].split()[0]) for axis in "XY"]
            error = motion_of(points, from_rest(reference, spline(photograph(path), degree), points, WHOLE)) - truth
            biases.append(np.nanmean(error, axis=0))
            scatters.append(np.nanstd(error, axis=0))
        bias, scatter = np.abs(biases).max(axis=0), np.mean(scatters, axis=0)
        name = f"sample 3, {'bicubic' if degree == 3 else 'biquintic'}"
        best = degree == 5
        yield Figure(f"{name}: largest bias of u", float(bias[0]), 0.0012 if best else None, unit="px")
        yield Figure(f"{name}: largest bias of v", float(bias[1]), 0.0012 if best else None, unit="px")
        yield Figure(f"{name}: σ, mean of the files", float(scatter.max()), 0.004 if best else None, unit="px")
        yield Figure(f"{name}: σ, largest of the files", float(np.max(scatters)), unit="px")


def growing_frequency() -> Iterator[Figure]:
    """Sample 14 of the first challenge: u of three amplitudes of strain against the commanded curve."""
    command = np.loadtxt(SAMPLE14 / "command.csv", delimiter=",")
    reference_image = photograph(SAMPLE14 / "Sample14 Reference.tif")
    reference, points = template(spline(reference_image)), grid(reference_image.shape, 25, 6)
    targets = {name: spline(photograph(SAMPLE14 / f"Sample14 {name} Amp0.1b.tif")) for name in ("L1", "L3", "L5")}
    print("\nsample 14: curve of u, mean over the rows, against command.csv [px]")
    print(f"{'subset':<14}{'':>4}{'rms':>9}{'largest':>9}{'mean':>9}{'σ':>9}{'lost':>7}")
    for subset in WAYS:
        way = f"{subset.shape_function} {subset.size}"
        rms = []
        for column, name in enumerate(targets):
            found = from_rest(reference, targets[name], points, subset)
            u = motion_of(points, found)[..., 0]
            error = np.nanmean(u, axis=0) - np.interp(points[0, :, 0], command[:, 0], command[:, 2 * column + 1])
            rms.append(float(np.sqrt(np.mean(error**2))))
            numbers = (rms[-1], np.abs(error).max(), error.mean(), np.nanstd(u, axis=0).mean())
            lost = int((found.status != Status.VALID).sum())
            print(f"{way:<14}{name:>4}", *(f"{number:8.4f}" for number in numbers), f"{lost:>6}")
        yield Figure(f"sample 14, {way}: rms of the curve, worst of three", max(rms), unit="px")
