"""Two cameras with mild distortion, 25° apart, that see 90 mm of the specimen; projection by a formula of its own."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.cameras.camera import Camera, Rig
from tests.scenes_in_space.specimen import turned

__all__ = ["FIELD_MM", "LEFT", "MM_PX", "RIG", "RIGHT", "SIZE", "View", "project"]

SIZE = (1000, 800)
FIELD_MM = 90.0
MM_PX = FIELD_MM / SIZE[0]
_DISTANCE_MM = 420.0
_HALF_ANGLE = np.radians(12.5)


class View(NamedTuple):
    """A camera and its pose: p in the frame of a scene is rotation @ p + translation in that of the camera."""

    camera: Camera
    rotation: np.ndarray
    translation: np.ndarray


def _view(turn: tuple[float, float, float], focal: float, centre: tuple[float, float], lens: list[float]) -> View:
    matrix = np.array([[focal, 0.0, centre[0]], [0.0, focal, centre[1]], [0.0, 0.0, 1.0]])
    rotation = turned(np.eye(3), turn).T
    return View(Camera(matrix, np.array(lens), SIZE), rotation, np.array([0.0, 0.0, _DISTANCE_MM]))


_FOCAL = SIZE[0] / FIELD_MM * _DISTANCE_MM
LEFT = _view((0.002, -_HALF_ANGLE, -0.004), _FOCAL, (503.7, 396.2), [-0.11, 0.16, 4e-4, -3e-4, 0.0])
RIGHT = _view((-0.003, _HALF_ANGLE, 0.005), 0.996 * _FOCAL, (495.4, 402.9), [-0.12, 0.19, -2e-4, 5e-4, 0.0])
_TURN = RIGHT.rotation @ LEFT.rotation.T
RIG = Rig(LEFT.camera, RIGHT.camera, _TURN, RIGHT.translation - _TURN @ LEFT.translation)


def project(view: View, points: np.ndarray) -> np.ndarray:
    """Pixels (..., 2) of places (..., 3) in the frame of a scene [mm], by Brown's formula."""
    seen = points @ view.rotation.T + view.translation
    x, y = seen[..., 0] / seen[..., 2], seen[..., 1] / seen[..., 2]
    k1, k2, p1, p2, k3 = view.camera.distortion
    square = x * x + y * y
    radial = 1.0 + square * (k1 + square * (k2 + square * k3))
    bent_x = x * radial + 2.0 * p1 * x * y + p2 * (square + 2.0 * x * x)
    bent_y = y * radial + p1 * (square + 2.0 * y * y) + 2.0 * p2 * x * y
    matrix = view.camera.matrix
    return np.stack([matrix[0, 0] * bent_x + matrix[0, 2], matrix[1, 1] * bent_y + matrix[1, 2]], axis=-1)
