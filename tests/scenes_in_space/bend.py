"""A sheet bent without strain around a vertical axis, to a radius of 28 mm, when its edges are inclined by 45°."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, rectangle

_RADIUS_MM = 28.0
_HALF_WIDTH = _RADIUS_MM * np.pi / 4.0


def _place(material: np.ndarray, load: float) -> np.ndarray:
    x, y = material[..., 0], material[..., 1]
    curvature = load / _RADIUS_MM
    half = 0.5 * curvature * x
    return np.stack([x * np.sinc(curvature * x / np.pi), y, x * np.sin(half) * np.sinc(half / np.pi)], axis=-1)


SCENE = Scene(
    (0.0, 1.0 / 3.0, 2.0 / 3.0, 1.0),
    (Part(_place, bounds(_HALF_WIDTH, 28.0)),),
    rectangle(-_HALF_WIDTH, -28.0, _HALF_WIDTH, 28.0),
)
