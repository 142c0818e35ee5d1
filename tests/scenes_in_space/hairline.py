"""A crack through a plate whose faces move apart by a third of a pixel, and then by one."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Place, Scene, bounds, rectangle

_HALF_WIDTH, _HALF_HEIGHT = 34.0, 28.0
_SLOPE, _JUMP_MM = 0.35, np.array([0.015, 0.026, 0.0])


def _side(sign: int) -> Place:
    def place(material: np.ndarray, load: float) -> np.ndarray:
        x, y = material[..., 0], material[..., 1]
        plate = np.stack([(1.0 + 0.001 * load) * x, (1.0 - 0.0005 * load) * y, 0.1 * load + 0.0 * x], axis=-1)
        return plate + 0.5 * sign * load * _JUMP_MM

    return place


def _is_above(material: np.ndarray) -> np.ndarray:
    return material[..., 1] >= _SLOPE * material[..., 0] + 3.0


SCENE = Scene(
    (0.0, 1.0, 3.0),
    (
        Part(_side(1), bounds(_HALF_WIDTH, _HALF_HEIGHT), _is_above),
        Part(_side(-1), bounds(_HALF_WIDTH, _HALF_HEIGHT), lambda material: ~_is_above(material)),
    ),
    rectangle(-_HALF_WIDTH, -_HALF_HEIGHT, _HALF_WIDTH, _HALF_HEIGHT),
    cracks=(np.array([[x, _SLOPE * x + 3.0] for x in (-_HALF_WIDTH, _HALF_WIDTH)]),),
)
