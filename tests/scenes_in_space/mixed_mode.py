"""An oblique crack whose faces open, slide and tear by Williams' field: by about two pixels, then by twenty."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Place, Scene, bounds, rectangle

_HALF_WIDTH, _HALF_HEIGHT = 34.0, 28.0
_TIP, _ANGLE = np.array([6.0, -3.0]), 0.5
_KAPPA, _BLUNT_MM = 2.08, 0.3
_OPENING, _SLIDING, _TEARING = 0.0045, 0.003, 0.004
"""Factors of the root of the distance [mm^½]."""
_AXES = np.array([[np.cos(_ANGLE), np.sin(_ANGLE)], [-np.sin(_ANGLE), np.cos(_ANGLE)]])


def _side(sign: int) -> Place:
    def place(material: np.ndarray, load: float) -> np.ndarray:
        x, y = np.moveaxis((material - _TIP) @ _AXES.T, -1, 0)
        angle = np.angle((x + 1j * y) * np.exp(-0.5j * np.pi * sign)) + 0.5 * np.pi * sign
        root, sin, cos = load * (x * x + y * y + _BLUNT_MM**2) ** 0.25, np.sin(0.5 * angle), np.cos(0.5 * angle)
        along = _OPENING * cos * (_KAPPA - 1.0 + 2.0 * sin**2) + _SLIDING * sin * (_KAPPA + 1.0 + 2.0 * cos**2)
        across = _OPENING * sin * (_KAPPA + 1.0 - 2.0 * cos**2) - _SLIDING * cos * (_KAPPA - 1.0 - 2.0 * sin**2)
        moved = material + np.stack([root * along, root * across], axis=-1) @ _AXES
        return np.concatenate([moved, (root * _TEARING * sin + 0.05 * load)[..., None]], axis=-1)

    return place


def _is_above(material: np.ndarray) -> np.ndarray:
    return ((material - _TIP) @ _AXES[1]) >= 0.0


SCENE = Scene(
    (0.0, 1.0, 10.0),
    (
        Part(_side(1), bounds(_HALF_WIDTH, _HALF_HEIGHT), _is_above),
        Part(_side(-1), bounds(_HALF_WIDTH, _HALF_HEIGHT), lambda material: ~_is_above(material)),
    ),
    rectangle(-_HALF_WIDTH, -_HALF_HEIGHT, _HALF_WIDTH, _HALF_HEIGHT),
    cracks=(np.stack([_TIP - 45.0 * _AXES[0], _TIP]),),
)
