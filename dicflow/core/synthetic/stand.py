"""The stand of an experiment: two cameras that look at one place, and where boards are held before them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.cameras.camera import Camera, Rig, camera_matrix, rotation_matrix
from dicflow.core.synthetic.checkerboard import Checkerboard, board_corners, board_outline
from dicflow.core.synthetic.deformation import Deformation, carried
from dicflow.core.synthetic.trace import image_of

__all__ = ["Stand", "board_poses", "seen_from_right", "verged_stand"]


_CANDIDATES = 4000
_TILT_DEG = 30.0
_ROLL_DEG = 14.0
_BORDER_PX = 8.0
_GRID = (36, 48)


class Stand(NamedTuple):
    """A rig and the place it is aimed at.

    The frame of the place has X along the baseline, Y down and Z away from the cameras; a point p in it is
    rotation @ p + translation in the left camera's frame.
    """

    rig: Rig
    rotation: Array
    translation: Array


def verged_stand(size: tuple[int, int], field: float, standoff: float = 400.0, baseline: float = 100.0) -> Stand:
    """Two cheap cameras on a bar, turned towards one place; alike as two of a kind are, and mounted as by hand.

    size : (width, height) of the photographs [px]
    field : height that a photograph shows at the place aimed at [mm]
    standoff : distance of the bar from there [mm]
    baseline : distance of the cameras [mm]
    """
    width, height = size
    focal = height / field * np.hypot(standoff, baseline / 2.0)
    centre = np.array([(width - 1) / 2.0, (height - 1) / 2.0])
    offset = height / 1920.0 * np.array([[6.3, -4.8], [-7.1, 5.6]])
    left = Camera(camera_matrix(focal, centre + offset[0]), np.array([-0.11, 0.16, 4e-4, -3e-4, 0.0]), size)
    right = Camera(camera_matrix(0.996 * focal, centre + offset[1]), np.array([-0.12, 0.19, -2e-4, 5e-4, 0.0]), size)
    verge = np.arctan2(baseline / 2.0, standoff)
    turn_left, turn_right = rotation_matrix([0.0, -verge, 0.0]), rotation_matrix([0.003, verge, 0.005])
    at_left = np.array([-baseline / 2.0, 0.0, -standoff])
    at_right = np.array([baseline / 2.0, 0.6, -standoff - 0.9])
    rotation = turn_right @ turn_left.T
    rig = Rig(left, right, rotation, turn_right @ (at_left - at_right))
    return Stand(rig, turn_left, -turn_left @ at_left)


def seen_from_right(rig: Rig, deformation: Deformation) -> Deformation:
    """A state given in the left camera's frame, in the right one's."""
    return carried(deformation, rig.rotation, rig.translation)


def board_poses(
    stand: Stand, board: Checkerboard, count: int, depth: tuple[float, float] = (0.0, 200.0), seed: int = 0
) -> list[Deformation]:
    """Places of the board, in the left camera's frame, at which it is wholly inside both photographs.

    Of many random ones (tilted by up to 30° each way, its long side along the photographs' height) those are taken
    whose corners cover what the others leave, so that they spread over the frame.

    depth : least and greatest distance behind the place aimed at [mm]
    Raises ValueError where fewer than ``count`` fit.
    """
    rng = np.random.default_rng([seed, 0xB0A2D])
    outline = board_outline(board)
    fitting = [pose for pose in _random_poses(stand, outline, depth, rng) if _visible(stand.rig, pose, outline)]
    if len(fitting) < count:
        raise ValueError(f"only {len(fitting)} of {_CANDIDATES} random boards fit into both photographs")
    covered = np.array([_cells_covered(stand.rig, pose, board) for pose in fitting], dtype=float)
    return [fitting[i] for i in _spread(covered, count)]


def _random_poses(
    stand: Stand, outline: Array, depth: tuple[float, float], rng: np.random.Generator
) -> list[Deformation]:
    middle = np.append(outline.mean(axis=0), 0.0)
    upright = rotation_matrix([0.0, 0.0, np.pi / 2.0])
    poses = []
    for _ in range(_CANDIDATES):
        tilt = np.radians(rng.uniform(-1.0, 1.0, 3) * [_TILT_DEG, _TILT_DEG, _ROLL_DEG])
        rotation = rotation_matrix([tilt[0], tilt[1], 0.0]) @ rotation_matrix([0.0, 0.0, tilt[2]]) @ upright
        place = np.append(rng.uniform(-45.0, 45.0, 2), rng.uniform(*depth))
        pose = Deformation(1.0, 1.0, rotation=rotation, translation=place - rotation @ middle)
        poses.append(carried(pose, stand.rotation, stand.translation))
    return poses


def _visible(rig: Rig, pose: Deformation, outline: Array) -> bool:
    """Whether the whole board is inside both photographs."""
    views = ((rig.left, pose), (rig.right, seen_from_right(rig, pose)))
    return all(_inside(camera, image_of(camera, seen, outline)) for camera, seen in views)


def _inside(camera: Camera, pixels: Array) -> bool:
    return bool(np.all((pixels > _BORDER_PX) & (pixels < np.array(camera.size) - 1 - _BORDER_PX)))


def _cells_covered(rig: Rig, pose: Deformation, board: Checkerboard) -> Mask:
    """Which cells of a coarse grid over both photographs lie between the inner corners of the board, flat."""
    corners = board_corners(board)
    frame = corners[[0, 0, -1, -1], [0, -1, -1, 0]]
    masks = []
    for camera, seen in ((rig.left, pose), (rig.right, seen_from_right(rig, pose))):
        cells = image_of(camera, seen, frame) / camera.size * _GRID
        mask = np.zeros(_GRID[::-1], dtype=np.uint8)
        masks.append(cv2.fillConvexPoly(mask, np.floor(cells).astype(np.int32), 1).ravel() > 0)
    return np.concatenate(masks)


def _spread(covered: Array, count: int) -> list[int]:
    """Indices of boards chosen one by one for covering cells (board, cell) that few chosen before them cover."""
    chosen: list[int] = []
    times = np.zeros(covered.shape[1])
    while len(chosen) < count:
        gain = covered @ (1.0 + times) ** -2.0 / np.sqrt(covered.sum(axis=1))
        gain[chosen] = -1.0
        chosen.append(int(np.argmax(gain)))
        times += covered[chosen[-1]]
    return chosen
