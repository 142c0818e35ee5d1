"""A strip twisted by 70° over its length, between ends inclined by 35° to either side."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, rectangle

_HALF_WIDTH, _HALF_LENGTH = 15.0, 29.0


def _place(material: np.ndarray, load: float) -> np.ndarray:
    x, y = material[..., 0], material[..., 1]
    angle = np.radians(35.0) * load * y / _HALF_LENGTH
    return np.stack([x * np.cos(angle), (1.0 - 0.01 * load) * y, x * np.sin(angle)], axis=-1)


SCENE = Scene(
    (0.0, 0.25, 0.5, 0.75, 1.0),
    (Part(_place, bounds(_HALF_WIDTH, _HALF_LENGTH)),),
    rectangle(-_HALF_WIDTH, -_HALF_LENGTH, _HALF_WIDTH, _HALF_LENGTH),
    reported=(2, 4),
)
