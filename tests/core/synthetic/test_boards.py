import cv2
import numpy as np
import pytest

from dicflow.core.cameras.camera import rotation_angle_deg
from dicflow.core.synthetic.checkerboard import Checkerboard, board_corners, board_darkness, board_outline
from dicflow.core.synthetic.render import GreyLevels, add_noise_and_round, render_board
from dicflow.core.synthetic.stand import board_poses, in_right_frame, verged_stand
from dicflow.core.synthetic.trace import image_of

pytestmark = pytest.mark.slow

SIZE = (540, 720)
LOOK = GreyLevels(paper=205.0, ink=34.0)


@pytest.fixture(scope="module")
def stand():
    return verged_stand(SIZE, 176.0)


@pytest.fixture(scope="module")
def board():
    return Checkerboard(edge=0.3)


@pytest.fixture(scope="module")
def poses(stand, board):
    return board_poses(stand, board, 8, seed=1)


def test_squares_alternate_on_white_paper():
    board = Checkerboard(4, 3, 10.0, 5.0, 0.1)
    x, y = np.meshgrid(np.arange(-5.0, 50.0, 10.0), np.arange(-5.0, 40.0, 10.0))
    expected = [[0, 0, 0, 0, 0, 0], [0, 1, 0, 1, 0, 0], [0, 0, 1, 0, 1, 0], [0, 1, 0, 1, 0, 0], [0, 0, 0, 0, 0, 0]]
    assert board_darkness(board, np.stack([x, y], axis=-1)).tolist() == expected


def test_edges_are_half_dark_and_corners_lie_between_four_squares():
    board = Checkerboard(4, 3, 10.0, 5.0, 0.5)
    assert board_darkness(board, [[0.0, 5.0], [5.0, 0.0], [10.0, 5.0], [20.0, 25.0], [30.0, 15.0]]) == pytest.approx(
        0.5
    )
    assert board_darkness(board, board_corners(board)) == pytest.approx(0.5)
    assert board_corners(board).shape == (2, 3, 2)


def test_boards_lie_inside_both_photographs(stand, board, poses):
    for pose in poses:
        for camera, seen in ((stand.rig.left, pose), (stand.rig.right, in_right_frame(stand.rig, pose))):
            pixels = image_of(camera, seen, board_outline(board))
            assert (pixels > 0).all()
            assert (pixels < np.array(SIZE) - 1).all()


def test_boards_tilt_by_less_than_half_a_right_angle_and_in_many_ways(poses):
    tilts = [np.degrees(np.arccos(abs(pose.rotation[2, 2]))) for pose in poses]
    assert max(tilts) < 45.0
    assert np.ptp(tilts) > 10.0


def test_too_many_boards_are_refused(stand):
    with pytest.raises(ValueError, match="fit into both"):
        board_poses(stand, Checkerboard(20, 14), 3)


def test_refinement_of_corners_leads_to_the_true_ones(stand, board, poses):
    errors, soft = [], board._replace(edge=1.0)
    for camera, seen in ((stand.rig.left, poses[0]), (stand.rig.right, in_right_frame(stand.rig, poses[1]))):
        image = add_noise_and_round(render_board(camera, seen, soft, LOOK), 0.0, [1])
        truth = image_of(camera, seen, board_corners(board)).reshape(-1, 1, 2)
        until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 50, 1e-4)
        found = cv2.cornerSubPix(image, np.float32(truth + np.array([0.6, -0.4])), (5, 5), (-1, -1), until)
        errors.append(found - truth)
    assert np.abs(np.mean(errors, axis=(0, 1, 2))).max() < 0.005
    assert np.linalg.norm(errors, axis=-1).max() < 0.05


@pytest.mark.parametrize("squares", [(9, 7), (8, 8), (10, 7)])
def test_every_square_has_its_colour_in_the_photograph(stand, squares):
    board = Checkerboard(*squares, square=10.0, edge=0.3)
    pose = board_poses(stand, board, 1, depth=(0.0, 40.0))[0]
    image = render_board(stand.rig.left, pose, board, LOOK._replace(light=(0.0, 0.0)))
    x, y = np.meshgrid(np.arange(squares[0]), np.arange(squares[1]))
    middles = np.rint(image_of(stand.rig.left, pose, 10.0 * np.stack([x, y], axis=-1) + 5.0)).astype(int)
    expected = np.where((x + y) % 2 == 0, LOOK.ink, LOOK.paper)
    assert image[middles[..., 1], middles[..., 0]] == pytest.approx(expected, abs=1e-9)


def test_the_cameras_look_at_one_place(stand):
    for camera, pose in (
        (stand.rig.left, stand.translation),
        (stand.rig.right, stand.rig.rotation @ stand.translation + stand.rig.translation),
    ):
        aim = camera.matrix @ (pose / pose[2])
        assert np.abs(aim[:2] - np.array(SIZE) / 2.0).max() < 20.0
    assert np.linalg.norm(stand.rig.translation) == pytest.approx(100.0, abs=1.0)
    assert rotation_angle_deg(stand.rig.rotation) == pytest.approx(2.0 * np.degrees(np.arctan(50.0 / 400.0)), abs=0.5)
