"""What a workbook of a whole test holds: the points of one step, and how large more would be."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from dicflow.io.exports.items import Item
from dicflow.kinds.kind import summary_of
from dicflow.pipeline.result import Result

__all__ = ["megabytes", "of_one_step", "shown_steps"]

_STRAINS = ("mean_exx", "mean_eyy")
_BYTES_PER_POINT = 170.0
"""Of a point of the grid with all columns that people read, as measured."""

Steps = Mapping[str, Sequence[str | None]]
"""Stage → its steps that are exported; None for a stage that runs once."""


def shown_steps(result: Result, steps: Steps, asked: str | None, variant: int) -> dict[str, str | None]:
    """Stage → the step whose points are written: the one asked for, else that of the largest mean strain."""
    return {
        stage: asked if asked in names else max(names, key=lambda step: _strain(result, stage, step, variant))
        for stage, names in steps.items()
    }


def of_one_step(item: Item, shown: Mapping[str, str | None]) -> Item:
    """An item, with its points if they are shown."""
    return item._replace(whole=item.step == shown[item.stage])


def megabytes(result: Result, stage: str, steps: Sequence[str | None], variant: int) -> float:
    """About the size of a workbook with all points of some steps [MB]; 0 for a stage that gives no total."""
    if result.kind(stage) != "total":
        return 0.0
    points = sum(math.prod(result.arrays(stage, step, variant)["U"].shape) for step in steps)
    return points * _BYTES_PER_POINT / 1e6


def _strain(result: Result, stage: str, step: str | None, variant: int) -> float:
    if result.kind(stage) != "total":
        return 0.0
    summary = summary_of(result.product(stage, step, variant))
    return max(abs(float(summary.get(name) or 0.0)) for name in _STRAINS)
