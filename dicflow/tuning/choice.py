"""Which of the tried settings is recommended, and why."""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import NamedTuple

from dicflow.engine.units import quantity
from dicflow.errors import ConfigurationError
from dicflow.tuning.trials import Trial

__all__ = ["Choice", "Wish", "choose", "pareto_front", "strain_text", "wish"]

_EQUAL = 1.03
"""Ratio up to which errors count as equal; among equal ones the setting of fewest points is the fastest."""
_NOISE = re.compile(r"\s*([0-9.]+(?:[eE][-+]?\d+)?)\s*(µε|ue|με|%|)\s*")
_NOISE_UNITS = {"": 1.0, "%": 1e-2, "µε": 1e-6, "με": 1e-6, "ue": 1e-6}


class Wish(NamedTuple):
    """What a user must see; None where that is open.

    side : of the virtual strain gauge, at most, in ``unit``
    unit : mm or px
    noise : standard deviation of a strain, at most [-]
    """

    side: float | None = None
    unit: str = "px"
    noise: float | None = None

    def side_of(self, trial: Trial) -> float:
        """Side of a trial's gauge in the unit of the wish."""
        side = trial.gauge.side_mm if self.unit == "mm" else trial.gauge.side_px
        assert side is not None
        return side


class Choice(NamedTuple):
    """The recommended setting, None where no setting does what is wished; the reason, or what is possible instead."""

    trial: Trial | None
    reason: str


def wish(resolve: str | None, noise: str | None) -> Wish:
    """What the options of the command line say: ``3 mm`` or ``40 px``; ``500e-6``, ``500 µε`` or ``0.05 %``.

    Raises ConfigurationError for another text.
    """
    side, unit = (None, "px") if resolve is None else _length(resolve)
    return Wish(side, unit, None if noise is None else _strain(noise))


def choose(trials: Sequence[Trial], wish: Wish) -> Choice:
    """The best setting for a wish.

    With a gauge given, the setting of least noise in such a gauge; with a noise given, that of the smallest gauge; with
    both or neither, that of the least error, noise and bias together.
    """
    small = [one for one in trials if wish.side is None or wish.side_of(one) <= wish.side]
    if not small:
        return Choice(None, f"no gauge is as small: {_smallest(trials, wish)}")
    fine = [one for one in small if wish.noise is None or one.noise <= wish.noise]
    if not fine:
        return Choice(None, _impossible(trials, small, wish))
    if wish.side is not None and wish.noise is None:
        return Choice(_fastest(fine, [one.noise for one in fine]), "least noise in a gauge of this size")
    if wish.noise is not None and wish.side is None:
        return Choice(_fastest(fine, [wish.side_of(one) for one in fine]), "smallest gauge of this noise")
    return Choice(_fastest(fine, [one.error for one in fine]), "least error, noise and bias together")


def pareto_front(trials: Sequence[Trial]) -> list[Trial]:
    """Trials by rising gauge, without those that another one of the same size or smaller has less noise than."""
    front: list[Trial] = []
    for one in sorted(trials, key=lambda trial: (trial.gauge.side_px, trial.noise)):
        if not front or one.noise < front[-1].noise:
            front.append(one)
    return front


def strain_text(strain: float) -> str:
    """A strain for people: ``180 µε``, ``0.21 %``."""
    return f"{1e6 * strain:.3g} µε" if strain < 1e-3 else f"{100.0 * strain:.3g} %"


def _fastest(trials: Sequence[Trial], costs: Sequence[float]) -> Trial:
    """Of the trials of about the least cost, that of fewest points; of equally many, that of the least error."""
    alike = [one for one, cost in zip(trials, costs, strict=True) if cost <= _EQUAL * min(costs)]
    return min(alike, key=lambda one: (one.points, one.error))


def _smallest(trials: Sequence[Trial], wish: Wish) -> str:
    one = min(trials, key=lambda trial: trial.gauge.side_px)
    return f"the smallest has {one.gauge.size} and a noise of {strain_text(one.noise)}"


def _impossible(trials: Sequence[Trial], small: Sequence[Trial], wish: Wish) -> str:
    """What is possible where no setting has so little noise, in a gauge as small."""
    assert wish.noise is not None
    quiet = [one for one in trials if one.noise <= wish.noise]
    least = min(small, key=lambda one: one.noise)
    asked = strain_text(wish.noise)
    inside = "" if wish.side is None else f" in a gauge of {wish.side:g} {wish.unit}"
    text = f"no setting has a noise of {asked}{inside}: the least is {strain_text(least.noise)}, at {least.gauge.size}"
    if not quiet:
        return text
    larger = min(quiet, key=lambda one: one.gauge.side_px)
    return f"{text}, and {asked} needs {larger.gauge.size}"


def _length(text: str) -> tuple[float, str]:
    for unit in ("mm", "px"):
        try:
            value = quantity(unit)(text)
        except ValueError:
            continue
        if value > 0.0:
            return float(value), unit
    raise ConfigurationError(f"--resolve '{text:.60}': not a length; write it with its unit, such as '3 mm' or '40 px'")


def _strain(text: str) -> float:
    match = _NOISE.fullmatch(text)
    try:
        value = float(match[1]) * _NOISE_UNITS[match[2]] if match else 0.0
    except ValueError:
        value = 0.0
    if not 0.0 < value < 1.0:
        raise ConfigurationError(f"--noise '{text:.60}': not a strain; write one such as 500e-6, '500 µε' or '0.05 %'")
    return value
