"""What each setting measured: its noise, and how much of the strain it blurs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from scipy.ndimage import map_coordinates

from dicflow.comparison.rest import NORMAL_STRAINS
from dicflow.core.arrays import Array
from dicflow.core.strain.blur import difference_by_noise, estimated_bias, mean_square_differences
from dicflow.core.strain.gauge_kernel import GaugeSetting, gauge_kernel
from dicflow.errors import StageError
from dicflow.kinds.correlation import Correlation
from dicflow.kinds.kind import summary_of
from dicflow.kinds.total import Gauge, Total
from dicflow.pipeline import Result
from dicflow.tuning.stages import Tuned
from dicflow.tuning.steps import ChosenSteps

__all__ = ["Trial", "trials"]

_KEPT = 0.95
"""Share of the points, of those that the best setting finds, that a setting must find."""
_FEWEST_POINTS = 30


class Trial(NamedTuple):
    """One setting at the chosen steps; root mean squares over the points that all settings have, and εxx and εyy [-].

    predicted : noise, as the program states it
    measured : noise at the step at rest; None without one
    bias : by which the gauge blurs the strains, estimated
    points : of the grid, by which the time of a run grows
    """

    setting: GaugeSetting
    gauge: Gauge
    predicted: float
    measured: float | None
    bias: float
    points: int

    @property
    def noise(self) -> float:
        """The larger one: at rest no subset deforms, and no prediction knows of vibration and hot air."""
        return max(self.predicted, self.measured or 0.0)

    @property
    def error(self) -> float:
        """Noise and bias together."""
        return math.hypot(self.noise, self.bias)


class _Fields(NamedTuple):
    """One setting at places in the first photograph: strains and their σ (strain, place), NaN where unknown."""

    strains: np.ndarray
    sigma: np.ndarray
    still: np.ndarray | None


def trials(result: Result, tuned: Tuned, settings: Sequence[GaugeSetting], steps: ChosenSteps) -> list[Trial]:
    """Of the settings that lose no points; the variants of the result are those of the settings.

    Raises StageError where too few points are common to all.
    """
    stage = tuned.total
    there = [k for k in range(len(settings)) if all(result.has(stage, step, k) for step in steps.names[1:])]
    totals = {k: Total.read(result.product(stage, steps.deformed, k)) for k in there}
    shares = {k: float(summary_of(total.product)["valid_share"]) for k, total in totals.items()}
    kept = [k for k in there if shares[k] >= _KEPT * max(shares.values())]
    if not kept:
        raise StageError("no setting could be tried; the messages above say why")
    coarsest = max(kept, key=lambda k: (settings[k].step_size, settings[k].side_px))
    places = totals[coarsest]["xy_reference"][totals[coarsest].known()]
    still = {k: None if steps.still is None else Total.read(result.product(stage, steps.still, k)) for k in kept}
    fields = _common([_fields(totals[k], still[k], places) for k in kept])
    points = [int(totals[k].known().sum()) for k in kept]
    gauges = [gauge for k in kept if (gauge := totals[k].gauge) is not None]
    kernels = [gauge_kernel(_as_used(result, tuned, settings[k], steps.deformed, k)) for k in kept]
    return _judged([settings[k] for k in kept], gauges, fields, points, kernels)


def _as_used(result: Result, tuned: Tuned, setting: GaugeSetting, step: str, variant: int) -> GaugeSetting:
    """The setting with the shape function that a step was searched with."""
    found = Correlation.read(result.product(tuned.correlation, step, variant))
    return setting._replace(shape_function=found.shape_function)


def _judged(
    settings: Sequence[GaugeSetting],
    gauges: Sequence[Gauge],
    fields: Sequence[_Fields],
    points: Sequence[int],
    kernels: Sequence[Array],
) -> list[Trial]:
    predicted = np.array([_root_mean_square(one.sigma) for one in fields])
    measured = [None if one.still is None else float(one.still.std(axis=1).mean()) for one in fields]
    differences = mean_square_differences(np.stack([one.strains.ravel() for one in fields]))
    by_noise = difference_by_noise(predicted, kernels)
    area = max(count * setting.step_size**2 for count, setting in zip(points, settings, strict=True))
    bias = estimated_bias(differences, by_noise, kernels, area)
    return [
        Trial(*one) for one in zip(settings, gauges, predicted.tolist(), measured, bias.tolist(), points, strict=True)
    ]


def _fields(total: Total, still: Total | None, places: np.ndarray) -> _Fields:
    strains = _at(total, NORMAL_STRAINS, places)
    sigma = _at(total, [f"sigma_{name}" for name in NORMAL_STRAINS], places)
    return _Fields(strains, sigma, None if still is None else _at(still, NORMAL_STRAINS, places))


def _at(total: Total, names: Sequence[str], places: np.ndarray) -> np.ndarray:
    """Fields (name, place) between the points of a total's grid."""
    grid, step = total["xy_reference"], total.step_size
    row, col = np.argwhere(np.isfinite(grid).all(axis=-1))[0]
    start = grid[row, col] - step * np.array([col, row])
    x, y = ((places - start) / step).T
    return np.stack([map_coordinates(total[name], [y, x], order=1, cval=np.nan) for name in names])


def _common(fields: Sequence[_Fields]) -> list[_Fields]:
    """The fields where all are known. Raises StageError where that is almost nowhere."""
    every = [part for one in fields for part in one if part is not None]
    known = np.all([np.isfinite(part).all(axis=0) for part in every], axis=0)
    if known.sum() < _FEWEST_POINTS:
        raise StageError(f"only {known.sum()} points are common to all settings; measure a larger region")
    return [
        _Fields(one.strains[:, known], one.sigma[:, known], None if one.still is None else one.still[:, known])
        for one in fields
    ]


def _root_mean_square(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
