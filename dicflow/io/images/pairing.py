"""Partners among the photographs of two cameras, found from their names alone.

Several **readings** of the names are tried: equal stems, what is left of them without their common beginning and end,
the numbers in them, single ones of these numbers, and times. A reading gives each name a key, and equal keys (of times:
near ones) make partners. The reading with the most partners decides.
"""

from __future__ import annotations

import os
import re
from bisect import bisect
from collections.abc import Hashable, Iterator, Mapping, Sequence
from datetime import UTC, datetime
from itertools import chain, pairwise
from typing import Literal, NamedTuple

from dicflow.errors import InputError

__all__ = ["Pairing", "Unpaired", "Way", "counter_offset", "natural_key", "pair_names"]

Way = Literal["name", "time", "order"]
"""What makes partners: equal names or numbers in them, the nearest times in the names, or the order."""
Unpaired = Literal["refuse", "skip"]
"""What becomes of photographs without a partner."""

_FARTHEST = 0.25
"""Greatest lag between partners, as a share of the shortest interval between two photographs of one camera: no
photograph has two candidates then."""
_NEAR, _STEADY = 0.05, 0.02
"""Greatest lag, and greatest variation of it, where nobody has said that the times are to decide. Where many
photographs are missing, the nearest times are not those of partners, and the lag is great or varies."""
_NEAR_S, _STEADY_S, _RESOLUTION_S = 10.0, 3.0, 1.0
"""The same of dates, at most [s]; their seconds vary by one at least."""
_LEAST_TICKS = 100
"""A number is a time if it grows by at least this from each photograph to the next: a frame number does not."""
_SHARE_OF_PARTNERS = 0.5
"""With a smaller share of partners, agreement between two sets of names may be chance."""
_NAMED = 5
_DATE_TIME = re.compile(
    r"(?<!\d)((?:19|20)\d\d)([-_.]?)([01]\d)\2([0-3]\d)[-_.T ]*"
    r"([0-2]\d)([-_.:]?)([0-5]\d)\6([0-5]\d)(?:[.,]?(\d{1,6})|[-_](\d{3}))?(?!\d)"
)
"""Date and time of day, as in 20260301_101502 and 2026-03-01T10.15.02.250."""

_Column = tuple[int, ...]
"""The numbers at one place of all names."""
_Match = Mapping[str, str]
"""Left name → right name."""


class Pairing(NamedTuple):
    """Partners among two lists of names.

    pairs : (left, right) names in the order of the left ones
    by : what decided
    alone : names without a partner, each after ``left`` or ``right``
    """

    pairs: tuple[tuple[str, str], ...]
    by: Way
    alone: tuple[str, ...] = ()


def natural_key(name: str) -> tuple[tuple[int, int | str], ...]:
    """Sort key that reads runs of digits as numbers: a2 before a10.

    >>> sorted(["a10", "a2"], key=natural_key)
    ['a2', 'a10']
    """
    parts = re.findall(r"[0-9]+|[^0-9]+", name)
    return tuple((0, int(part)) if part.isdecimal() else (1, part.lower()) for part in parts)


def pair_names(
    left: Sequence[str],
    right: Sequence[str],
    by: Way | None = None,
    unpaired: Unpaired = "refuse",
    listed: bool = False,
) -> Pairing:
    """Pair the photographs of two cameras by their names.

    by : what decides; if None, the numbers and words in the names, else the times in them. The order decides by itself
        only where the names agree in nothing and have no numbers, or were listed
    unpaired : whether photographs without a partner are refused or left out
    listed : whether people wrote the names down in their order

    So ``cam0_step07`` finds ``cam1_step07``, and ``frame_003_t10350`` finds ``frame_003_t10366``. Raises InputError
    that names the photographs without a partner, or that says which readings of the names contradict one another.
    """
    named = {} if by in ("time", "order") else _by_name(left, right)
    if by == "order" or (by is None and not named and (listed or not _have_numbers([*left, *right]))):
        return _in_order(left, right)
    timed = {} if by == "name" else _by_time(left, right, asked=by == "time")
    if by is None and (jump := _first_jump(left, right, named)):
        raise InputError(
            f"the numbers and the times in the names of the photographs disagree from {jump[0]} and {jump[1]} on; "
            "a photograph is missing before them: find it, or set pair_by: name, time or order"
        )
    match = max(named, timed, key=len)
    alone = _alone(left, right, match)
    if alone and (unpaired == "refuse" or len(match) < _SHARE_OF_PARTNERS * max(len(left), len(right))):
        raise InputError(_without_partners(left, right, match, alone))
    return Pairing(
        tuple((name, match[name]) for name in left if name in match), "name" if match is named else "time", alone
    )


