"""What photographs show: a board, or a specimen. A few photographs of each series are looked at."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from functools import partial
from itertools import pairwise
from pathlib import PurePosixPath
from typing import NamedTuple, Protocol

from dicflow.core.calibration.board import Board, common_board
from dicflow.errors import InputError
from dicflow.start.layouts import Series
from dicflow.start.words import BOARD_WORDS

__all__ = ["See", "Subjects", "board_in", "subjects_of"]


class See(Protocol):
    """The board in a photograph, by a quick search or a thorough one."""

    def __call__(self, path: PurePosixPath, thorough: bool = False) -> Board | None:
        """Raises InputError if the file cannot be read."""


_FIRST_LOOKS, _MORE_LOOKS, _MOST_LOOKS, _LOOKS_AT_BOARDS = 3, 7, 25, 5
_MOST_RUNS, _MOST_NAMED_RUNS = 6, 2
"""Of boards and of the specimen in one series: boards before and after the test, by two cameras; in one that is named
like boards."""
_MIN_BETWEEN, _MIN_BESIDE_OTHERS = 2, 3
"""Photographs in a run between two others, and in any run where other series show the same."""
_LEAST_SIDE = 4
"""Speckles look like a smaller board here and there."""


class Subjects(NamedTuple):
    """Series by what they show.

    unrecognised : named like boards, but without a board that is recognised
    unreadable : no photograph of them can be read
    """

    specimen: tuple[Series, ...]
    boards: tuple[Series, ...]
    unrecognised: tuple[Series, ...] = ()
    unreadable: tuple[Series, ...] = ()


def subjects_of(series: Sequence[Series], see: See) -> Subjects:
    """Series of the specimen and of boards; one that shows both is divided where they change."""
    seen = _seen(series, see)
    readable = [one for one in series if seen[one]]
    whole = frozenset(all(seen[one]) for one in readable if all(seen[one]) or not any(seen[one]))
    parts = [part for one in readable for part in _parts(one, seen[one], _twice(see), whole)]
    boards = tuple(part for part, is_board in parts if is_board)
    rest = [part for part, is_board in parts if not is_board]
    unsure = tuple(one for one in rest if _says_board(one))
    specimen = tuple(one for one in rest if one not in unsure)
    unreadable = tuple(one for one in series if not seen[one])
    return Subjects(specimen or unsure, boards, unsure if specimen else (), unreadable)


def _seen(series: Sequence[Series], see: See) -> dict[Series, list[Board | None]]:
    """What photographs of each series show; more of them where few leave a doubt, or leave one subject without any."""
    quick = {one: _looks(one, _FIRST_LOOKS, see) for one in series}
    is_one_subject = len({all(found) for found in quick.values() if found}) < 2
    doubts = [one for one in series if is_one_subject or _is_doubtful(one, quick[one])]
    return quick | {one: _looks(one, _MORE_LOOKS, _twice(see)) for one in doubts}


def board_in(series: Iterable[Series], see: See) -> Board | None:
    """The board that most of a few photographs show; of ChArUco boards the largest part that one shows."""
    found = [board for one in series for board in _looks(one, _LOOKS_AT_BOARDS, partial(see, thorough=True)) if board]
    return common_board(found)[0] if found else None


def _is_doubtful(one: Series, found: Sequence[Board | None]) -> bool:
    """Whether photographs of a series disagree, or show no board although the series is named so."""
    return any(found) != all(found) or (_says_board(one) and not any(found))


def _twice(see: See) -> See:
    """A second, thorough search where a quick one finds no board."""
    return lambda path, thorough=False: see(path, thorough) or see(path, True)


def _looks(one: Series, count: int, see: See) -> list[Board | None]:
    """What photographs spread over a series show; those that cannot be read are left out."""
    found = []
    for place in _places(one, count):
        try:
            found.append(_large(see(one.files[place])))
        except InputError:
            continue
    return found


def _places(one: Series, count: int) -> list[int]:
    """So many places at most, spread over a series from its first photograph to its last."""
    last = len(one.files) - 1
    return sorted({round(k * last / (count - 1)) for k in range(count)})


def _large(board: Board | None) -> Board | None:
    return board if board and (board.target != "checkerboard" or min(board.size) >= _LEAST_SIDE) else None


def _says_board(one: Series) -> bool:
    return bool(one.words & BOARD_WORDS)


def _parts(one: Series, found: Sequence[Board | None], see: See, whole: Collection[bool]) -> list[tuple[Series, bool]]:
    """A series apart where boards end or begin, and whether each part shows boards; whole where that changes often.

    whole : whether there are other series of boards alone (True), and of the specimen alone (False)
    """
    shown = [board is not None for board in found]
    if all(shown) or not any(shown):
        return [(one, all(shown))]
    every = _runs(one, see)
    runs = _long_runs(every, {True, False} if _says_board(one) else whole)
    if not 1 < len(runs) <= (_MOST_NAMED_RUNS if _says_board(one) else _MOST_RUNS):
        return [(one, _says_board(one) or _are_mostly_boards(every))]
    return [(one._replace(files=one.files[run.start : run.end]), run.is_board) for run in runs]


class _Run(NamedTuple):
    """Photographs of a series from start to before end that all show a board, or none."""

    is_board: bool
    start: int
    end: int


def _runs(one: Series, see: See) -> list[_Run]:
    """Runs of a series, as far as spread photographs meet them; each change is sought between two of these."""
    places = _places(one, _MOST_LOOKS)
    shown = {place: _shows_board(one.files[place], see) for place in places}
    changes = [_change(one, low, high, see) for low, high in pairwise(places) if shown[low] != shown[high]]
    edges = [0, *changes, len(one.files)]
    return [_Run(shown[0] ^ bool(k % 2), start, end) for k, (start, end) in enumerate(pairwise(edges))]


def _are_mostly_boards(runs: Sequence[_Run]) -> bool:
    return 2 * sum(run.end - run.start for run in runs if run.is_board) > runs[-1].end


def _long_runs(runs: Sequence[_Run], elsewhere: Collection[bool]) -> list[_Run]:
    """Runs without those that are too short to be meant: a board that is not seen, or speckles that look like one.

    elsewhere : of which sort there are other series, so that nothing is lost with a short run
    """
    last = len(runs) - 1
    joined: list[_Run] = []
    for k, run in enumerate(runs):
        least = _MIN_BESIDE_OTHERS if run.is_board in elsewhere else 1 if k in (0, last) else _MIN_BETWEEN
        is_long = run.end - run.start >= least
        is_board = run.is_board if is_long else not run.is_board
        if joined and joined[-1].is_board == is_board:
            joined[-1] = joined[-1]._replace(end=run.end)
        else:
            joined.append(run._replace(is_board=is_board))
    return joined


def _change(one: Series, low: int, high: int, see: See) -> int:
    """The first photograph after a change between two of a series."""
    first = _shows_board(one.files[low], see)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _shows_board(one.files[middle], see) == first else (low, middle)
    return high


def _shows_board(path: PurePosixPath, see: See) -> bool:
    try:
        return _large(see(path)) is not None
    except InputError:
        return False
