"""Boards that are recognised without an expectation, in drawings seen through homographies."""

import cv2
import numpy as np
import pytest
from boards import SIZE, board_photograph

from dicflow.core.calibration.board import Board, common_board
from dicflow.core.calibration.charuco import marker_dictionary
from dicflow.core.calibration.circles import circle_points
from dicflow.core.calibration.find import find_marks
from dicflow.core.calibration.identify import identify_board
from dicflow.core.calibration.lattice import lattice_places

pytestmark = pytest.mark.slow

CHECKERBOARD = Board("checkerboard", SIZE)
HOMOGRAPHY = np.array([[30.0, -4.0, 90.0], [5.0, 28.0, 70.0], [6e-3, 1e-2, 1.0]])
TILTED = np.array([[0.9, -0.12, 60.0], [0.14, 0.85, 30.0], [2e-4, -1e-4, 1.0]])
BLANK = np.full((300, 400), 120, np.uint8)


def tilted(drawing, shape=(560, 720)):
    """A drawing in perspective, blurred and noisy."""
    image = cv2.warpPerspective(drawing, TILTED, shape[::-1], flags=cv2.INTER_AREA, borderValue=255)
    grey = cv2.GaussianBlur(image, (0, 0), 0.8) * 0.7 + 30.0 + np.random.default_rng(3).normal(0.0, 1.5, shape)
    return np.clip(np.round(grey), 0, 255).astype(np.uint8)


