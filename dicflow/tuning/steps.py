"""The few steps of a test at which settings are tried."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

import numpy as np

from dicflow.comparison.rest import MOST_OVER_SIGMA, NORMAL_STRAINS, strain_over_sigma
from dicflow.errors import StageError
from dicflow.kinds.kind import summary_of
from dicflow.kinds.total import Total
from dicflow.pipeline import Pipeline, Result
from dicflow.tuning.stages import Tuned, reduced

__all__ = ["ChosenSteps", "Run", "choose_steps"]

_SURVEYED = 6
"""Steps that are looked at where a test has not been run."""
_FOUND = 0.95
"""Share of the points, of those found from step to step, that must be found from the first photograph at once."""

Run = Callable[[Pipeline], Result]


class ChosenSteps(NamedTuple):
    """Steps at which settings are tried.

    first : to which the strains refer
    still : one at which nothing deforms; None if none is known
    deformed : the one of largest strain that the search reaches from the first photograph
    strain : its root mean square there [-]
    """

    first: str
    still: str | None
    deformed: str
    strain: float

    @property
    def names(self) -> tuple[str, ...]:
        """In the order of the test; a step at rest comes before the deformed one, from which no search starts."""
        return tuple(filter(None, (self.first, self.still, self.deformed)))


class _State(NamedTuple):
    """A step with the present settings. strain : root mean square; over_sigma : of the strain over its σ; valid :
    share of the points"""

    name: str
    strain: float
    over_sigma: float
    valid: float


def choose_steps(pipeline: Pipeline, tuned: Tuned, run: Run) -> ChosenSteps:
    """The first step, one at rest, and the one of largest strain.

    By the stored results of the file's own settings; where there are none, a few steps spread over the test are
    measured.

    Raises StageError where no deformed step can be measured.
    """
    names = pipeline.graph.steps[tuned.photographs]
    states = _states(pipeline.result(), tuned.total)
    if len(states) < len(names) - 1:
        surveyed = [names[place] for place in _spread(len(names))]
        states = _states(run(reduced(pipeline, tuned, [tuned.present], surveyed)), tuned.total)
    if not states:
        raise StageError(f"{pipeline.name}: no step after the first has strains to tune by; look at the run's report")
    still = min(states, key=lambda state: state.over_sigma)
    at_rest = still.name if still.over_sigma <= MOST_OVER_SIGMA and len(states) > 1 else None
    moving = [state for state in states if state.name != at_rest]
    for state in _from_largest(moving):
        chosen = ChosenSteps(names[0], at_rest, state.name, state.strain)
        reached = _states(run(reduced(pipeline, tuned, [tuned.present], chosen.names)), tuned.total)
        if reached and reached[-1].name == state.name and reached[-1].valid >= _FOUND * state.valid:
            return chosen
    raise StageError(f"{pipeline.name}: no step is found from the first photograph alone; add one of smaller motion")


def _spread(count: int) -> list[int]:
    """Places of a few steps over a test, with the first two and the last."""
    return sorted({0, min(1, count - 1), *np.linspace(0, count - 1, _SURVEYED - 1).round().astype(int).tolist()})


def _states(result: Result, total: str) -> list[_State]:
    return [_state(result, total, step) for step in result.steps(total) if result.has(total, step)]


def _state(result: Result, stage: str, step: str) -> _State:
    total = Total.read(result.product(stage, step))
    strains = np.stack([total[name] for name in NORMAL_STRAINS])
    over_sigma = strain_over_sigma(total)
    if math.isinf(over_sigma):
        return _State(step, 0.0, math.inf, 0.0)
    valid = float(summary_of(total.product)["valid_share"])
    return _State(step, float(np.sqrt(np.nanmean(strains**2))), over_sigma, valid)


def _from_largest(states: Sequence[_State]) -> Iterator[_State]:
    """The step of largest strain, then those next to one half, a quarter … of it."""
    largest = max(state.strain for state in states)
    left = list(states)
    for halved in range(6):
        if left:
            nearest = min(left, key=lambda state: abs(state.strain - largest * 0.5**halved))
            left.remove(nearest)
            yield nearest
