"""How often a value called valid is right in hard scenes: ``python -m tests.hard_scenes [KIND …]``.

Random scenes of :mod:`tests.hard_photographs` are measured as any other: region, correlation, displacement. The
thresholds of the tests for edges were chosen on the seeds below 500; figures are reported on those from 500 on, which
is the default. A point counts unless most of its subset is hidden, since then the subset shows something else.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator
from contextlib import suppress
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.status import Status
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.stages.correlate import Correlate
from dicflow.stages.deformation import Deformation
from dicflow.stages.region import Region
from tests.hard_photographs import HEIGHT, KINDS, WIDTH, Scene, scene

__all__ = ["REPORTED", "Measured", "Shares", "joined", "measure", "measured", "shares"]

REPORTED = 500
"""First seed that no threshold was chosen on."""
STEP_SIZE, MARGIN = 7, 28
_MAX_HIDDEN_SHARE = 0.5
_ERROR_PX = 0.05
"""Error that is within what is stated at any uncertainty."""


class Measured(NamedTuple):
    """The points of one scene that count and had a value in the reference photograph.

    error : (n, 2) [px]; NaN where lost; sigma : (n, 2) [px]; status : (n,)
    places : (n, 2) — in the reference photograph [px]
    """

    error: np.ndarray
    sigma: np.ndarray
    status: np.ndarray
    places: np.ndarray

    @property
    def valid(self) -> np.ndarray:
        """Points (n,) with a value."""
        return (self.status == Status.VALID) & np.isfinite(self.error).all(axis=1)


class Shares(NamedTuple):
    """Shares of the points with a value, except the first, which is that of all points.

    valid : with a value; beyond_3, beyond_5 : error over 0.05 px and over so many σ; wrong : over 0.1 px
    scatter : root mean square of error over σ; worst : largest error [px]
    """

    points: int
    valid: float
    beyond_3: float
    beyond_5: float
    wrong: float
    scatter: float
    worst: float


def measure(scene: Scene) -> Measured:
    """The points of a scene."""
    images = [Images.write(image) for image in (scene.reference, scene.target)]
    rectangle = (float(MARGIN), float(MARGIN), float(WIDTH - MARGIN), float(HEIGHT - MARGIN))
    region = Region(rectangle=rectangle).run(images=images[0])
    stage = Correlate(subset_size=scene.subset_size, step_size=STEP_SIZE)
    first = stage.run(images=images[0], images_first=images[0], region=region)
    second = stage.run(
        images=images[1], images_first=images[0], region=region, images_before=images[0], correlation_before=first
    )
    total = Deformation().run(points=second, points_first=first)
    hidden = cv2.blur(scene.hidden.astype(np.float64), (scene.subset_size, scene.subset_size))
    col, row = np.nan_to_num(first["xy"]).astype(int).transpose(2, 0, 1)
    counts = (first["status"] == Status.VALID) & (hidden[row, col] <= _MAX_HIDDEN_SHARE)
    places = first["xy"][counts]
    truth = scene.motion.target(places) - places
    found, sigma = (np.stack([total[f"{name}U"], total[f"{name}V"]], axis=-1)[counts] for name in ("", "sigma_"))
    return Measured(found - truth, sigma, second["status"][counts], places)


def joined(scenes: Iterable[Measured]) -> Measured:
    """The points of several scenes."""
    return Measured._make(np.concatenate(parts) for parts in zip(*scenes, strict=True))


def shares(points: Measured) -> Shares:
    """How many points have a value, and of how many it is not within what is stated."""
    error, sigma = np.abs(points.error[points.valid]), points.sigma[points.valid]
    beyond = [float((error > np.maximum(_ERROR_PX, k * sigma)).any(axis=1).mean()) for k in (3.0, 5.0)]
    wrong = float((error > 0.1).any(axis=1).mean())
    scatter = float(np.sqrt(np.mean((error / sigma) ** 2)))
    return Shares(len(points.status), float(points.valid.mean()), *beyond, wrong, scatter, float(error.max()))


def measured(kind: str, first: int, count: int) -> Measured:
    """The points of the scenes of a kind with the seeds from ``first`` on, without scenes that are refused."""

    def scenes() -> Iterator[Measured]:
        for seed in range(first, first + count):
            with suppress(StageError):
                yield measure(scene(kind, seed))

    return joined(scenes())


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").split("\n", 1)[0])
    parser.add_argument("kinds", nargs="*", metavar="KIND", help=f"of {', '.join(KINDS)}; all by default")
    parser.add_argument("--seeds", nargs=2, type=int, default=(REPORTED, 20), metavar=("FIRST", "COUNT"))
    given = parser.parse_args()
    print(f"{'kind':12}{'points':>8}{'valid':>9}{'> 3 σ':>9}{'> 5 σ':>9}{'> 0.1 px':>10}{'rms σ':>8}{'worst px':>10}")
    for kind in given.kinds or KINDS:
        s = shares(measured(kind, *given.seeds))
        share = "".join(f"{100.0 * part:9.3f}" for part in (s.valid, s.beyond_3, s.beyond_5, s.wrong))
        print(f"{kind:12}{s.points:8}{share} {s.scatter:8.2f}{s.worst:10.3f}", flush=True)


if __name__ == "__main__":
    main()
