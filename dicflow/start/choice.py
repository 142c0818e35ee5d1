"""Which series are measured: what the user named, what the names say, or a question."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import permutations, product
from pathlib import PurePosixPath
from typing import Literal, NamedTuple

from dicflow.io.images.search import fits
from dicflow.start.cameras import Evidence, Pair, pairs_of
from dicflow.start.layouts import Series, are_numbers, is_serial
from dicflow.start.words import LEFT_RIGHT

__all__ = ["By", "Candidate", "Choice", "Undecided", "decide", "is_named"]

_NEARLY = 0.8
_NOT_SHORT = 0.5
"""Least length, over that of the longest, of a series that may be the other camera's where names do not say so."""
_MAX_CANDIDATES = 4
_MIN_BOARDS = 3
"""Photographs of boards that two cameras need, and one has no use for."""
_SORT = "two cameras: move the photographs of each into a folder of its own, named left and right, and start again"


By = Literal["name", "taken", "order"]
"""What makes pairs: names, the times when the photographs were taken, or their order."""


class Choice(NamedTuple):
    """What the user names: folders or patterns, below the folder of the photographs.

    left, right : photographs of each camera
    boards : photographs of boards, of any camera
    one_camera : measure in the plane, with one camera
    pair_by, pair_boards_by : what pairs the photographs of two cameras, of the specimen and of boards; None lets names,
        times and counters decide
    """

    left: tuple[str, ...] = ()
    right: tuple[str, ...] = ()
    boards: tuple[str, ...] = ()
    one_camera: bool = False
    pair_by: By | None = None
    pair_boards_by: By | None = None


class Candidate(NamedTuple):
    """Series that may be measured.

    left, right : of the specimen; right is None for one camera
    boards : of both cameras; None for one camera, or where a file holds the rig
    """

    left: Series
    right: Series | None = None
    boards: Pair | None = None


class Undecided(Exception):
    """Names and photographs leave more than one candidate; the most likely is the first.

    otherwise : what to do where none of the candidates is right; empty where that is not known
    """

    def __init__(self, reason: str, candidates: Sequence[Candidate], otherwise: str = "") -> None:
        super().__init__(reason)
        self.reason = reason
        self.candidates = candidates[:_MAX_CANDIDATES]
        self.otherwise = otherwise


def is_named(path: PurePosixPath, patterns: Sequence[str]) -> bool:
    """Whether a pattern names a photograph or a folder above it.

    >>> is_named(PurePosixPath("a [1]/left/b.png"), ["a [[]1]/l*"]), is_named(PurePosixPath("a [1]/b.png"), ["a [1]"])
    (True, True)
    """
    return any(_matches(path.parts, PurePosixPath(pattern).parts) for pattern in patterns)


def _matches(parts: Sequence[str], pattern: Sequence[str]) -> bool:
    """Whether each part of a pattern is that of the path or matches it."""
    return len(pattern) <= len(parts) and all(map(fits, parts, pattern))


def decide(
    specimen: Sequence[Series], boards: Sequence[Series], choice: Choice, has_calibration: bool = False
) -> Candidate:
    """The series to measure.

    has_calibration : whether a file holds the rig, so that no boards are needed
    Raises Undecided if others are as likely.
    """
    if choice.one_camera:
        return _one_camera(specimen, choice)
    pairs = _pairs(specimen, choice)
    longest = _longest_pairs(pairs)
    if not longest:
        return _without_pair(specimen, boards, choice, has_calibration)
    if has_calibration and not boards and len(longest) == 1 and longest[0].evidence > Evidence.NUMBER:
        return Candidate(longest[0].left, longest[0].right)
    rigs = [(pair, rig) for pair in longest for rig in _boards(pair, boards, choice)]
    candidates = [Candidate(pair.left, pair.right, rig) for pair, rig in rigs]
    if len(candidates) == 1 and _is_sure(*rigs[0]):
        return candidates[0]
    candidates = candidates or [Candidate(pair.left, pair.right) for pair in longest]
    raise Undecided(_reason(longest, rigs, boards, has_calibration), [*candidates, *map(Candidate, _alike(specimen))])


def _one_camera(specimen: Sequence[Series], choice: Choice) -> Candidate:
    alike = _alike([one for one in specimen if not choice.left or is_named(one.files[0], choice.left)])
    if len(alike) != 1:
        raise Undecided(_alike_reason(alike), [Candidate(one) for one in alike])
    return Candidate(alike[0])


def _without_pair(
    specimen: Sequence[Series], boards: Sequence[Series], choice: Choice, has_calibration: bool
) -> Candidate:
    """The only series, if nothing speaks for a second camera."""
    alike = _alike(specimen)
    if len(alike) > 1:
        raise Undecided(_alike_reason(alike), [*_any_two(alike, boards, choice), *map(Candidate, alike)])
    of_boards = sum(len(one.files) for one in boards)
    if of_boards < _MIN_BOARDS and not has_calibration:
        return Candidate(alike[0])
    if _longest_pairs(_pairs(boards, choice)):
        reason = "boards of two cameras, but one series of the specimen"
    else:
        of = f"{of_boards} photographs of a board" if of_boards else "a file with the calibration of two cameras"
        reason = f"{of}, but one series of the specimen ({len(alike[0].files)} photographs)"
        reason += ", and nothing tells whether one camera or two took it"
    raise Undecided(reason, [Candidate(alike[0])], _SORT)


