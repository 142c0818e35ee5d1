import cv2
import numpy as np
import pytest

from dicflow.core.calibration.charuco import Markers, charuco_target, find_charuco, marker_dictionary
from dicflow.core.calibration.targets import determines_pose
from dicflow.core.cameras.camera import Camera, camera_matrix, rotation_matrix
from dicflow.core.synthetic.charuco import CharucoBoard, charuco_darkness, charuco_extent
from dicflow.core.synthetic.checkerboard import Checkerboard, board_corners
from dicflow.core.synthetic.deformation import Deformation
from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round, photograph
from dicflow.core.synthetic.trace import image_of

pytestmark = pytest.mark.slow

CAMERA = Camera(camera_matrix(2000.0, [399.0, 301.0]), np.array([-0.1, 0.2, 4e-4, -3e-4, 0.0]), (800, 600))
LOOK = GreyLevels(paper=205.0, ink=34.0)
MARKED = CharucoBoard(Checkerboard(8, 6, 16.0, edge=0.3), 0.7)
SIZE, MARKERS = (7, 5), Markers("4x4_50", 0.7)


def view(marked, tilt_deg, distance=480.0, shift=(0.0, 0.0)):
    """Photograph of a board before noise, and where its corners are (n, 2)."""
    extent = charuco_extent(marked)
    middle = np.array([extent.left + extent.right, extent.top + extent.bottom, 0.0]) / 2.0
    rotation = rotation_matrix(np.radians(tilt_deg))
    pose = Deformation(1.0, 1.0, rotation=rotation, translation=np.array([*shift, distance]) - rotation @ middle)
    image = photograph(CAMERA, pose, extent, lambda points: charuco_darkness(marked, points), LOOK, 4)
    return image, image_of(CAMERA, pose, board_corners(marked.board)).reshape(-1, 2)


def rms(error):
    return float(np.sqrt(np.mean(error**2)))


@pytest.fixture(scope="module")
def tilted():
    return view(MARKED, (25.0, 22.0, -100.0))


@pytest.mark.parametrize("noise", [0.0, 2.0])
def test_corners_are_found_where_they_are(tilted, noise):
    """A fifth of the error of the corners as the detector of the markers gives them, and less."""
    image, truth = tilted
    photo = add_noise_and_round(image, noise, [1])
    found = find_charuco(photo, SIZE, MARKERS)
    assert rms(found - truth) < 0.008
    board = cv2.aruco.CharucoBoard((8, 6), 1.0, 0.7, marker_dictionary("4x4_50"))
    located, numbers, _, _ = cv2.aruco.CharucoDetector(board).detectBoard(photo)
    assert rms(found - truth) < 0.2 * rms(located.reshape(-1, 2) - truth[numbers.reshape(-1)])


@pytest.mark.parametrize("share", [0.5, 0.85])
def test_markers_of_any_size_do_not_bias_the_corners(share):
    image, truth = view(MARKED._replace(marker=share), (20.0, -20.0, 10.0))
    assert rms(find_charuco(add_noise_and_round(image, 2.0, [1]), SIZE, Markers("4x4_50", share)) - truth) < 0.008


def test_corners_of_a_part_of_a_board_keep_their_indices():
    """The board leaves the frame to the right; what is seen is as exact, the rest is NaN."""
    image, truth = view(MARKED, (10.0, 15.0, 5.0), shift=(55.0, 20.0))
    found = find_charuco(add_noise_and_round(image, 2.0, [1]), SIZE, MARKERS)
    seen = np.isfinite(found[:, 0])
    assert 10 <= np.count_nonzero(seen) < len(truth)
    assert (truth[~seen] > [780.0, 580.0]).any()
    assert rms(found[seen] - truth[seen]) < 0.008


def test_too_small_a_part_is_no_board():
    image, _ = view(MARKED, (10.0, 15.0, 5.0), shift=(118.0, 85.0))
    seen = np.isfinite(find_charuco(add_noise_and_round(image, 2.0, [1]), SIZE, MARKERS)[:, 0])
    assert not determines_pose(charuco_target(SIZE, 1.0).points, seen)


def test_other_markers_are_no_board(tilted):
    photo = add_noise_and_round(tilted[0], 2.0, [1])
    assert np.isnan(find_charuco(photo, SIZE, Markers("6x6_50", 0.7))).all()
    assert np.isnan(find_charuco(np.full((300, 400), 128, np.uint8), SIZE, MARKERS)).all()


@pytest.mark.parametrize("legacy", [False, True])
def test_boards_that_begin_with_a_white_square(legacy):
    board = cv2.aruco.CharucoBoard((8, 6), 1.0, 0.7, marker_dictionary("4x4_50"))
    board.setLegacyPattern(legacy)
    photo = cv2.GaussianBlur(board.generateImage((848, 656), marginSize=40), (0, 0), 1.2)
    found = find_charuco(photo, SIZE, MARKERS).reshape(5, 7, 2)
    side = (found[-1, -1, 0] - found[0, 0, 0]) / 6.0
    x, y = np.meshgrid(np.arange(7), np.arange(5))
    np.testing.assert_allclose(found - found[0, 0], side * np.stack([x, y], axis=-1), atol=0.05)


def test_deeper_grey_levels_give_the_same_corners(tilted):
    plain = add_noise_and_round(tilted[0], 0.0, [1])
    deep = plain.astype(np.uint16) * 100 + 5000
    np.testing.assert_allclose(find_charuco(deep, SIZE, MARKERS), find_charuco(plain, SIZE, MARKERS), atol=2e-3)


def test_corners_have_one_order():
    assert charuco_target((7, 5), 3.0).orders.shape == (1, 35)
    assert charuco_target((7, 5), 3.0).points[-1].tolist() == [18.0, 12.0, 0.0]
