"""A plate that slides and stretches behind the head of a bolt, 3 mm above it, that stands still."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, rectangle

_HEAD_MM = 5.0


def _plate(material: np.ndarray, load: float) -> np.ndarray:
    x, y = material[..., 0], material[..., 1]
    return np.stack([(1.0 + 0.02 * load) * x + 3.0 * load, (1.0 - 0.01 * load) * y, 0.5 * load + 0.0 * x], axis=-1)


def _head(material: np.ndarray, load: float) -> np.ndarray:
    return np.concatenate([material, np.full_like(material[..., :1], -3.0)], axis=-1)


def _is_round(material: np.ndarray) -> np.ndarray:
    return (material**2).sum(axis=-1) <= _HEAD_MM**2


SCENE = Scene(
    (0.0, 0.3, 1.0),
    (Part(_plate, bounds(33.0, 28.0)), Part(_head, bounds(_HEAD_MM, _HEAD_MM), _is_round, grey=95.0)),
    rectangle(-33.0, -28.0, 33.0, 28.0),
)
