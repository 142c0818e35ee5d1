"""A block compressed to a quarter of its height in eight steps; it bulges at its sides."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, rectangle

_HALF_WIDTH, _HALF_HEIGHT, _STEPS = 20.0, 30.0, 8


def _place(material: np.ndarray, load: float) -> np.ndarray:
    x, y = material[..., 0], material[..., 1]
    barrel = 1.0 + (load**-0.4 - 1.0) * (1.0 - 0.4 * (y / _HALF_HEIGHT) ** 2)
    height = 1.5 * np.log(load) * np.cos(0.9 * y / _HALF_HEIGHT) * np.cos(0.9 * x / _HALF_WIDTH)
    return np.stack([x * barrel, load * y, height], axis=-1)


SCENE = Scene(
    tuple(0.25 ** (step / _STEPS) for step in range(_STEPS + 1)),
    (Part(_place, bounds(_HALF_WIDTH, _HALF_HEIGHT)),),
    rectangle(-_HALF_WIDTH, -_HALF_HEIGHT, _HALF_WIDTH, _HALF_HEIGHT),
    reported=(_STEPS // 2, _STEPS),
    speckle=0.8,
)
