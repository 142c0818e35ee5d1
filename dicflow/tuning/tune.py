"""A sweep over settings at a few steps, judged and compared with what a user must see."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import NamedTuple

from dicflow.errors import ConfigurationError, StageError
from dicflow.kinds.correlation import Correlation
from dicflow.kinds.points import Points
from dicflow.pipeline import Pipeline, Result
from dicflow.tuning.caliper import Agreement, caliper_agreement
from dicflow.tuning.candidates import Region, candidates
from dicflow.tuning.choice import Choice, Wish, choose, strain_text
from dicflow.tuning.expected import expected_cpu_s
from dicflow.tuning.stages import Tuned, reduced, tuned_stages
from dicflow.tuning.steps import ChosenSteps, Run, choose_steps
from dicflow.tuning.trials import Trial, trials

__all__ = ["Begun", "Tuning", "tune"]


class Begun(NamedTuple):
    """What is about to be done. settings : number that is tried; cpu_s : processor time that this will take [s]"""

    steps: ChosenSteps
    settings: int
    cpu_s: float


class Tuning(NamedTuple):
    """What came of a sweep.

    tried : all settings that lose few points
    present : that of the file; None if it loses points
    left_out : number of settings that lose points
    warnings : whole sentences
    caliper : how the present and the recommended setting agree with it; None without one
    """

    tuned: Tuned
    steps: ChosenSteps
    tried: list[Trial]
    present: Trial | None
    left_out: int
    choice: Choice
    warnings: list[str]
    caliper: Agreement | None


def tune(pipeline: Pipeline, wish: Wish, run: Run, begin: Callable[[Begun], None]) -> Tuning:
    """Try settings around those of a pipeline's file.

    run : measures a pipeline; every product goes to the store of the file
    begin : is called before the sweep starts
    Raises ConfigurationError for a pipeline or wish that cannot be met, StageError if the photographs cannot.
    """
    tuned = tuned_stages(pipeline)
    if wish.unit == "mm" and not tuned.in_space:
        raise ConfigurationError("--resolve in mm needs two cameras; one camera measures in px, such as '40 px'")
    steps = choose_steps(pipeline, tuned, run)
    present = reduced(pipeline, tuned, [tuned.present], steps.names)
    measured = run(present)
    settings = candidates(tuned.present, _region(measured, tuned, steps))
    sweep = reduced(pipeline, tuned, settings, steps.names)
    begin(Begun(steps, len(settings), expected_cpu_s(present, sweep, tuned, settings)))
    swept = run(sweep)
    tried = trials(swept, tuned, settings, steps)
    own = next((trial for trial in tried if trial.setting == tuned.present), None)
    choice = choose(tried, wish)
    warnings = [*(measured.outcome.warnings if measured.outcome else ()), *_warnings(tried, own, steps, choice, wish)]
    marked = {"present": own, "recommended": choice.trial}
    places = {name: settings.index(trial.setting) for name, trial in marked.items() if trial is not None}
    agreement = caliper_agreement(pipeline, tuned, swept, steps, places)
    return Tuning(tuned, steps, tried, own, len(settings) - len(tried), choice, warnings, agreement)


def _region(result: Result, tuned: Tuned, steps: ChosenSteps) -> Region:
    """Speckles and size of what is measured."""
    product = result.product(tuned.correlation, steps.first)
    pattern = Correlation.read(product).pattern
    speckle = None if pattern is None else pattern["size_px"]
    if speckle is None or not math.isfinite(speckle):
        raise StageError("the size of the speckles is unknown, by which subsets are chosen; look at the photographs")
    return Region(speckle, tuned.present.step_size * math.sqrt(Points.read(product).points_in_region))


def _warnings(
    tried: Sequence[Trial], present: Trial | None, steps: ChosenSteps, choice: Choice, wish: Wish
) -> Iterator[str]:
    if present is None:
        yield "the present setting loses points that others find, so it is not among those compared"
    best = choice.trial
    if best is None:
        return
    if steps.still is None:
        yield (
            "no step at rest is known, so the noise is predicted from the photographs; a second photograph of the "
            "unloaded specimen would measure it"
        )
    if best.bias > 2.0 * best.noise:
        least = min(tried, key=lambda one: one.error)
        yield (
            f"this gauge blurs the strains by {strain_text(best.bias)}, more than its noise; one of {least.gauge.size} "
            f"has an error of {strain_text(least.error)} in all"
        )
    if wish == Wish() and best.gauge.side_px >= max(one.gauge.side_px for one in tried):
        yield (
            "no gauge blurs these strains, so the largest one wins; use --resolve for the size of what you must see "
            "in other tests"
        )
