"""A sheet blown up to a dome of 12 mm, which stretches by 25 % in both directions at its pole."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, circle

_RADIUS = 27.0


def _place(material: np.ndarray, load: float) -> np.ndarray:
    share = (material**2).sum(axis=-1, keepdims=True) / _RADIUS**2
    stretched = material * (1.0 + 0.25 * load * (1.0 - share) ** 2)
    return np.concatenate([stretched, -12.0 * load * (1.0 - share)], axis=-1)


def _is_in_die(material: np.ndarray) -> np.ndarray:
    return (material**2).sum(axis=-1) <= _RADIUS**2


SCENE = Scene(
    (0.0, 0.25, 0.5, 0.75, 1.0),
    (Part(_place, bounds(_RADIUS, _RADIUS), _is_in_die),),
    circle(_RADIUS),
    reported=(2, 4),
)
