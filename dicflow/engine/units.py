"""Quantities as users write them: ``14.5 mm``, ``2 cm``, ``20``."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from typing import Any

__all__ = ["quantity"]

_FACTORS = {
    "mm": {"um": 1e-3, "µm": 1e-3, "mm": 1.0, "cm": 10.0, "m": 1000.0, "in": 25.4},
    "px": {"px": 1.0},
    "s": {"s": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0},
    "deg": {"deg": 1.0, "°": 1.0, "rad": 180.0 / math.pi},
}
_COMMA = re.compile(r"(?<=\d),(?=\d)")
_TEXT = re.compile(r"\s*+([-+]?(?:\d++\.?\d*+|\.\d++)(?:[eE][-+]?\d++)?)\s*+(\S++)\s*+")


def quantity(unit: str) -> Callable[[Any], Any]:
    """A validator that turns text with a unit into a number in ``unit`` and returns other values unchanged.

    unit : "mm", "px", "s" or "deg"
    The function it returns raises ValueError for a unit of another dimension.

    >>> quantity("mm")("2 cm")
    20.0
    """
    factors = _FACTORS[unit]

    def convert(value: Any) -> Any:
        if not isinstance(value, str):
            return value
        match = _TEXT.fullmatch(value)
        if match is None or match[2] not in factors:
            if (point := _COMMA.sub(".", value)) != value and _TEXT.fullmatch(point):
                raise ValueError(f"{value[:60]!r} has a decimal comma; write {point[:60]!r}, with a point")
            raise ValueError(
                f"{value[:60]!r} is not a quantity in {unit}; write a number alone, or with {', '.join(factors)}"
            )
        return round(float(match[1]) * factors[match[2]], 12)

    return convert
