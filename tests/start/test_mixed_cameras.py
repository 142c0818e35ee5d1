"""Photographs of two cameras under one counter, in every order that people leave them: never taken for one camera's."""

from __future__ import annotations

from itertools import chain
from pathlib import PurePosixPath

import pytest

from dicflow.core.calibration.board import Board
from dicflow.start.choice import Candidate, Choice, Undecided, decide
from dicflow.start.contents import Subjects, subjects_of
from dicflow.start.layouts import series_of

CHECKERS = Board("checkerboard", (9, 6))


def subjects(shows: str, pattern: str = "IMG_{:04}.jpg") -> Subjects:
    """What is found where the photographs show, one after the other, a board B, the specimen S, or a hard board b."""
    paths = [PurePosixPath(pattern.format(k)) for k in range(101, 101 + len(shows))]
    shown = dict(zip(paths, shows, strict=True))

    def see(path: PurePosixPath, thorough: bool = False) -> Board | None:
        return CHECKERS if shown[path] == "B" or (shown[path] == "b" and thorough) else None

    return subjects_of(series_of(paths), see)


def counts(found: Subjects) -> tuple[list[int], list[int]]:
    return [len(one.files) for one in found.specimen], [len(one.files) for one in found.boards]


def asked(found: Subjects, has_calibration: bool = False) -> Undecided:
    with pytest.raises(Undecided) as caught:
        decide(found.specimen, found.boards, Choice(), has_calibration)
    return caught.value


def alternately(shows: str) -> str:
    return "".join(chain.from_iterable(zip(shows, shows, strict=True)))


@pytest.mark.parametrize(
    ("left", "right"),
    [
        ("B" * 8 + "SSS", "B" * 8 + "SSS"),
        ("B" * 12 + "SSS", "B" * 12 + "SSS"),
        ("BbBBbBbB" + "SSS", "bBBBBBbb" + "SSS"),
        ("SSSS" + "B" * 7, "SSSS" + "B" * 9),
        ("B" * 20 + "SS", "B" * 20 + "SS"),
        ("B" * 30 + "S" * 40, "B" * 28 + "S" * 40),
    ],
)
@pytest.mark.parametrize("pattern", ["IMG_{:04}.jpg", "test/DSC{:05}.png", "x/{}.tif"])
def test_one_camera_after_the_other_is_offered_as_two(left, right, pattern):
    question = asked(subjects(left + right, pattern))
    likely = question.candidates[0]
    assert likely.right is not None
    assert likely.boards is not None
    found = [len(one.files) for one in (likely.left, likely.right, *likely.boards[:2])]
    assert found == [left.count("S"), right.count("S"), len(left) - left.count("S"), len(right) - right.count("S")]


@pytest.mark.parametrize(
    ("shows", "expected"),
    [
        ("B" * 16 + "S" * 6, ([6], [16])),
        (alternately("B" * 8 + "SSS"), ([6], [16])),
        (alternately("SSSSS" + "B" * 5), ([10], [10])),
        ("B" * 8 + "S" * 6 + "B" * 8, ([6], [8, 8])),
    ],
)
def test_photographs_that_may_alternate_are_asked_about(shows, expected):
    """The counter runs through both cameras, and nothing tells how many there are."""
    found = subjects(shows)
    assert counts(found) == expected
    question = asked(found)
    assert f"{sum(expected[1])} photographs of a board, but one series" in question.reason
    assert question.candidates == [Candidate(found.specimen[0])]
    assert "named left and right" in question.otherwise


def test_boards_before_and_after_the_test_by_each_camera():
    found = subjects(("B" * 4 + "S" * 5 + "B" * 4) * 2)
    assert counts(found) == ([5, 5], [4, 8, 4])
    assert "2 series of the specimen look alike (5, 5 photographs)" in asked(found).reason


def test_boards_of_which_every_look_meets_one_still_leave_a_specimen():
    """The first, the middle and the last photograph show a board."""
    assert counts(subjects(("BBBSSSSBBB") * 2)) == ([4, 4], [3, 6, 3])


def test_a_calibration_of_two_cameras_beside_one_series_is_asked_about():
    question = asked(subjects("S" * 8), has_calibration=True)
    assert question.reason.startswith("a file with the calibration of two cameras, but one series")


def test_a_board_or_two_do_not_make_a_second_camera():
    """As they are photographed for the scale of one camera."""
    found = subjects("BB" + "S" * 9)
    assert decide(found.specimen, found.boards, Choice()) == Candidate(found.specimen[0])


def test_a_single_board_amid_the_specimen_is_speckles():
    assert counts(subjects("SSSSBSSSS")) == ([9], [])


def test_a_series_that_changes_often_is_left_whole():
    """A grid printed on the specimen may be found in some photographs and not in others."""
    assert counts(subjects("SSSBB" * 6)) == ([30], [])
