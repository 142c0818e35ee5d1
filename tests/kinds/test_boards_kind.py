import numpy as np

from dicflow.kinds.boards import BoardMarks
from tests.kinds.layouts import layouts, long_names, stored

LEFT = np.random.default_rng(1).uniform(0, 600, (54, 2))
NOTHING = np.empty((0, 2))


def write(left=LEFT, right=LEFT + 3.0, seen=(None, None), target="checkerboard"):
    marks, others = {"left": left, "right": right}, dict(zip(("left", "right"), seen, strict=True))
    return stored(BoardMarks.write(marks, others, target, (9, 6), (640, 480)))


def test_marks_come_back_bit_for_bit():
    product = write()
    board = BoardMarks.read(product)
    np.testing.assert_array_equal(board["left"], LEFT)
    np.testing.assert_array_equal(board["right"], LEFT + 3.0)
    assert (board.target, board.size, board.image_size) == ("checkerboard", (9, 6), (640, 480))
    assert layouts(product) == {"left": ("corner component", "px"), "right": ("corner component", "px")}
    assert long_names(product) == {"left": "left corners", "right": "right corners"}


def test_a_board_that_one_camera_sees_is_not_found_by_both():
    board = BoardMarks.read(write(right=NOTHING))
    assert [board.is_found(side) for side in ("left", "right")] == [True, False]
    assert not board.is_found_by_both
    assert BoardMarks.read(write()).is_found_by_both


def test_boards_of_another_size_are_those_of_photographs_without_marks():
    board = BoardMarks.read(write(right=NOTHING, seen=((9, 6), (8, 5))))
    assert board.others == {"right": (8, 5)}


def test_one_camera_has_left_marks_alone():
    product = stored(BoardMarks.write({"left": LEFT}, {"left": (9, 6)}, "charuco", (9, 6), (640, 480)))
    board = BoardMarks.read(product)
    assert "right" not in board
    assert board.is_found_by_both
