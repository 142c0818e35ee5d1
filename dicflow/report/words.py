"""Numbers and times as text."""

from __future__ import annotations

import math
import time

__all__ = ["date", "duration", "least_percent", "number", "percent"]


def number(value: float | None, digits: int = 4) -> str:
    """A number with so many significant digits, whole numbers in full; a dash if unknown."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0 or abs(value) >= 10**digits:
        return f"{value:.0f}"
    if abs(value) < 1e-3:
        mantissa, _sign, power = f"{value:.{max(0, digits - 2)}e}".partition("e")
        return f"{mantissa}·10{str(int(power)).translate(_RAISED)}".replace("-", "−")
    places = max(0, digits - 1 - math.floor(math.log10(abs(value))))
    return f"{value:.{places}f}".replace("-", "−")


def percent(share: float | None) -> str:
    """A share of one in percent."""
    return "–" if share is None or not math.isfinite(share) else f"{100.0 * share:.1f} %".replace("-", "−")


def least_percent(share: float | None) -> str:
    """A share of one in percent, rounded downwards, so that 100 % are all."""
    return percent(share if share is None or not math.isfinite(share) else math.floor(1000.0 * share + 1e-6) / 1000.0)


def duration(seconds: float) -> str:
    """A time in s, min or h, whichever reads best."""
    if seconds < 100:
        return f"{seconds:.1f} s"
    return f"{seconds / 60:.1f} min" if seconds < 5400 else f"{seconds / 3600:.1f} h"


def date(seconds: float) -> str:
    """A moment [s since 1970] as date and time, in UTC: a report travels."""
    return time.strftime("%Y-%m-%d %H:%M UTC", time.gmtime(seconds))


_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
