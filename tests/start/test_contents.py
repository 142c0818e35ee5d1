"""Boards and specimen by what a few photographs show, with looks that are made up."""

from __future__ import annotations

from pathlib import PurePosixPath

import pytest

from dicflow.core.calibration.board import Board
from dicflow.errors import InputError
from dicflow.start.contents import board_in, subjects_of
from dicflow.start.layouts import series_of

CHECKERS = Board("checkerboard", (9, 6))


class Eyes:
    """Looks that count, at photographs of which some show a board: easily, or by a thorough search only.

    shown : file name → board; None for a file that cannot be read
    """

    def __init__(self, shown, hard=()):
        self.shown, self.hard, self.seen = shown, hard, []

    def __call__(self, path, thorough=False):
        self.seen.append(path)
        if path.name in self.shown and self.shown[path.name] is None:
            raise InputError(f"{path}: damaged")
        return None if path.name in self.hard and not thorough else self.shown.get(path.name)


def series(folder, count, name="p"):
    (one,) = series_of([PurePosixPath(folder, f"{name}{k}.png") for k in range(count)])
    return one


def boards(name, *numbers):
    return dict.fromkeys((f"{name}{k}.png" for k in numbers), CHECKERS)


def test_few_photographs_are_looked_at():
    test, calibration = series("a", 200, "t"), series("b", 100, "c")
    eyes = Eyes(boards("c", *range(100)))
    found = subjects_of([test, calibration], eyes)
    assert (found.specimen, found.boards) == ((test,), (calibration,))
    assert len(eyes.seen) == 6


def test_a_board_that_is_hard_to_see_is_looked_for_where_no_other_is():
    test, calibration = series("a", 20, "t"), series("b", 20, "c")
    names = [f"c{k}.png" for k in range(20)]
    found = subjects_of([test, calibration], Eyes(boards("c", *range(20)), hard=names))
    assert (found.specimen, found.boards) == ((test,), (calibration,))


@pytest.mark.parametrize(("folder", "is_board"), [("x", False), ("Calibration 2", True)])
def test_the_name_breaks_a_tie(folder, is_board):
    """Boards that show in two looks of seven: boards if they are named so."""
    one = series(folder, 13, "c")
    found = subjects_of([one, series("t", 5, "t")], Eyes(boards("c", 4, 8)))
    assert (one in found.boards) == is_board
    assert (one in found.specimen) != is_board


def test_speckles_that_look_like_a_small_board_are_a_specimen():
    one = series("t", 9)
    small = {f"p{k}.png": Board("checkerboard", (5, 3)) for k in range(9)}
    assert subjects_of([one], Eyes(small)).specimen == (one,)


def test_boards_that_are_not_recognised_are_no_specimen():
    test, calibration = series("test", 5, "t"), series("calib", 40, "c")
    found = subjects_of([test, calibration], Eyes({}))
    assert (found.specimen, found.unrecognised) == ((test,), (calibration,))
    assert subjects_of([calibration], Eyes({})).specimen == (calibration,)


@pytest.mark.parametrize("end", [1, 7, 20, 39])
@pytest.mark.parametrize("first", [True, False])
def test_a_series_is_divided_where_the_boards_end(end, first):
    one = series("phone", 40)
    numbers = range(end) if first else range(end, 40)
    found = subjects_of([one], Eyes(boards("p", *numbers)))
    (board,), (test,) = found.boards, found.specimen
    assert {path.name for path in board.files} == {f"p{k}.png" for k in numbers}
    assert len(test.files) == 40 - len(numbers)
    assert (board.files[0].name == "p0.png") == first


def test_single_boards_that_are_not_seen_do_not_divide_a_series():
    test, calibration = series("a", 30, "t"), series("b", 30, "c")
    shown = set(range(30)) - {0, 15, 29}
    found = subjects_of([test, calibration], Eyes(boards("c", *shown)))
    assert (found.specimen, found.boards) == ((test,), (calibration,))


def test_damaged_photographs_are_passed_over():
    test, calibration, damaged = series("a", 9, "t"), series("b", 9, "c"), series("d", 4, "d")
    shown = boards("c", *range(9)) | {"t0.png": None, "c0.png": None} | {f"d{k}.png": None for k in range(4)}
    found = subjects_of([test, calibration, damaged], Eyes(shown))
    assert (found.specimen, found.boards, found.unreadable) == ((test,), (calibration,), (damaged,))


def test_the_board_of_a_series_is_the_one_that_most_photographs_show():
    one = series("b", 5)
    cut = Board("checkerboard", (7, 6))
    assert board_in([one], Eyes(boards("p", 0, 1, 2) | {"p3.png": cut, "p4.png": cut})) == CHECKERS
    assert board_in([one], Eyes({})) is None
    parts = {f"p{k}.png": Board("charuco", (8, 2 + k), "4x4_50", 0.7) for k in range(5)}
    assert board_in([one], Eyes(parts)) == Board("charuco", (8, 6), "4x4_50", 0.7)
