"""Scatter at steps at rest beside the σ that is stated: a table, and a warning where they differ."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import NamedTuple

from dicflow.comparison.rest import (
    Pattern,
    Scatter,
    StillSteps,
    pattern_at_rest,
    probe_scatter,
    scatter_at_rest,
    steps_at_rest,
)
from dicflow.kinds.kind import summary_of
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.quantities import symbol_of
from dicflow.kinds.total import Total
from dicflow.pipeline import Result
from dicflow.report.words import number, percent

__all__ = ["AtRest", "at_rest"]

_COMMON, _SMOOTH = 0.75, 0.5
"""Shares from which a scatter counts as one of the first photographs, and as one that neighbouring points share."""
_OFF_LINES_PX = 0.05
"""Distance from the epipolar lines from which a rig counts as one that does not fit."""

Keep = Callable[[Sequence[str], Callable[[], bytes]], bytes | None]
"""Returns the bytes made from some sources, by the function unless they are kept; None if the store lacks products."""


class AtRest(NamedTuple):
    """What is known of the scatter at rest.

    steps : their names
    rows : quantity, scatter, stated σ, ratio, remark
    warning : a sentence; empty if the scatter is what is stated
    probes : a sentence for each extensometer
    """

    steps: tuple[str, ...]
    rows: list[list[str]]
    warning: str
    probes: list[str]


def at_rest(result: Result, keep: Keep) -> AtRest | None:
    """The facts of the last total; None without uncertainties, or without a step at rest."""
    totals = result.stages_of("total")
    if not totals or not any(result.has(totals[-1], step) for step in result.steps(totals[-1])):
        return None
    kinds = ("total", "noise", "probes", "stereo")
    stages = [stage for kind in kinds for stage in result.stages_of(kind)]
    places = [(stage, step) for stage in stages for step in result.steps(stage) or (None,)]
    sources = [result.digest(*place) for place in places if result.has(*place)]
    kept = keep(["scatter at rest", *sources], lambda: json.dumps(_found(result, totals[-1])).encode())
    found = None if kept is None else json.loads(kept)
    return None if found is None else AtRest(tuple(found[0]), *found[1:])


def _found(result: Result, stage: str) -> AtRest | None:
    steps = [step for step in steps_at_rest(result, stage) if result.has(stage, step)]
    totals = [Total.read(result.product(stage, step)) for step in steps]
    if not totals or not totals[0].has_uncertainty:
        return None
    still = StillSteps.of(totals)
    fields = scatter_at_rest(still)
    tables = [ProbeTable.read(result.product(name)) for name in result.stages_of("probes") if result.has(name)]
    probes = [one for table in tables for one in probe_scatter(table, steps)]
    worst = max((one for one in fields if one.exceeds), key=lambda one: one.ratio, default=None)
    warning = ""
    if worst is not None:
        warning = _sentence(worst, pattern_at_rest(still, worst.name), len(steps), _off_lines(result, steps))
    said = [_probe_sentence(one, len(steps)) for one in probes]
    return AtRest(tuple(steps), [_row(one) for one in [*fields, *probes]], warning, said)


def _row(one: Scatter) -> list[str]:
    unit = "–" if one.unit == "1" else one.unit
    remark = "more than chance allows" if one.exceeds else ""
    return [f"{symbol_of(one.name)} [{unit}]", number(one.found, 3), number(one.stated, 3), f"{one.ratio:.2f}", remark]


def _probe_sentence(one: Scatter, steps: int) -> str:
    where = "1 step" if steps == 1 else f"{steps} steps"
    more = ", more than chance allows" if one.exceeds else ""
    figures = f"{number(one.found, 3)}, {one.ratio:.1f} times its stated σ"
    return f"At rest ({where}) the {one.name} scatters by {figures}{more}."


def _sentence(worst: Scatter, pattern: Pattern, steps: int, off_lines_px: float) -> str:
    """The scatter, how it lies over steps and points, and what it may come from."""
    unit = "" if worst.unit == "1" else f" {worst.unit}"
    where = "1 step" if steps == 1 else f"{steps} steps"
    text = (
        f"At rest ({where}) {symbol_of(worst.name)} scatters by {number(worst.found, 3)}{unit}, "
        f"{worst.ratio:.1f} times its stated σ"
    )
    is_common = pattern.common is not None and pattern.common >= _COMMON
    return f"{text}; {_shape(pattern, is_common)}it may come from {_causes(pattern, is_common, off_lines_px)}."


def _shape(pattern: Pattern, is_common: bool) -> str:
    """How the scatter lies over points and steps; empty if it is noise of each step and point."""
    alike = "the same at all these steps" if is_common else ""
    if pattern.smooth < _SMOOTH:
        return f"most of it is {alike}; " if alike else ""
    slow = ", ".join(filter(None, (f"{percent(pattern.smooth)} of it is a slow change over the specimen", alike)))
    return f"{slow}, about which the points scatter by {pattern.rest:.1f} σ, so that it is no noise of the points; "


def _causes(pattern: Pattern, is_common: bool, off_lines_px: float) -> str:
    if pattern.smooth < _SMOOTH:
        return "changes of the light, vibration within the time of exposure, or a pattern that moves on the specimen"
    causes = "vibration, warm air, or cameras that were not triggered together"
    if off_lines_px < _OFF_LINES_PX or not is_common:
        return causes
    return f"a rig that does not fit (points lie {number(off_lines_px, 2)} px off their epipolar lines), {causes}"


def _off_lines(result: Result, steps: Sequence[str]) -> float:
    """Largest distance of the points from their epipolar lines at some steps [px]; 0 for one camera."""
    summaries = [
        summary_of(result.product(stage, step))
        for stage in result.stages_of("points")
        for step in steps
        if step in result.steps(stage) and result.has(stage, step)
    ]
    return max((float(summary.get("epipolar_px") or 0.0) for summary in summaries), default=0.0)
