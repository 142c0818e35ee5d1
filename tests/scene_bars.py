"""Bars of the scenes in space: coverage of the stated uncertainties, and what single scenes must show."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from tests.bars import Figure
from tests.measured_scenes import QUANTITIES, Measured, MeasuredScene, Row, row
from tests.scenes_in_space import scene
from tests.scenes_in_space.cameras import FIELD_MM
from tests.scenes_in_space.truth import crack_distance

__all__ = ["CRITERIA", "Criterion", "scene_figures", "worst"]

STRAINS = ("exx", "eyy", "gxy")


class Criterion(NamedTuple):
    """A bar of coverage: the share of errors [%], how far a share is from what it ought to be, and the bar of that."""

    words: str
    share: Callable[[Row], float]
    off: Callable[[float], float]
    bar: float


CRITERIA = (
    Criterion("within 1u", lambda found: found.within_1, lambda share: abs(share - 68.0), 5.0),
    Criterion("within 2u", lambda found: found.within_2, lambda share: abs(share - 95.0), 3.0),
    Criterion("beyond 3u", lambda found: found.beyond_3, lambda share: share, 1.0),
)
VALID = {"bend": 97.0, "strip": 99.0, "leap": 99.0, "blur": 97.0}
"""Least share of valid points [%]."""
LAST_STEP = {"blur": 3}
"""The last step that has bars of its own: a blur of 3 px."""
TILTS = ("tilt", "nod")
MOST_TILT_BIAS_UM = 1e3 * FIELD_MM / 50_000.0
MOST_BEND_UM, MOST_GAUGE_PCT = 3.5, 0.03
RIGHT_AT_CRACK, BEYOND_BESIDE_CRACK, VALID_AWAY = 98.0, 1.0, 90.0
"""Shares [%] of points that a crack cuts, of the strains nearer than one subset, and of the points further away."""


def scene_figures(name: str, found: MeasuredScene) -> Iterator[Figure]:
    """Everything that a scene must show."""
    yield Figure(f"{name}: steps measured", len(found.steps), len(scene(name).steps), at_least=True)
    for step, points in found.steps.items():
        yield from coverage(f"{name}, step {step}", points)
        yield from _own(name, step, points)
    for gauge, error in found.gauge_errors.items():
        yield Figure(f"{name}: largest error of {gauge}'s strain", 100.0 * error, MOST_GAUGE_PCT, unit="%")


def coverage(words: str, points: Measured) -> Iterator[Figure]:
    """The quantity furthest from each bar of coverage."""
    for criterion in CRITERIA:
        share, quantity = furthest(criterion, points)
        off = criterion.off(share)
        name = f"{words}: {criterion.words}" + (", from what it ought to be" if off != share else "")
        yield Figure(f"{name} ({quantity})", off, criterion.bar, unit="%")


def furthest(criterion: Criterion, points: Measured) -> tuple[float, str]:
    """The share [%] that is furthest from what it ought to be, and its quantity; NaN where nothing is valid."""
    shares = [criterion.share(row(points, quantity)) for quantity in QUANTITIES]
    index = int(np.argmax([criterion.off(share) for share in shares]))
    return shares[index], tuple(QUANTITIES)[index]


def worst(steps: dict[int, Measured]) -> Iterator[tuple[Criterion, float, str, int]]:
    """For each bar of coverage the share [%] that is furthest from it, its quantity and step."""
    for criterion in CRITERIA:
        found = [(*furthest(criterion, points), step) for step, points in steps.items()]
        index = int(np.argmax([criterion.off(share) for share, *_ in found]))
        yield criterion, *found[index]


def _own(name: str, step: int, points: Measured) -> Iterator[Figure]:
    """What one scene must show at a step."""
    words = f"{name}, step {step}"
    bar = VALID.get(name) if step <= LAST_STEP.get(name, step) else None
    yield Figure(f"{words}: valid", 100.0 * points.valid.mean(), bar, at_least=True, unit="%")
    if name in TILTS:
        yield Figure(f"{words}: |bias of W|", abs(row(points, "W").bias), MOST_TILT_BIAS_UM, unit="µm")
    if name == "bend":
        yield Figure(f"{words}: stated for W, median", row(points, "W").stated, MOST_BEND_UM, unit="µm")
        yield Figure(f"{words}: error of W, rms", row(points, "W").rms, MOST_BEND_UM, unit="µm")
    if scene(name).cracks:
        yield from _cracked(name, words, points)


def _cracked(name: str, words: str, points: Measured) -> Iterator[Figure]:
    """What points near and away from a crack must show."""
    away = crack_distance(scene(name), points.places)
    cut, beside = away <= points.subset_size // 2, away <= points.subset_size
    scaled = {quantity: np.abs(points.error[quantity]) / points.stated[quantity] for quantity in QUANTITIES}
    wrong = np.any([values > 3.0 for values in scaled.values()], axis=0) & points.valid
    right = 100.0 * (~wrong[cut]).mean()
    yield Figure(f"{words}: points cut by a crack lost or right to 3u", right, RIGHT_AT_CRACK, True, "%")
    beyond = max(row(points.of(beside), quantity).beyond_3 for quantity in STRAINS)
    yield Figure(f"{words}: strains beyond 3u beside a crack", beyond, BEYOND_BESIDE_CRACK, unit="%")
    yield Figure(f"{words}: valid away from it", 100.0 * points.valid[~beside].mean(), VALID_AWAY, True, "%")
