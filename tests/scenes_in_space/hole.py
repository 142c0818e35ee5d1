"""A plate with a hole whose diameter grows from 5 to 6.1 mm; areas keep."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, circle, rectangle

_RADIUS, _WIDER = 2.5, 3.05


def _place(material: np.ndarray, load: float) -> np.ndarray:
    square = np.maximum((material**2).sum(axis=-1, keepdims=True), 1.0)
    growth = np.sqrt(1.0 + load * (_WIDER**2 - _RADIUS**2) / square)
    height = -0.15 * load * np.exp(-square / 40.0)
    return np.concatenate([material * growth + 0.4 * load, height], axis=-1)


def _beside_hole(material: np.ndarray) -> np.ndarray:
    return (material**2).sum(axis=-1) >= _RADIUS**2


SCENE = Scene(
    (0.0, 0.25, 0.5, 1.0),
    (Part(_place, bounds(25.0, 25.0), _beside_hole),),
    rectangle(-25.0, -25.0, 25.0, 25.0),
    holes=(circle(_RADIUS),),
)
