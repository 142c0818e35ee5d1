"""Two cracks that meet: a third of a plate moves up, a quarter turns away to the left, the rest stays."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Place, Scene, bounds, rectangle, turned

_HALF_WIDTH, _HALF_HEIGHT = 34.0, 28.0
_MEETING_X, _CRACK_Y, _SLOPE = -4.0, -8.0, 0.35
"""Where the second crack leaves the first one, the height of the first, and the inclination of the second [mm]."""


def _moving(shift: tuple[float, float, float], turn: tuple[float, float, float]) -> Place:
    def place(material: np.ndarray, load: float) -> np.ndarray:
        flat = np.concatenate([material * (1.0 + 0.005 * load), np.zeros_like(material[..., :1])], axis=-1)
        return turned(flat, tuple(load * angle for angle in turn)) + load * np.array(shift)

    return place


def _is_above(material: np.ndarray) -> np.ndarray:
    return material[..., 1] < _CRACK_Y


def _is_left(material: np.ndarray) -> np.ndarray:
    return material[..., 0] < _MEETING_X + _SLOPE * (material[..., 1] - _CRACK_Y)


SCENE = Scene(
    (0.0, 0.15, 1.0),
    (
        Part(_moving((0.5, -1.2, 0.0), (0.0, 0.0, 0.01)), bounds(_HALF_WIDTH, _HALF_HEIGHT), _is_above),
        Part(
            _moving((-1.0, 0.3, 0.4), (0.0, 0.01, -0.02)),
            bounds(_HALF_WIDTH, _HALF_HEIGHT),
            lambda material: ~_is_above(material) & _is_left(material),
        ),
        Part(
            _moving((0.3, 0.2, 0.0), (0.0, 0.0, 0.0)),
            bounds(_HALF_WIDTH, _HALF_HEIGHT),
            lambda material: ~_is_above(material) & ~_is_left(material),
        ),
    ),
    rectangle(-_HALF_WIDTH, -_HALF_HEIGHT, _HALF_WIDTH, _HALF_HEIGHT),
    cracks=(
        np.array([[-_HALF_WIDTH, _CRACK_Y], [_HALF_WIDTH, _CRACK_Y]]),
        np.array([[_MEETING_X, _CRACK_Y], [_MEETING_X + _SLOPE * (_HALF_HEIGHT - _CRACK_Y), _HALF_HEIGHT]]),
    ),
)
