"""Partners among the photographs of two cameras, by the times when they were taken.

The clocks of two cameras disagree, by seconds or by hours, but hardly change within a test. So the intervals between
photographs are alike on both sides, and one difference of the clocks makes most partners, and those that agree best.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from statistics import median
from typing import NamedTuple

__all__ = ["Ambiguous", "Clocks", "partners_by_time"]

_FARTHEST = 0.25
"""Greatest lag between partners, as a share of the shortest interval between two photographs of one camera."""
_AS_GOOD = 0.5
"""Another difference of the clocks is as good if its partners count for so many less."""
_SHARE_OF_PARTNERS = 0.5
"""With a smaller share of partners the times agree by chance."""
_MOST_STEADY_S = 1.0
"""Clocks that differ by less are taken for equal: EXIF gives whole seconds."""


class Ambiguous(Exception):
    """Several differences of the clocks make as many partners: the photographs were taken at equal intervals."""


class Clocks(NamedTuple):
    """Partners by time.

    ahead_s : what the right camera's clock shows more than the left one's [s]
    pairs : numbers of the left and the right photograph, in the order of time
    """

    ahead_s: float
    pairs: tuple[tuple[int, int], ...]


def partners_by_time(left_s: Sequence[float], right_s: Sequence[float]) -> Clocks | None:
    """The partners of two series of times [s]; None if less than half of either side has one.

    Raises Ambiguous if the intervals are so equal that another difference of the clocks fits as well.

    >>> partners_by_time([0, 10, 25, 31], [3604, 3610, 3619, 3635, 3641]).pairs
    ((0, 1), (1, 2), (2, 3), (3, 4))
    """
    reach = _FARTHEST * min(_shortest(left_s), _shortest(right_s))
    if not reach > 0.0:
        return None
    found = [_refined(left_s, right_s, ahead, reach) for ahead in _differences(left_s, right_s, reach)]
    scores = {one.pairs: _score(left_s, right_s, one, reach) for one in found}
    best = {one.pairs: one for one in found if scores[one.pairs] >= max(scores.values()) - _AS_GOOD}
    most = max(map(len, best))
    if len(best) > 1:
        best = {pairs: one for pairs, one in best.items() if abs(one.ahead_s) <= max(reach, _MOST_STEADY_S)}
    if most < 2 or most < _SHARE_OF_PARTNERS * max(len(left_s), len(right_s)):
        return None
    if len(best) != 1:
        raise Ambiguous
    return next(iter(best.values()))


def _score(left_s: Sequence[float], right_s: Sequence[float], clocks: Clocks, reach: float) -> float:
    """Number of the partners, each of which counts the less the farther apart it is."""
    return sum(1.0 - ((right_s[j] - left_s[i] - clocks.ahead_s) / reach) ** 2 for i, j in clocks.pairs)


def _shortest(times: Sequence[float]) -> float:
    """Shortest interval between two of the times; 0 for two equal ones, or for less than two."""
    return min((b - a for a, b in pairwise(sorted(times))), default=0.0)


def _differences(left_s: Sequence[float], right_s: Sequence[float], reach: float) -> Iterator[float]:
    """Every difference of the clocks that makes partners of some two photographs, of near ones the first."""
    last = None
    for ahead in sorted(b - a for a in left_s for b in right_s):
        if last is None or ahead - last > 0.5 * reach:
            last = ahead
            yield ahead


def _refined(left_s: Sequence[float], right_s: Sequence[float], ahead_s: float, reach: float) -> Clocks:
    """The partners at a difference of the clocks, which is then the median of theirs."""
    for _ in range(2):
        pairs = tuple(_near(left_s, right_s, ahead_s, reach))
        ahead_s = median(right_s[j] - left_s[i] for i, j in pairs) if pairs else ahead_s
    return Clocks(ahead_s, tuple(_near(left_s, right_s, ahead_s, reach)))


def _near(left_s: Sequence[float], right_s: Sequence[float], ahead_s: float, reach: float) -> Iterator[tuple[int, int]]:
    """Numbers of those that lie within a reach of one another, once the clocks are equal."""
    others = sorted(range(len(right_s)), key=right_s.__getitem__)
    at = 0
    for i in sorted(range(len(left_s)), key=left_s.__getitem__):
        while at < len(others) and right_s[others[at]] - ahead_s < left_s[i] - reach:
            at += 1
        if at < len(others) and abs(right_s[others[at]] - ahead_s - left_s[i]) <= reach:
            yield i, others[at]
            at += 1
