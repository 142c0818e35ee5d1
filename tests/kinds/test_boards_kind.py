import numpy as np

from dicflow.core.calibration.board import Board
from dicflow.kinds.boards import BoardMarks
from tests.kinds.layouts import layouts, long_names, stored

LEFT = np.random.default_rng(1).uniform(0, 600, (54, 2))
NOTHING = np.empty((0, 2))


BOARD = Board("checkerboard", (9, 6))
MARKED = Board("charuco", (7, 5), "4x4_50", 0.75)
SIZES = {"left": (640, 480), "right": (600, 440)}


def write(left=LEFT, right=LEFT + 3.0, shown=(BOARD, BOARD), reasons=("", "")):
    sides = "left", "right"
    marks, others, why = (dict(zip(sides, each, strict=True)) for each in ((left, right), shown, reasons))
    return stored(BoardMarks.write(marks, others, BOARD, SIZES, why))


def test_marks_come_back_bit_for_bit():
    product = write()
    board = BoardMarks.read(product)
    np.testing.assert_array_equal(board["left"], LEFT)
    np.testing.assert_array_equal(board["right"], LEFT + 3.0)
    assert (board.board, board.image_sizes, board.reason) == (BOARD, SIZES, "")
    assert layouts(product) == {"left": ("corner component", "px"), "right": ("corner component", "px")}
    assert long_names(product) == {"left": "left corners", "right": "right corners"}


def test_a_board_that_one_camera_sees_is_not_found_by_both():
    board = BoardMarks.read(write(right=NOTHING))
    assert [board.is_found(side) for side in ("left", "right")] == [True, False]
    assert not board.is_found_by_both
    assert BoardMarks.read(write()).is_found_by_both


def test_other_boards_are_those_of_photographs_without_marks():
    board = BoardMarks.read(write(right=NOTHING, shown=(BOARD, MARKED), reasons=("", "shows another one")))
    assert board.others == {"right": MARKED}
    assert board.reason == "right: shows another one"
    assert not BoardMarks.read(write(right=NOTHING)).others


def test_one_camera_has_left_marks_alone():
    product = stored(BoardMarks.write({"left": LEFT}, {"left": BOARD}, BOARD, {"left": (640, 480)}))
    board = BoardMarks.read(product)
    assert "right" not in board
    assert board.is_found_by_both