def _any_two(specimen: Sequence[Series], boards: Sequence[Series], choice: Choice) -> list[Candidate]:
    """Any two series as two cameras, with the boards that suit best; none again with left and right exchanged."""
    found: list[Candidate] = []
    for one, other in permutations(specimen, 2):
        rigs: list[Pair | None] = [*_boards(Pair(one, other, Evidence.NOTHING), boards, choice)]
        for rig in rigs or [None]:
            mirrored = Candidate(other, one, rig and rig._replace(left=rig.right, right=rig.left))
            if mirrored not in found:
                found.append(Candidate(one, other, rig))
    return found


def _alike_reason(alike: Sequence[Series]) -> str:
    counts = ", ".join(str(len(one.files)) for one in alike)
    return f"{len(alike)} series of the specimen look alike ({counts} photographs)"


def _alike(series: Sequence[Series]) -> list[Series]:
    """The series that are not much shorter than the longest."""
    most = max((len(one.files) for one in series), default=0)
    return [one for one in series if len(one.files) >= _NOT_SHORT * most]


def _pairs(series: Sequence[Series], choice: Choice) -> list[Pair]:
    """Pairs by what the user named, else by their names."""
    by_name = pairs_of(series)
    if not (choice.left or choice.right):
        return by_name
    lefts = [one for one in series if is_named(one.files[0], choice.left)]
    rights = [one for one in series if is_named(one.files[0], choice.right)]
    if not lefts and not rights:
        return by_name
    named = {frozenset((pair.left, pair.right)) for pair in by_name}
    free = [one for one in series if one not in (*lefts, *rights)]
    chosen = [Pair(a, b, Evidence.USER) for a, b in product(lefts or free, rights or free) if a != b]
    return [pair for pair in chosen if {pair.left, pair.right} in named] or chosen


def _longest_pairs(pairs: Sequence[Pair]) -> list[Pair]:
    """The surest pairs, of these the longest and those nearly as long."""
    alike = [pair for pair in pairs if _steps(pair) >= _least_share(pair) * _most(pair)]
    tests = [pair for pair in alike if _steps(pair) > 1] or alike
    surest = [pair for pair in tests if pair.evidence == max(one.evidence for one in tests)]
    return [pair for pair in surest if _steps(pair) >= _NEARLY * max(map(_steps, surest))]


def _least_share(pair: Pair) -> float:
    """Least length of one series of a pair, as a share of the other; the less, the surer the cameras are."""
    if pair.evidence >= Evidence.SIDE:
        return 0.0
    is_known = pair.left.camera and pair.right.camera
    return _NOT_SHORT if is_known or pair.evidence == Evidence.NOTHING else _NEARLY


def _steps(pair: Pair) -> int:
    return min(len(pair.left.files), len(pair.right.files))


def _most(pair: Pair) -> int:
    return max(len(pair.left.files), len(pair.right.files))


def _boards(photos: Pair, boards: Sequence[Series], choice: Choice) -> list[Pair]:
    """The pairs of boards that suit a pair of the specimen: of the same cameras, and nearest in their names."""
    pairs = _pairs(boards, choice)
    suitable = [pair for pair in pairs if _same_cameras(photos, pair)] or pairs
    suitable = suitable or [Pair(one, other, Evidence.NOTHING) for one, other in permutations(_alike(boards), 2)]
    near = [pair for pair in suitable if _nearness(photos, pair) == max(_nearness(photos, one) for one in suitable)]
    return _longest_pairs(near)


def _nearness(photos: Pair, boards: Pair) -> int:
    """Number of words that the names of two pairs share."""
    return len((photos.left.words & boards.left.words) | (photos.right.words & boards.right.words))


def _same_cameras(photos: Pair, boards: Pair) -> bool:
    """Whether the left series of both pairs are of one camera, as far as the words for the cameras say."""
    if Evidence.USER in (photos.evidence, boards.evidence):
        return True
    indices = [tuple(label.rpartition(" ")[2] for label in pair.labels) for pair in (photos, boards)]
    sides = photos.labels in LEFT_RIGHT and boards.labels in LEFT_RIGHT
    return photos.labels == boards.labels or sides or all(are_numbers(index) for index in indices)


def _is_sure(photos: Pair, boards: Pair) -> bool:
    """Whether nothing else is likely: 1 and 2 beside a word, or A and B beside the same one, may count the tests."""
    if Evidence.NOTHING in (photos.evidence, boards.evidence) or not _same_cameras(photos, boards):
        return False
    if photos.evidence != Evidence.NUMBER or not photos.context or is_serial(photos.labels[0]):
        return True
    return photos.labels == boards.labels != ("1", "2") and photos.context != boards.context


def _reason(
    photos: Sequence[Pair], rigs: Sequence[tuple[Pair, Pair]], boards: Sequence[Series], has_calibration: bool
) -> str:
    if not boards and not has_calibration:
        return "two cameras, but no photographs of a board and no file with their calibration"
    if len(photos) > 1:
        return f"{len(photos)} pairs of series of the specimen look alike"
    if not rigs and boards:
        return "two cameras, but boards of one camera only"
    if len(rigs) > 1:
        return f"{len(rigs)} pairs of series of the boards look alike"
    return "the names do not say which series are of one camera"
