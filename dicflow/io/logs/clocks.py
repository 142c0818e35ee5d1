"""Times of logs: dates, times of day, both in one cell or in two columns, in seconds."""

from __future__ import annotations

import datetime
import re
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

__all__ = ["Clock", "is_clock", "is_date", "read_clocks", "read_dates"]

_DAY_S = 86_400.0
_DATE = r"(?P<a>\d{1,4})(?P<mark>[-./])(?P<b>\d{1,2})(?P=mark)(?P<c>\d{1,4})"
_TIME = r"(?P<h>\d{1,3}):(?P<m>\d{2})(?::(?P<s>\d{2})(?:[.,:](?P<f>\d{1,9}))?)?\s*(?P<half>[AaPp]\.?[Mm]\.?)?"
_ZONE = r"\s*(?:(?P<zone>Z|UTC)|(?P<sign>[+-])(?P<zh>\d{2}):?(?P<zm>\d{2}))?"
_DATES = re.compile(_DATE, re.ASCII)
_CLOCKS = re.compile(rf"(?:{_DATE}(?:[T_,;]\s*|\s+))?{_TIME}{_ZONE}", re.ASCII)
_ORDERS = ("dmy", "mdy")
_YEARS = range(1970, 2100)


class Clock(NamedTuple):
    """Times of all rows.

    seconds : (row,) — since 1970 by the log's own clock, since midnight, or since a start; NaN for an empty cell
    has_date : whether they count from 1970
    of_day : whether they count from midnight
    utc : (row,) — the same in UTC; None unless all rows say how far their clock is from it
    """

    seconds: np.ndarray
    has_date: bool
    of_day: bool = False
    utc: np.ndarray | None = None


def is_clock(cell: str) -> bool:
    """Whether a cell holds a time of day, with a date or without."""
    return ":" in cell and _CLOCKS.fullmatch(cell.strip()) is not None


def is_date(cell: str) -> bool:
    """Whether a cell holds a date alone."""
    match = _DATES.fullmatch(cell.strip())
    return match is not None and any(_day(match, order) is not None for order in _ORDERS)


def read_clocks(cells: Sequence[str], dates: Sequence[str] | None = None) -> Clock:
    """Times of cells of which each is empty or fulfils :func:`is_clock`.

    dates : cells of another column, with the dates
    A time without a date that is hours earlier than the one before it belongs to the next day.
    """
    matches = [_CLOCKS.fullmatch(cell.strip()) for cell in cells]
    seconds = np.array([np.nan if match is None else _seconds(match) for match in matches])
    days = read_dates([match if match is None or match["a"] else None for match in matches])
    if days is None and dates is not None:
        days = read_dates([_DATES.fullmatch(cell.strip()) for cell in dates])
    if days is None:
        return Clock(seconds + _DAY_S * _midnights(seconds), False, True)
    zones = np.array([0.0 if match is None else _utc_offset(match) for match in matches])
    seconds = seconds + _DAY_S * days
    return Clock(seconds, True, utc=seconds - zones if np.isfinite(zones).all() else None)


def read_dates(matches: Sequence[re.Match[str] | None]) -> np.ndarray | None:
    """Days (row,) since 1970; None without dates, or if the day may be the month.

    ``03/05/2026`` may be in March or in May. If all dates are one such date, nothing tells; of several, the order in
    which they span fewer days is the right one.
    """
    known = [match for match in matches if match is not None]
    if not known:
        return None
    found = {}
    for order in _ORDERS:
        days = {match[0]: _day(match, order) for match in known}
        if None not in days.values():
            found[order] = np.array([np.nan if match is None else days[match[0]] for match in matches], dtype=float)
    if not found:
        return None
    spans = {order: float(np.nanmax(days) - np.nanmin(days)) for order, days in found.items()}
    best = min(spans, key=lambda order: spans[order])
    alike = [order for order, span in spans.items() if span == spans[best]]
    equal = all(np.array_equal(found[order], found[best], equal_nan=True) for order in alike)
    return found[best] if equal else None


def _seconds(match: re.Match[str]) -> float:
    hour = int(match["h"])
    if match["half"]:
        hour = hour % 12 + (12 if match["half"].lower().startswith("p") else 0)
    return 3600.0 * hour + 60.0 * int(match["m"]) + float(f"{match['s'] or 0}.{match['f'] or 0}")


def _utc_offset(match: re.Match[str]) -> float:
    """What a clock shows more than UTC [s]; NaN if it does not say it."""
    if match["zone"]:
        return 0.0
    if not match["sign"]:
        return np.nan
    return (-1.0 if match["sign"] == "-" else 1.0) * (3600.0 * int(match["zh"]) + 60.0 * int(match["zm"]))


def _day(match: re.Match[str], order: str) -> int | None:
    """Day since 1970 of a date; None if there is no such day."""
    a, b, c = (int(match[name]) for name in "abc")
    if match["mark"] == "." and order == "mdy":
        return None
    if len(match["a"]) > 2:
        year, month, day = a, b, c
    else:
        year = c if c > 99 else 2000 + c
        day, month = (a, b) if order == "dmy" else (b, a)
    if year not in _YEARS:
        return None
    try:
        return datetime.date(year, month, day).toordinal() - _EPOCH
    except ValueError:
        return None


_EPOCH = datetime.date(1970, 1, 1).toordinal()


def _midnights(seconds: np.ndarray) -> np.ndarray:
    """How many midnights lie before each row (row,)."""
    known = np.isfinite(seconds)
    steps = np.diff(seconds[known], prepend=seconds[known][:1])
    passed = np.zeros(len(seconds))
    passed[known] = np.cumsum(steps < -_DAY_S / 2)
    return passed