def counter_offset(left: Sequence[str], right: Sequence[str]) -> int | None:
    """By how much the right camera counts ahead, where the names pair by order so; None where they do not."""
    columns, others = _varying_numbers(left), _varying_numbers(right)
    if len(left) != len(right) or len(columns) != len(others):
        return None
    for column, other in zip(columns, others, strict=True):
        offsets = {b - a for a, b in zip(column, other, strict=True)}
        if len(offsets) == 1:
            return offsets.pop()
    return None


def _in_order(left: Sequence[str], right: Sequence[str]) -> Pairing:
    if len(left) != len(right):
        raise InputError(
            f"{len(left)} left and {len(right)} right photographs cannot be paired by their order; "
            "add the missing ones or move the others away"
        )
    return Pairing(tuple(zip(left, right, strict=True)), "order")


def _by_name(left: Sequence[str], right: Sequence[str]) -> _Match:
    """The partners of the reading with the most of them. Raises InputError where two readings are equally good."""
    if len(left) == len(right) == 1:
        return {left[0]: right[0]}
    found = [match for reading in _readings(left, right) if (match := _equal(left, right, *reading))]
    best = max(found, key=len, default={})
    for other in found:
        for name in best if len(other) == len(best) else ():
            if other.get(name, best[name]) != best[name]:
                raise InputError(
                    f"by one number in its name left {name} belongs to right {best[name]}, by another to right "
                    f"{other[name]}; rename the photographs, or set pair_by: time or order"
                )
    return best


_Keys = Sequence[Hashable]


def _readings(left: Sequence[str], right: Sequence[str]) -> Iterator[tuple[_Keys, _Keys]]:
    """Keys of the left and of the right names by every reading."""
    yield _stems(left), _stems(right)
    yield _without_affixes(left), _without_affixes(right)
    columns, others = _varying_numbers(left), _varying_numbers(right)
    if columns and len(columns) == len(others):
        yield list(zip(*columns, strict=True)), list(zip(*others, strict=True))
        yield from zip(columns, others, strict=True)


def _equal(left: Sequence[str], right: Sequence[str], keys: _Keys, others: _Keys) -> _Match:
    """Partners with equal keys; none if a key is not unique within its side."""
    if len(set(keys)) < len(left) or len(set(others)) < len(right):
        return {}
    partners = dict(zip(others, right, strict=True))
    return {name: partners[key] for name, key in zip(left, keys, strict=True) if key in partners}


def _stems(names: Sequence[str]) -> list[str]:
    return [os.path.splitext(name)[0] for name in names]


def _without_affixes(names: Sequence[str]) -> list[str]:
    """The stems without what all begin and end with; no number is cut in two."""
    stems = _stems(names)
    begin = _common_start(stems)
    stems = [stem[len(begin) :].casefold() for stem in stems]
    end = _common_start([stem[::-1] for stem in stems])
    return [stem[: len(stem) - len(end)] for stem in stems]


def _common_start(texts: Sequence[str]) -> str:
    """What all texts begin with, up to the last character that is no digit."""
    first, last = min(texts, default=""), max(texts, default="")
    length = next((k for k, (a, b) in enumerate(zip(first, last, strict=False)) if a != b), min(len(first), len(last)))
    return re.sub(r"[0-9]+$", "", first[:length])


def _numbers(name: str) -> list[int]:
    """Numbers in a name beside its date and time."""
    return [int(digits) for digits in re.findall(r"[0-9]+", _DATE_TIME.sub(" ", os.path.splitext(name)[0]))]


def _have_numbers(names: Sequence[str]) -> bool:
    return any(re.search(r"[0-9]", stem) for stem in _stems(names))


def _varying_numbers(names: Sequence[str]) -> list[_Column]:
    """Columns of the numbers that differ among the names; none if the names do not have one form."""
    rows = [_numbers(name) for name in names]
    if len({len(row) for row in rows}) != 1:
        return []
    return [column for column in zip(*rows, strict=True) if len(set(column)) > 1]


# times


class _Times(NamedTuple):
    """Times of the left and of the right names, the greatest lag between partners, and how much it may vary."""

    left: Sequence[float]
    right: Sequence[float]
    near: float
    unsteady: float


def _by_time(left: Sequence[str], right: Sequence[str], asked: bool) -> _Match:
    """Partners by the nearest times. asked : whether the times decide, even where names have other numbers"""
    columns, others = _varying_numbers(left), _varying_numbers(right)
    dated = list(_dates(left, right))
    if asked:
        times = dated + list(_ticks(columns, others, _LEAST_TICKS)) or list(_ticks(columns, others, 0))
        near = [_FARTHEST * min(_interval(one.left), _interval(one.right)) for one in times]
        times = [one._replace(near=lag, unsteady=2 * lag) for one, lag in zip(times, near, strict=True)]
    elif len(columns) + len(dated) > 1:  # one of them is a frame number
        return {}
    else:
        times = dated + list(_ticks(columns, others, _LEAST_TICKS))
    return max((_nearest(left, right, one) for one in times), key=len, default={})


