"""Round numbers along an axis, and their texts."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import NamedTuple

__all__ = ["Ticks", "ticks_that_fit"]

_MOST_DISTANCES = 9
_PLAIN_POWERS = range(-3, 5)
"""Powers of ten of the largest number up to which numbers are written in full."""
_ROUNDING = 1e-9
_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


class Ticks(NamedTuple):
    """Numbers along an axis.

    shares : where they stand, from 0 at the low to 1 at the high end
    texts : of the numbers, divided by the factor
    factor : as "×10⁻⁵"; empty for one
    """

    shares: tuple[float, ...]
    texts: tuple[str, ...]
    factor: str = ""


def ticks_that_fit(low: float, high: float, fits: Callable[[float, Sequence[str]], bool]) -> Ticks:
    """The closest round numbers between two values, ten at most, whose texts have room.

    fits : from the distance of two numbers as a share of the axis, and the texts
    """
    for step in _round_steps((high - low) / _MOST_DISTANCES):
        found = _ticks(low, high, step)
        if fits(step / (high - low), found.texts) or len(found.texts) < 2:
            break
    return found


def _round_steps(least: float) -> Iterator[float]:
    """1, 2 and 5 times the powers of ten, upwards from a least value."""
    first = math.floor(math.log10(least) + _ROUNDING)
    for power in count(first):
        yield from (step for factor in (1, 2, 5) if (step := factor * 10.0**power) >= least * (1 - _ROUNDING))


def _ticks(low: float, high: float, step: float) -> Ticks:
    """All multiples of a round step between two values."""
    largest = max(abs(low), abs(high))
    power = math.floor(math.log10(largest) + _ROUNDING)
    power = 0 if power in _PLAIN_POWERS else power
    digits = max(0, power - math.floor(math.log10(step) + _ROUNDING))
    multiples = range(math.ceil(low / step - _ROUNDING), math.floor(high / step + _ROUNDING) + 1)
    shares = tuple((k * step - low) / (high - low) for k in multiples)
    texts = tuple(f"{k * step / 10.0**power:.{digits}f}".replace("-", "−") for k in multiples)
    return Ticks(shares, texts, f"×10{str(power).translate(_RAISED)}" if power else "")