def charuco(size, share=0.75, dictionary="4x4_50", legacy=False, square_px=50):
    columns, rows = size[0] + 1, size[1] + 1
    board = cv2.aruco.CharucoBoard((columns, rows), 1.0, share, marker_dictionary(dictionary))
    board.setLegacyPattern(legacy)
    drawing = board.generateImage((columns * square_px, rows * square_px), marginSize=0)
    return np.pad(drawing, square_px // 2, constant_values=255)


def circles(size, asymmetric, pitch_px=36):
    points = circle_points(size, pitch_px, asymmetric)[:, :2] + 1.6 * pitch_px
    width, height = np.ceil(points.max(axis=0) + 1.6 * pitch_px).astype(int)
    drawing = np.full((height, width), 255, np.uint8)
    for x, y in points:
        cv2.circle(drawing, (round(x), round(y)), round(0.36 * pitch_px), 0, -1, cv2.LINE_AA)
    return drawing


@pytest.mark.parametrize("size", [(9, 7), (7, 9), (8, 6), (9, 6), (5, 5)])
@pytest.mark.parametrize("legacy", [False, True])
def test_a_charuco_board_is_known_by_its_markers(size, legacy):
    found = identify_board(tilted(charuco(size, legacy=legacy)))
    assert found._replace(marker=None) == Board("charuco", size, "4x4_50")
    assert found.marker == pytest.approx(0.75, abs=0.03)


@pytest.mark.parametrize(
    ("dictionary", "share"), [("5x5_50", 0.6), ("6x6_250", 0.8), ("aruco_original", 0.7), ("apriltag_36h11", 0.75)]
)
def test_dictionary_and_size_of_the_markers(dictionary, share):
    """Markers of a larger dictionary are those of the smallest that holds them."""
    found = identify_board(tilted(charuco((7, 5), share, dictionary, square_px=64)))
    assert found.dictionary == dictionary.replace("250", "50")
    assert found.size == (7, 5)
    assert found.marker == pytest.approx(share, abs=0.03)


def test_a_part_of_a_charuco_board():
    """Without its first rows and columns, the numbers of the markers still give the size up to the last row."""
    found = identify_board(tilted(charuco((9, 7))[130:, 110:]))
    assert found.size == (9, 7)


@pytest.mark.parametrize(("size", "asymmetric"), [((7, 5), False), ((4, 11), True), ((5, 6), True), ((6, 6), False)])
@pytest.mark.parametrize("bright", [False, True])
def test_a_grid_of_circles_is_known_by_its_lattice(size, asymmetric, bright):
    image = tilted(circles(size, asymmetric))
    found = identify_board(255 - image if bright else image)
    assert found == Board("asymmetric_circles" if asymmetric else "circles", size)


def test_a_checkerboard_is_known_by_its_corners():
    photograph = board_photograph(HOMOGRAPHY, (300, 400))
    assert identify_board(photograph) == CHECKERBOARD
    assert identify_board(photograph, thorough=False) == CHECKERBOARD
    large = board_photograph(np.diag([5.0, 5.0, 1.0]) @ HOMOGRAPHY, (1500, 2000), finer=2)
    assert identify_board(large) == CHECKERBOARD


def test_a_checkerboard_that_is_cut_off_is_not_whole():
    cut = board_photograph(HOMOGRAPHY, (300, 400))[:, :260]
    assert identify_board(cut, thorough=False) is None
    assert identify_board(cut).size < SIZE


def test_nothing_is_no_board():
    noise = np.random.default_rng(0).normal(120.0, 20.0, (300, 400)).clip(0, 255).astype(np.uint8)
    assert identify_board(BLANK) is None
    assert identify_board(cv2.GaussianBlur(noise, (0, 0), 2.0)) is None


@pytest.mark.parametrize(
    ("drawn", "expected", "settings"),
    [
        (charuco((9, 7)), Board("checkerboard", (9, 7)), "target: charuco, dictionary: 4x4_50, marker: 0."),
        (charuco((9, 7)), Board("charuco", (7, 9), "4x4_50", 0.75), "size: [9, 7]"),
        (charuco((9, 7)), Board("charuco", (9, 7), "5x5_50", 0.75), "dictionary: 4x4_50"),
        (charuco((9, 7)), Board("circles", (9, 7)), "target: charuco"),
        (circles((4, 11), True), Board("asymmetric_circles", (11, 4)), "size: [4, 11]"),
        (circles((4, 11), True), Board("circles", (4, 11)), "target: asymmetric_circles"),
        (circles((7, 5), False), Board("checkerboard", (7, 5)), "target: circles"),
    ],
)
def test_what_was_expected_wrongly_is_named(drawn, expected, settings):
    found = find_marks(tilted(drawn), expected)
    assert found.marks is None
    assert found.shown.settings(expected).startswith(settings)
    assert found.reason == f"shows {found.shown.text}"


def test_a_checkerboard_in_place_of_a_charuco_board():
    expected = Board("charuco", SIZE, "4x4_50", 0.75)
    found = find_marks(board_photograph(HOMOGRAPHY, (300, 400)), expected)
    assert (found.marks, found.shown) == (None, CHECKERBOARD)
    assert found.shown.settings(expected) == "target: checkerboard"


def test_the_expected_board_is_found():
    for drawn, board in (
        (charuco((9, 7)), Board("charuco", (9, 7), "4x4_50", 0.75)),
        (charuco((9, 7)), Board("charuco", (9, 7), "4x4_50", 0.5)),
        (circles((4, 11), True), Board("asymmetric_circles", (4, 11))),
    ):
        found = find_marks(tilted(drawn), board)
        assert (found.shown, found.reason) == (board, "")
        assert len(found.marks) == board.size[0] * board.size[1]


def test_few_corners_of_a_board_are_a_reason():
    drawn = charuco((9, 7))
    drawn[:, 200:] = 255
    drawn[170:] = 255
    found = find_marks(tilted(drawn), Board("charuco", (9, 7), "4x4_50", 0.75))
    assert found.marks is None
    assert found.reason.startswith("too few corners, ")
    assert found.reason.endswith(" of 63")


def test_the_board_of_many_photographs():
    parts = [Board("charuco", (9, rows), "4x4_50", share) for rows, share in ((7, 0.74), (5, 0.75), (7, 0.76))]
    assert common_board([*parts, CHECKERBOARD]) == (Board("charuco", (9, 7), "4x4_50", 0.75), 3)
    assert common_board([CHECKERBOARD, Board("checkerboard", (8, 6)), CHECKERBOARD]) == (CHECKERBOARD, 2)


def test_places_on_a_lattice():
    """In any directions and from any origin: neighbours differ by one step, others do not."""
    grid = np.stack(np.meshgrid(np.arange(6.0), np.arange(4.0)), axis=-1).reshape(-1, 2)
    image = cv2.perspectiveTransform(grid[None] * 40.0, TILTED)[0]
    stray = np.array([[500.0, 500.0], image[8] + 20.0])
    places = lattice_places(np.concatenate([image, stray]))
    assert np.isnan(places[-2:]).all()
    steps = np.abs(places[:-2, None] - places[None, :-2]).sum(axis=-1)
    np.testing.assert_array_equal(steps, np.abs(grid[:, None] - grid[None]).sum(axis=-1))
    assert np.isnan(lattice_places(image[:3])).all()
