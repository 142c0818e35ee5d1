import cv2
import numpy as np
import pytest

from dicflow.core.calibration.board import MARKER_COUNTS
from dicflow.core.calibration.charuco import marker_dictionary
from dicflow.core.synthetic.charuco import CharucoBoard, charuco_darkness, charuco_extent
from dicflow.core.synthetic.checkerboard import Checkerboard
from dicflow.core.synthetic.circles import CircleGrid, circle_centres, circle_darkness, circle_extent


def test_centres_of_grids():
    assert circle_centres(CircleGrid(3, 2, 10.0)).tolist() == [
        [[0, 0], [10, 0], [20, 0]],
        [[0, 10], [10, 10], [20, 10]],
    ]
    shifted = circle_centres(CircleGrid(2, 3, 10.0, asymmetric=True))
    assert shifted.tolist() == [[[0, 0], [20, 0]], [[10, 10], [30, 10]], [[0, 20], [20, 20]]]


@pytest.mark.parametrize("asymmetric", [False, True])
def test_circles_are_black_to_their_radius(asymmetric):
    """Around every circle; ½ on the edge."""
    grid = CircleGrid(4, 5, 10.0, radius=3.5, asymmetric=asymmetric, edge=0.2)
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    for radius, expected in ((0.0, 1.0), (3.39, 1.0), (3.5, 0.5), (3.61, 0.0), (4.0, 0.0)):
        points = circle_centres(grid)[:, :, None] + radius * rim
        np.testing.assert_allclose(circle_darkness(grid, points), expected, atol=1e-9)


def test_number_of_circles():
    grid = CircleGrid(4, 5, 10.0, radius=3.5, asymmetric=True)
    left, right, top, bottom = circle_extent(grid)
    x, y = np.meshgrid(np.arange(left, right, 0.1), np.arange(top, bottom, 0.1))
    share = circle_darkness(grid, np.stack([x, y], axis=-1)).mean()
    assert share * (right - left) * (bottom - top) == pytest.approx(20 * np.pi * 3.5**2, rel=2e-3)


@pytest.mark.parametrize("squares", [(8, 6), (7, 5), (5, 8)])
def test_a_marked_board_is_the_one_that_opencv_prints(squares):
    """Compared square by square and module by module, in pixels of a quarter module."""
    marked = CharucoBoard(Checkerboard(*squares, square=30.0, margin=0.0, edge=1e-6), 0.8, "4x4_100")
    board = cv2.aruco.CharucoBoard(squares, 30.0, 24.0, marker_dictionary("4x4_100"))
    printed = board.generateImage((30 * squares[0], 30 * squares[1])) < 128
    x, y = np.meshgrid(np.arange(30 * squares[0]) + 0.5, np.arange(30 * squares[1]) + 0.5)
    ours = charuco_darkness(marked, np.stack([x, y], axis=-1)) > 0.5
    assert (ours == printed).mean() > 0.999


def test_paper_around_a_marked_board_is_white():
    marked = CharucoBoard()
    left, right, top, bottom = charuco_extent(marked)
    corners = [[left, top], [right, top], [right, bottom], [left, bottom]]
    assert not charuco_darkness(marked, corners).any()
    assert right - left == pytest.approx(10 * 14.5 + 10.0)


@pytest.mark.parametrize("name", MARKER_COUNTS)
def test_every_dictionary_exists(name):
    assert marker_dictionary(name).bytesList.shape[0] > 0
