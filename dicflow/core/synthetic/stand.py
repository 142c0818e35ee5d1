"""The stand of an experiment: two cameras aimed at one place, and poses of boards in front of them."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.cameras.camera import Camera, Rig, camera_matrix, rotation_matrix
from dicflow.core.synthetic.checkerboard import Checkerboard, board_corners, board_outline
from dicflow.core.synthetic.deformation import Deformation, moved_rigidly
from dicflow.core.synthetic.trace import image_of

__all__ = ["Stand", "board_poses", "in_right_frame", "verged_stand"]


_CANDIDATES = 4000
_ROUNDS = 8
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
    """Two cameras of one type on a bar, aimed at one place, with small manufacturing and mounting errors.

    size : (width, height) of the photographs [px]
    field : height of the field of view at that place [mm]
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


def in_right_frame(rig: Rig, deformation: Deformation) -> Deformation:
    """A state in the right camera's frame, given in the left one's."""
    return moved_rigidly(deformation, rig.rotation, rig.translation)


def board_poses(
    stand: Stand, board: Checkerboard, count: int, depth: tuple[float, float] = (0.0, 200.0), seed: int = 0
) -> list[Deformation]:
    """Poses of the board, in the left camera's frame, at which it is wholly inside both photographs.

    Of many random poses (tilted by up to 30° each way, the long side along the photographs' height) those are selected
    one by one whose corners cover the parts of the photographs that the others leave free.

    depth : least and greatest distance behind the place aimed at [mm]
    Raises ValueError where fewer than ``count`` fit.
    """
    rng = np.random.default_rng([seed, 0xB0A2D])
    outline = board_outline(board)
    fitting: list[Deformation] = []
    for _ in range(_ROUNDS):
        fitting += [pose for pose in _random_poses(stand, outline, depth, rng) if _visible(stand.rig, pose, outline)]
        if len(fitting) >= count:
            break
    else:
        tried = _ROUNDS * _CANDIDATES
        raise ValueError(f"only {len(fitting)} of {tried} random poses fit into both photographs, expected {count}")
    covered = np.array([_cells_covered(stand.rig, pose, board) for pose in fitting], dtype=float)
    return [fitting[i] for i in _evenly_covering(covered, count)]


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
        poses.append(moved_rigidly(pose, stand.rotation, stand.translation))
    return poses


def _visible(rig: Rig, pose: Deformation, outline: Array) -> bool:
    """Whether the whole board is inside both photographs."""
    views = ((rig.left, pose), (rig.right, in_right_frame(rig, pose)))
    return all(_inside(camera, image_of(camera, seen, outline)) for camera, seen in views)


def _inside(camera: Camera, pixels: Array) -> bool:
    return bool(np.all((pixels > _BORDER_PX) & (pixels < np.array(camera.size) - 1 - _BORDER_PX)))


def _cells_covered(rig: Rig, pose: Deformation, board: Checkerboard) -> Mask:
    """Which cells of a coarse grid over both photographs the inner corners of the board enclose: (cells,)."""
    corners = board_corners(board)
    frame = corners[[0, 0, -1, -1], [0, -1, -1, 0]]
    masks = []
    for camera, seen in ((rig.left, pose), (rig.right, in_right_frame(rig, pose))):
        cells = image_of(camera, seen, frame) / camera.size * _GRID
        mask = np.zeros(_GRID[::-1], dtype=np.uint8)
        masks.append(cv2.fillConvexPoly(mask, np.floor(cells).astype(np.int32), 1).ravel() > 0)
    return np.concatenate(masks)


def _evenly_covering(covered: Array, count: int) -> list[int]:
    """Indices of ``count`` boards, chosen one by one to cover cells that few of those chosen before cover.

    covered : (board, cell)
    """
    chosen: list[int] = []
    times = np.zeros(covered.shape[1])
    while len(chosen) < count:
        gain = covered @ (1.0 + times) ** -2.0 / np.sqrt(covered.sum(axis=1))
        gain[chosen] = -1.0
        chosen.append(int(np.argmax(gain)))
        times += covered[chosen[-1]]
    return chosen