def _dates(left: Sequence[str], right: Sequence[str]) -> Iterator[_Times]:
    """Dates with time of day in the names [s], if all have one."""
    times, others = ([time for name in side if (time := _date_time(name)) is not None] for side in (left, right))
    if len(times) == len(left) and len(others) == len(right):
        interval = min(_interval(times), _interval(others))
        steady = max(_RESOLUTION_S, min(_STEADY * interval, _STEADY_S))
        yield _Times(times, others, min(_FARTHEST * interval, _NEAR_S), steady)


def _ticks(columns: Sequence[_Column], others: Sequence[_Column], least: int) -> Iterator[_Times]:
    """Numbers in the names that may be times, since they grow by ``least`` or more from each photograph to the next."""
    for ticks in zip(columns, others, strict=True) if len(columns) == len(others) else ():
        interval = min(map(_interval, ticks))
        if interval >= least:
            yield _Times(*ticks, _NEAR * interval, _STEADY * interval)


def _date_time(name: str) -> float | None:
    """Date and time in a name [s]; None if it has none."""
    found = _DATE_TIME.search(name)
    if found is None:
        return None
    digits = "".join(found.group(1, 3, 4, 5, 7, 8))
    try:
        return datetime.strptime(digits, "%Y%m%d%H%M%S").replace(tzinfo=UTC).timestamp() + float(
            f"0.{found[9] or found[10] or 0}"
        )
    except ValueError:
        return None


def _interval(times: Sequence[float]) -> float:
    """Shortest interval between two of the times; infinite for a single one."""
    return min((b - a for a, b in pairwise(sorted(times))), default=float("inf"))


def _nearest(left: Sequence[str], right: Sequence[str], times: _Times) -> _Match:
    """Partners whose times are near; none where the lag between them varies too much."""
    match, lags = {}, []
    partners = sorted(zip(times.right, right, strict=True))
    for name, time in zip(left, times.left, strict=True):
        place = bisect(partners, (time,))
        other, partner = min(partners[max(0, place - 1) : place + 1], key=lambda one: abs(one[0] - time))
        if abs(other - time) <= times.near:
            match[name] = partner
            lags.append(other - time)
    return match if lags and max(lags) - min(lags) <= times.unsteady else {}


def _first_jump(left: Sequence[str], right: Sequence[str], match: _Match) -> tuple[str, str] | None:
    """The first partners since whose predecessors the two cameras counted different numbers of intervals.

    Only where both take photographs at a common rate: all intervals are multiples of one. At any rate also the first
    partners that the two cameras took in another order than those before.
    """
    names = [name for name in left if name in match]
    ticks = _ticks(_varying_numbers(left), _varying_numbers(right), _LEAST_TICKS)
    for times in chain(_dates(left, right), ticks):
        here, there = dict(zip(left, times.left, strict=True)), dict(zip(right, times.right, strict=True))
        for name, later in pairwise(names):
            if (here[later] - here[name]) * (there[match[later]] - there[match[name]]) < 0.0:
                return later, match[later]
        counts = _intervals([here[name] for name in names]), _intervals([there[match[name]] for name in names])
        for name, counted, other in zip(names[1:], *counts, strict=False):
            if counted != other:
                return name, match[name]
    return None


def _intervals(times: Sequence[float]) -> list[int]:
    """How many intervals lie between neighbours; empty if there is no common rate."""
    differences = [b - a for a, b in pairwise(times)]
    unit = min(map(abs, differences), default=0.0)
    counts = [round(difference / unit) if unit else 0 for difference in differences]
    regular = all(abs(d - n * unit) < _FARTHEST * unit for d, n in zip(differences, counts, strict=True))
    return counts if unit and regular else []


# messages


def _alone(left: Sequence[str], right: Sequence[str], match: _Match) -> tuple[str, ...]:
    """The names without a partner, after ``left`` or ``right``, in natural order on each side."""
    partners = set(match.values())
    sides = {
        "left": [name for name in left if name not in match],
        "right": [name for name in right if name not in partners],
    }
    return tuple(f"{side} {name}" for side, names in sides.items() for name in sorted(names, key=natural_key))


def _without_partners(left: Sequence[str], right: Sequence[str], match: _Match, alone: Sequence[str]) -> str:
    """The message that names the photographs without a partner and what can be done."""
    named = ", ".join(alone[:_NAMED]) + (f" and {len(alone) - _NAMED} more" if len(alone) > _NAMED else "")
    ways = ["add the missing ones or move these away"]
    if len(match) >= _SHARE_OF_PARTNERS * max(len(left), len(right)):
        ways.append("set unpaired: skip to leave these steps out")
    offset = counter_offset(left, right)
    if offset is not None or (not match and len(left) == len(right)):
        counters = "" if offset is None else f": their counters are {offset} apart"
        ways.append(f"set pair_by: order if no photograph is missing on either side{counters}")
    return f"{len(left)} left and {len(right)} right photographs; without a partner: {named}; {', or '.join(ways)}"
