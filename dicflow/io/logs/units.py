"""Units as makers of machines write them, and what they are in the units of channels: N, mm, s, °C."""

from __future__ import annotations

import re
from typing import NamedTuple

import numpy as np

__all__ = ["Unit", "in_brackets", "known_units", "unit_named", "without_unit"]

GRAVITY = 9.80665
"""Standard acceleration of free fall [m/s²]: weight of a mass."""


class Unit(NamedTuple):
    """A unit: value in ``name`` = factor · value in it + shift."""

    name: str
    factor: float = 1.0
    shift: float = 0.0

    def convert(self, values: np.ndarray) -> np.ndarray:
        """Values in the unit of channels."""
        return values * self.factor + self.shift


_POUND = 0.45359237
_FORCES = {"n": 1.0, "kn": 1e3, "mn": 1e-3, "dan": 10.0, "lbf": _POUND * GRAVITY, "cn": 0.01, "µn": 1e-6}
_MASSES = {"g": 1e-3, "kg": 1.0, "mg": 1e-6, "lb": _POUND, "gf": 1e-3, "kgf": 1.0, "kp": 1.0}
_LENGTHS = {"mm": 1.0, "µm": 1e-3, "um": 1e-3, "cm": 10.0, "m": 1e3, "in": 25.4, "inch": 25.4, "nm": 1e-6}
_TIMES = {"s": 1.0, "sec": 1.0, "secs": 1.0, "seconds": 1.0, "sek": 1.0, "ms": 1e-3, "min": 60.0, "h": 3600.0}
_RATES = {"mm/s": 1.0, "mm/min": 1.0 / 60.0, "µm/s": 1e-3, "in/min": 25.4 / 60.0}
_STRESSES = {
    "mpa": 1.0,
    "pa": 1e-6,
    "kpa": 1e-3,
    "gpa": 1e3,
    "n/mm²": 1.0,
    "n/mm2": 1.0,
    "bar": 0.1,
    "psi": 6.894757e-3,
}
_NUMBERS = {"1": 1.0, "-": 1.0, "–": 1.0, "%": 0.01, "‰": 1e-3, "mm/mm": 1.0, "µm/m": 1e-6, "µε": 1e-6}
_OTHERS = ("V", "mV", "mV/V", "A", "mA", "Nm", "Hz", "1/s", "Ω", "W", "kN/s", "N/s", "deg", "°", "%RH")
_TEMPERATURES = {
    "°c": Unit("°C"),
    "degc": Unit("°C"),
    "c": Unit("°C"),
    "k": Unit("°C", 1.0, -273.15),
    "°f": Unit("°C", 5.0 / 9.0, -160.0 / 9.0),
    "degf": Unit("°C", 5.0 / 9.0, -160.0 / 9.0),
}
_UNITS: dict[str, Unit] = {
    **{name: Unit("N", factor) for name, factor in _FORCES.items()},
    **{name: Unit("N", factor * GRAVITY) for name, factor in _MASSES.items()},
    **{name: Unit("mm", factor) for name, factor in _LENGTHS.items()},
    **{name: Unit("s", factor) for name, factor in _TIMES.items()},
    **{name: Unit("mm/s", factor) for name, factor in _RATES.items()},
    **{name: Unit("MPa", factor) for name, factor in _STRESSES.items()},
    **{name: Unit("1", factor) for name, factor in _NUMBERS.items()},
    **{name.lower(): Unit(name) for name in _OTHERS},
    **_TEMPERATURES,
}
_BY_CASE = {"MN": Unit("N", 1e6), "mN": Unit("N", 1e-3), "Mpa": Unit("MPa"), "G": Unit("N", 1e-3 * GRAVITY)}
"""Units whose capital letters matter, or that machines write in them."""
_LONGEST = 200
"""Characters of a title that may end in a unit."""
_LETTERS = "NgsmK"
"""Units of one letter that need no brackets."""
_BRACKETS = re.compile(r"(?P<title>[^\[(]*)[\[(](?P<unit>[^\])]{1,12})[\])]\s*")
_BEHIND = re.compile(r"(?P<title>.*?\S)(?:\s*[/,_]\s*|\s+in\s+|\s+)(?P<unit>[^\s/,_]{1,8}(?:/[^\s/,_]{1,4})?)\s*")


def unit_named(text: str) -> Unit | None:
    """The unit of a name; None for an unknown one. Masses are weights, in N.

    >>> unit_named("kN").convert(2.5)
    2500.0
    """
    name = text.strip().strip("[]()").strip().replace("\u03bc", "\u00b5")
    return _BY_CASE.get(name) or _UNITS.get(name.lower())


def known_units() -> str:
    """The usual units, for messages."""
    return "N, kN, g, kg, lbf, mm, µm, in, s, ms, min, °C, K, mm/min, MPa, V, %, 1 (a pure number)"


def in_brackets(title: str) -> str:
    """What stands in brackets behind the title of a column, a unit or not; empty without brackets."""
    match = _BRACKETS.fullmatch(title[:_LONGEST])
    return match["unit"].strip() if match else ""


def without_unit(title: str) -> tuple[str, str]:
    """The title of a column and the unit at its end, which is empty if no known one stands there.

    >>> without_unit("Load [kN]"), without_unit("Weg in mm"), without_unit("Zeit / s"), without_unit("Cycle")
    (('Load', 'kN'), ('Weg', 'mm'), ('Zeit', 's'), ('Cycle', ''))
    """
    for pattern in (_BRACKETS, _BEHIND):
        match = pattern.fullmatch(title) if len(title) <= _LONGEST else None
        if match and unit_named(match["unit"]) and not (pattern is _BEHIND and _may_be_a_name(match["unit"])):
            return match["title"].strip(), match["unit"].strip()
    return title.strip(), ""


def _may_be_a_name(unit: str) -> bool:
    """Whether a word at the end of a title may number it, as in ``Sensor A``."""
    return len(unit) == 1 and unit not in _LETTERS
