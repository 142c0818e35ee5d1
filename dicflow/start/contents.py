"""What photographs show: a board, or a specimen. A few photographs of each series are looked at."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
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


_FIRST_LOOKS, _MORE_LOOKS, _LOOKS_AT_BOARDS = 3, 7, 5
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
    """Series of the specimen and of boards; one that shows first the one and then the other is divided."""
    quick = {one: _looks(one, _FIRST_LOOKS, see) for one in series}
    doubts = [one for one in series if _is_doubtful(one, quick[one])] if any(map(any, quick.values())) else series
    seen = quick | {one: _looks(one, _MORE_LOOKS, _twice(see)) for one in doubts}
    readable = [one for one in series if seen[one]]
    boards = [one for one in readable if _is_board(one, seen[one])]
    unsure = [one for one in readable if one not in boards and _says_board(one)]
    specimen = [one for one in readable if one not in boards and one not in unsure]
    least = 2 if boards and specimen else 1
    mixed = [one for one in readable if _changes_once(seen[one], least)]
    if mixed:
        parts = [part for one in series for part in (_divided(one, _twice(see)) if one in mixed else [one])]
        return subjects_of(parts, see)
    unreadable = tuple(one for one in series if not seen[one])
    return Subjects(tuple(specimen or unsure), tuple(boards), tuple(unsure if specimen else ()), unreadable)


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
    last = len(one.files) - 1
    places = sorted({round(k * last / (count - 1)) for k in range(count)})
    found = []
    for place in places:
        try:
            found.append(_large(see(one.files[place])))
        except InputError:
            continue
    return found


def _large(board: Board | None) -> Board | None:
    return board if board and (board.target != "checkerboard" or min(board.size) >= _LEAST_SIDE) else None


def _is_board(one: Series, found: Sequence[Board | None]) -> bool:
    """Whether most of the photographs show a board, or some of those in a series that is named so."""
    count = sum(board is not None for board in found)
    return 2 * count > len(found) or (count > 0 and _says_board(one))


def _says_board(one: Series) -> bool:
    return bool(one.words & BOARD_WORDS)


def _changes_once(found: Sequence[Board | None], least: int) -> bool:
    """Whether boards end or begin once, with so many looks at least on either side."""
    shown = [board is not None for board in found]
    first = next((k for k, board in enumerate(shown) if board != shown[0]), 0)
    return min(first, len(shown) - first) >= least and len(set(shown[first:])) == 1


def _divided(one: Series, see: See) -> list[Series]:
    """A series apart where the boards end or begin."""
    low, high = 0, len(one.files) - 1
    first = _shows_board(one.files[low], see)
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (middle, high) if _shows_board(one.files[middle], see) == first else (low, middle)
    return [one._replace(files=one.files[:high]), one._replace(files=one.files[high:])]


def _shows_board(path: PurePosixPath, see: See) -> bool:
    try:
        return _large(see(path)) is not None
    except InputError:
        return False
