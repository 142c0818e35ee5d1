"""Whether the settings agree with the caliper of the test, where its pipeline compares with one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np

from dicflow.engine.looks import with_looks
from dicflow.engine.product import Product
from dicflow.io.caliper import Caliper, read_caliper
from dicflow.kinds.probes import ProbeTable
from dicflow.pipeline import Pipeline, Result
from dicflow.pipeline.wiring import Wired, wire
from dicflow.stages.compare import Compare
from dicflow.stages.probes import Probes
from dicflow.tuning.stages import Tuned
from dicflow.tuning.steps import ChosenSteps

__all__ = ["Agreement", "Reading", "caliper_agreement"]

_ALONG = {"y": "eyy", "x": "exx"}
_WITHIN = 2.0


class Reading(NamedTuple):
    """A strain at a step, and its standard uncertainty; 0 if unknown."""

    strain: float
    u: float


class Agreement(NamedTuple):
    """The strain by the caliper at a step, and by each setting.

    what : an extensometer by its name, or the mean of the field
    settings : "present" and "recommended" → reading, those that are known
    """

    step: str
    what: str
    caliper: Reading
    settings: Mapping[str, Reading]

    def difference(self, name: str) -> float:
        """Of a setting from the caliper."""
        return self.settings[name].strain - self.caliper.strain

    def agrees(self, name: str) -> bool:
        """Whether a setting differs by no more than twice the uncertainty of both."""
        return abs(self.difference(name)) <= _WITHIN * math.hypot(self.settings[name].u, self.caliper.u)


def caliper_agreement(
    pipeline: Pipeline, tuned: Tuned, sweep: Result, steps: ChosenSteps, settings: Mapping[str, int]
) -> Agreement | None:
    """The agreement at the deformed step; None for a pipeline without a caliper.

    sweep : has the totals; settings : name → index of its variant
    Raises InputError for a caliper table that cannot be read.
    """
    wired = wire(pipeline.document)
    stage = next((one for one in wired.values() if isinstance(one.node, Compare)), None)
    if stage is None:
        return None
    node = stage.node
    assert isinstance(node, Compare)
    table = read_caliper(pipeline.folder / node.caliper)
    place = pipeline.graph.steps[tuned.photographs].index(steps.deformed)
    if place >= len(table.length_mm):
        return None
    gauge = _extensometer(wired, stage, node)
    totals = {name: sweep.product(tuned.total, steps.deformed, index) for name, index in settings.items()}
    what = "mean of the field" if gauge is None else f"extensometer {node.extensometer}"
    readings = {name: _reading(total, gauge, _ALONG[node.axis]) for name, total in totals.items()}
    known = {name: one for name, one in readings.items() if math.isfinite(one.strain)}
    return Agreement(steps.deformed, what, _by_caliper(table, place), known)


def _extensometer(wired: Mapping[str, Wired], stage: Wired, node: Compare) -> Probes | None:
    """The probe that is compared, alone; None where the field is."""
    source = wired.get(stage.inputs.get("probes", ""))
    if node.extensometer is None or source is None or not isinstance(source.node, Probes):
        return None
    line = source.node.extensometers[node.extensometer]
    return Probes(extensometers={node.extensometer: line}, unit=source.node.unit)


def _reading(total: Product, gauge: Probes | None, along: str) -> Reading:
    if gauge is None:
        field = total[along]
        return Reading(float(np.nanmean(field)), 0.0)
    row = ProbeTable.read(gauge.run(**with_looks(gauge, {"total": (total,)}))).rows[-1]
    strain, u = row["strain"], row["u_strain"]
    return Reading(math.nan if strain is None else strain, u or 0.0)


def _by_caliper(table: Caliper, place: int) -> Reading:
    """The strain since the first step; each length is taken as certain to one step of its scale."""
    length = table.length_mm
    u = math.sqrt(2.0) * _scale_mm(length) / length[0]
    return Reading(float(length[place] / length[0] - 1.0), float(u))


def _scale_mm(lengths: Sequence[float] | np.ndarray) -> float:
    """The decimal place to which all lengths are read [mm]."""
    decimals = (len(f"{length:.6f}".rstrip("0").partition(".")[2]) for length in lengths)
    return float(10.0 ** -max(decimals))
