"""Noise against spatial resolution: what the variants of a sweep pay for what they gain."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from dicflow.kinds.kind import summary_of
from dicflow.kinds.noise_floor import NoiseFloorTable
from dicflow.kinds.quantities import QUANTITIES, STRAINS
from dicflow.kinds.total import Total
from dicflow.pipeline import Result
from dicflow.views.line_charts import Curve, chart_over_values

__all__ = ["Resolution", "resolution_chart", "resolutions"]


class Resolution(NamedTuple):
    """Of one variant; what is unknown is None.

    side : of the virtual strain gauge, in ``unit``
    sigma : strain → its standard deviation
    measured : whether σ was measured where nothing deforms; otherwise it is predicted from the image noise
    """

    side: float
    unit: str
    sigma: dict[str, float]
    measured: bool


def resolutions(result: Result) -> list[Resolution | None]:
    """Of each variant; None without subsets, by which gauge and noise are known."""
    totals = result.stages_of("total")
    return [_resolution(result, totals[-1], variant) if totals else None for variant in range(len(result.values))]


def _resolution(result: Result, stage: str, variant: int) -> Resolution | None:
    there = [step for step in result.steps(stage, variant) if result.has(stage, step, variant)]
    if not there:
        return None
    total = Total.read(result.product(stage, there[-1], variant))
    if total.gauge is None:
        return None
    floor = _noise_floor(result, variant)
    summary = summary_of(total.product) if floor is None else floor.summary
    sigma = {name: float(summary[key]) for name in STRAINS if summary.get(key := f"sigma_{name}") is not None}
    side_px, side_mm = total.gauge
    side, unit = (side_px, "px") if side_mm is None else (side_mm, "mm")
    return Resolution(side, unit, sigma, floor is not None)


def _noise_floor(result: Result, variant: int) -> NoiseFloorTable | None:
    stages = [stage for stage in result.stages_of("noise") if result.has(stage, None, variant)]
    return NoiseFloorTable.read(result.product(stages[-1], None, variant)) if stages else None


def resolution_chart(found: Sequence[Resolution | None], labels: Sequence[str]) -> str | None:
    """σ of the strains over the gauge, one mark per variant, as SVG; None where all variants have one gauge.

    labels : of the variants, for who points at a mark
    """
    known = [(one, label) for one, label in zip(found, labels, strict=True) if one is not None and one.sigma]
    if len({one.side for one, _ in known}) < 2:
        return None
    names = [name for name in STRAINS if any(name in one.sigma for one, _ in known)]
    curves = [_curve(name, known) for name in names]
    return chart_over_values(curves, f"virtual strain gauge [{known[0][0].unit}]", "σ of the strain [–]")


def _curve(name: str, known: Sequence[tuple[Resolution, str]]) -> Curve:
    side = np.array([one.side for one, _ in known])
    sigma = np.array([one.sigma.get(name, np.nan) for one, _ in known])
    symbol, titles = QUANTITIES[name].symbol, [label for _, label in known]
    return Curve(symbol, side, sigma, np.zeros(len(known), bool), joined=False, titles=titles)
