from pathlib import Path

import cv2
import numpy as np
import pytest
from boards import SIZE, board_photograph
from hypothesis import given
from hypothesis import strategies as st

from dicflow.core.calibration.targets import (
    SMALLEST_BOARD,
    board_orders,
    board_points,
    board_size,
    detect_checkerboard,
    determines_pose,
    find_board,
)

pytestmark = pytest.mark.slow

SPECKLES = Path(__file__).resolve().parents[3] / "data_samples" / "photos" / "right" / "step_05.png"
HOMOGRAPHY = np.array([[30.0, -4.0, 90.0], [5.0, 28.0, 70.0], [6e-3, 1e-2, 1.0]])


def corners_of(homography, size=SIZE):
    grid = board_points(size, 1.0)
    grid[:, 2] = 1.0
    seen = grid @ homography.T
    return seen[:, :2] / seen[:, 2:]


def error_px(found, truth):
    """Root mean square error, whichever way the board was taken up."""
    return min(np.sqrt(np.mean((order - truth) ** 2)) for order in (found, found[::-1]))


@pytest.fixture(scope="module")
def photograph():
    return board_photograph(HOMOGRAPHY, (300, 400))


def test_points_run_row_by_row():
    points = board_points((4, 3), 2.5)
    assert points.shape == (12, 3)
    np.testing.assert_array_equal(points[1], [2.5, 0, 0])
    np.testing.assert_array_equal(points[4], [0, 2.5, 0])


@given(st.integers(3, 9), st.integers(3, 9))
def test_orders_are_turns_of_the_board(columns, rows):
    orders = board_orders((columns, rows))
    assert len(orders) == (4 if columns == rows else 2)
    points = board_points((columns, rows), 1.0)[:, :2]
    for order in orders:
        turned = points[order] - points[order].mean(axis=0)
        centred = points - points.mean(axis=0)
        rotation = np.linalg.lstsq(centred, turned, rcond=None)[0]
        np.testing.assert_allclose(centred @ rotation, turned, atol=1e-12)
        assert np.linalg.det(rotation) == pytest.approx(1.0)


def test_corners_are_found_where_they_are(photograph):
    found = find_board(photograph, SIZE)
    truth = corners_of(HOMOGRAPHY)
    assert error_px(found, truth) < 0.008


def test_what_is_detected_does_not_depend_on_what_was_detected_before():
    """Speckles, in which the detector's random search finds now this, now that."""
    speckles = cv2.imread(str(SPECKLES), cv2.IMREAD_GRAYSCALE)
    found = []
    for state in range(6):
        cv2.setRNGSeed(7919 * state + 1)
        grid = detect_checkerboard(speckles, SMALLEST_BOARD, cv2.CALIB_CB_LARGER)
        found.append(None if grid is None else grid.tolist())
    assert all(one == found[0] for one in found)


def test_corners_of_a_large_photograph():
    """The board is located on the half-sized image, which must leave no trace in the corners."""
    larger = np.diag([3.0, 3.0, 1.0]) @ HOMOGRAPHY
    found = find_board(board_photograph(larger, (900, 1180), finer=4), SIZE)
    assert error_px(found, corners_of(larger)) < 0.01


def test_deeper_grey_levels_give_the_same_corners(photograph):
    deep = photograph.astype(np.uint16) * 100 + 5000
    np.testing.assert_allclose(find_board(deep, SIZE), find_board(photograph, SIZE), atol=2e-3)


def test_without_a_board_the_result_is_none(photograph):
    assert find_board(np.full((200, 300), 128, np.uint8), SIZE) is None
    assert find_board(photograph, (8, 5)) is None


@pytest.mark.parametrize(
    ("seen", "enough"),
    [
        ([0, 1, 2], False),
        ([0, 9, 18, 27, 36, 45], False),
        ([0, 1, 2, 3, 4, 5, 6, 7, 8, 22], False),
        ([0, 1, 9, 10, 2], False),
        ([0, 1, 2, 9, 10, 11], True),
        ([0, 4, 8, 20, 31, 53], True),
    ],
    ids=["three", "a column", "a row and one more", "five", "a block", "scattered"],
)
def test_six_corners_that_are_not_in_line_determine_the_pose(seen, enough):
    assert determines_pose(board_points(SIZE, 7.0), np.isin(np.arange(54), seen)) == enough


def test_size_of_an_unknown_board(photograph):
    assert board_size(photograph) == SIZE
    assert board_size(photograph.T.copy()) == SIZE
    assert board_size(np.full((200, 300), 128, np.uint8)) is None
