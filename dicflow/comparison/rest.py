"""Steps at rest: how far the fields scatter there, beside the standard deviation that is stated."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import islice
from typing import TYPE_CHECKING, Any, NamedTuple

from dicflow.kinds.kind import steps_of, summary_of
from dicflow.kinds.probes import ProbeTable
from dicflow.kinds.quantities import BASIC, DISPLACEMENTS, QUANTITIES
from dicflow.kinds.total import Total
from dicflow.pipeline.result import Result

if TYPE_CHECKING:
    import numpy as np

__all__ = [
    "MOST_OVER_SIGMA",
    "NORMAL_STRAINS",
    "Pattern",
    "Scatter",
    "StillSteps",
    "pattern_at_rest",
    "probe_scatter",
    "scatter_at_rest",
    "steps_at_rest",
    "strain_over_sigma",
]

NORMAL_STRAINS = ("exx", "eyy")
"""The strains by which a step counts as one at rest."""
MOST_OVER_SIGMA = 1.5
"""Largest strain over its σ of a step at rest, root mean square."""
_MOST_STEPS = 8
_WIDTH_ERROR = 1.36
"""Standard error of half the width of the middle 68 % over that of a standard deviation."""
_READINGS = ("strain", "sigma_strain")
_STANDARD_ERRORS = 3.0
_MODEL = 0.2
"""Relative error of a stated σ that is no reason for a warning."""


class Scatter(NamedTuple):
    """A quantity at the steps at rest; means over the steps, so that a few bad points do not count.

    found : half the width of the middle 68 % of the points, without the motion of the whole specimen
    stated : median σ by the noise of the photographs
    chance : relative standard error of ``found``, by the number of points whose subsets or gauges do not overlap
    """

    name: str
    unit: str
    found: float
    stated: float
    chance: float

    @property
    def ratio(self) -> float:
        """Found over stated."""
        return self.found / self.stated

    @property
    def exceeds(self) -> bool:
        """Whether the scatter is larger than the stated σ by more than chance and the model of the noise allow."""
        return self.ratio > 1.0 + max(_MODEL, _STANDARD_ERRORS * self.chance)


class Pattern(NamedTuple):
    """How the scatter of a quantity lies over points and steps.

    common : share of its variance that is one field for all steps; None for one step
    smooth : share of its variance that changes slowly over the specimen
    rest : scatter without the smooth part, over the stated σ
    """

    common: float | None
    smooth: float
    rest: float


def steps_at_rest(result: Result, total: str) -> tuple[str, ...]:
    """Steps of a total at which nothing deforms, at most eight: those of a noise floor, else found by their strains."""
    for stage in result.stages_of("noise"):
        if result.source(stage, "total") == total and result.has(stage):
            return tuple(steps_of(result.product(stage)))[:_MOST_STEPS]
    there = (step for step in result.steps(total) if result.has(total, step))
    return tuple(islice((step for step in there if _is_at_rest(Total.read(result.product(total, step)))), _MOST_STEPS))


def strain_over_sigma(total: Total) -> float:
    """Strains εxx and εyy over their stated σ, root mean square over the points; infinite without any."""
    import numpy as np

    strains = np.stack([total[name] for name in NORMAL_STRAINS])
    sigma = np.stack([total.sigma(name) for name in NORMAL_STRAINS])
    known = np.isfinite(strains) & (sigma > 0.0)
    return float(np.sqrt(np.mean((strains[known] / sigma[known]) ** 2))) if known.any() else math.inf


class StillSteps(NamedTuple):
    """Steps at rest.

    totals : of them, with uncertainties
    fields : of each step, quantity → values (n,) without the motion of the whole specimen, and stated σ (n,)
    """

    totals: Sequence[Total]
    fields: Sequence[Mapping[str, tuple[np.ndarray, np.ndarray]]]

    @classmethod
    def of(cls, totals: Sequence[Total]) -> StillSteps:
        """The steps of some totals."""
        from dicflow.stages.noise_floor import fields_at_rest

        return cls(totals, [fields_at_rest(total) for total in totals])


def scatter_at_rest(still: StillSteps) -> list[Scatter]:
    """Scatter of displacements and strains."""
    import numpy as np

    from dicflow.core.uncertainty.scatter import half_width

    totals, fields = still
    flat = () if totals[0].in_space else ("W",)
    found = []
    for name in (name for name in BASIC if name not in flat):
        values, sigmas = zip(*(one[name] for one in fields), strict=True)
        scatter, stated = (
            float(np.mean([*map(middle, one)])) for middle, one in ((half_width, values), (np.median, sigmas))
        )
        unit = QUANTITIES[name].unit_in(totals[0].unit)
        found.append(Scatter(name, unit, scatter, stated, _chance(totals[0], name)))
    return found


def pattern_at_rest(still: StillSteps, name: str) -> Pattern:
    """The pattern of one quantity, at the points that have a value at all steps."""
    import numpy as np

    from dicflow.core.uncertainty.scatter import common_share, half_width, smooth_part, without_outliers

    totals, fields = still
    known = [np.isfinite(total["U"]) for total in totals]
    everywhere = np.all(known, axis=0)
    values, sigmas = (
        np.stack([one[name][k][everywhere[mask]] for one, mask in zip(fields, known, strict=True)]) for k in (0, 1)
    )
    values = without_outliers(values)
    rough = values - smooth_part(values, totals[0]["xy_reference"][everywhere])
    return Pattern(
        common_share(values) if len(values) > 1 else None,
        float(1.0 - rough.var() / values.var()),
        half_width(rough) / float(np.median(sigmas)),
    )


def probe_scatter(table: ProbeTable, steps: Sequence[str]) -> list[Scatter]:
    """Strain of each extensometer at steps at rest: its root mean square, since it is zero there.

    All refer to the first photographs, so that chance is that of one value.
    """
    rows = [row for row in table.rows if row["step"] in steps and row["kind"] == "extensometer"]
    return list(_of_probes(rows))


def _of_probes(rows: Sequence[Mapping[str, Any]]) -> Iterator[Scatter]:
    for name in dict.fromkeys(str(row["probe"]) for row in rows):
        own = [row for row in rows if row["probe"] == name and row["strain"] is not None and row["sigma_strain"]]
        if own:
            found, stated = (math.sqrt(sum(row[key] ** 2 for row in own) / len(own)) for key in _READINGS)
            yield Scatter(f"strain of {name}", "1", found, stated, math.sqrt(0.5))


def _is_at_rest(total: Total) -> bool:
    """By the strains; no array is read where the means show a deformation."""
    summary = summary_of(total.product)
    pairs = [(summary.get(f"mean_{name}"), summary.get(f"sigma_{name}")) for name in NORMAL_STRAINS]
    if any(mean is None or sigma is None or abs(mean) > 4.0 * sigma for mean, sigma in pairs):
        return False
    return strain_over_sigma(total) <= MOST_OVER_SIGMA


def _chance(total: Total, name: str) -> float:
    """Relative standard error of the width over points that overlap, by Gaussian errors."""
    side = total.subset_size if name in DISPLACEMENTS or total.gauge is None else total.gauge.side_px
    points = total.known().sum() * min(1.0, (total.step_size / side) ** 2)
    return _WIDTH_ERROR / math.sqrt(2.0 * max(1.0, points))
