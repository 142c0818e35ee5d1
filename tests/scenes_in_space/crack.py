"""A crack from the left edge to the middle of a plate, which opens by 0.2 mm, about two pixels, and then by 3 mm."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Place, Scene, rectangle

_TIP_MM, _HALF_WIDTH, _HALF_HEIGHT = 10.0, 34.0, 28.0


def _side(sign: int) -> Place:
    def place(material: np.ndarray, load: float) -> np.ndarray:
        x, y = material[..., 0], material[..., 1]
        before_tip = np.maximum(_TIP_MM - x, 0.0) / (_TIP_MM + _HALF_WIDTH)
        opening = 0.5 * load * before_tip**2 * np.exp(-sign * y / 40.0)
        return np.stack([x + 0.02 * load * y, y + sign * opening + 0.002 * load * y, 0.1 * load + 0.0 * x], axis=-1)

    return place


SCENE = Scene(
    (0.0, 0.2, 3.0),
    (
        Part(_side(-1), (-_HALF_WIDTH, -_HALF_HEIGHT, _HALF_WIDTH, 0.0)),
        Part(_side(1), (-_HALF_WIDTH, 0.0, _HALF_WIDTH, _HALF_HEIGHT)),
    ),
    rectangle(-_HALF_WIDTH, -_HALF_HEIGHT, _HALF_WIDTH, _HALF_HEIGHT),
    cracks=(np.array([[-_HALF_WIDTH, 0.0], [_TIP_MM, 0.0]]),),
)
