"""A crack of 30 mm inside a plate, both tips in view, which opens by one pixel, then by three (Griffith's field)."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Place, Scene, bounds, rectangle

_HALF_WIDTH, _HALF_HEIGHT = 34.0, 28.0
_HALF_MM, _ANGLE, _KAPPA, _BLUNT_MM = 15.0, -0.2, 2.08, 0.3
_LOAD = 0.09 / (_KAPPA + 1.0) / _HALF_MM
_AXES = np.array([[np.cos(_ANGLE), np.sin(_ANGLE)], [-np.sin(_ANGLE), np.cos(_ANGLE)]])


def _side(sign: int) -> Place:
    def place(material: np.ndarray, load: float) -> np.ndarray:
        x, y = np.moveaxis(material @ _AXES.T, -1, 0)
        z = x + 1j * y
        root = np.sqrt(z - _HALF_MM) * np.sqrt(z + _HALF_MM)
        between = np.abs(x) < _HALF_MM
        root = np.where(between, sign * 1j * np.sqrt(_HALF_MM**2 - z * z), root)
        stress, blunt = z * root.conj(), root.real**2 + root.imag**2 + _BLUNT_MM**2
        along = 0.5 * (_KAPPA - 1.0) * root.real - y * stress.imag / blunt
        across = 0.5 * (_KAPPA + 1.0) * root.imag - y * stress.real / blunt
        moved = material + load * _LOAD * np.stack([along, across], axis=-1) @ _AXES
        return np.concatenate([moved, np.full_like(moved[..., :1], 0.1 * load)], axis=-1)

    return place


def _is_above(material: np.ndarray) -> np.ndarray:
    return (material @ _AXES[1]) >= 0.0


SCENE = Scene(
    (0.0, 1.0, 3.0),
    (
        Part(_side(1), bounds(_HALF_WIDTH, _HALF_HEIGHT), _is_above),
        Part(_side(-1), bounds(_HALF_WIDTH, _HALF_HEIGHT), lambda material: ~_is_above(material)),
    ),
    rectangle(-_HALF_WIDTH, -_HALF_HEIGHT, _HALF_WIDTH, _HALF_HEIGHT),
    cracks=(_HALF_MM * np.stack([-_AXES[0], _AXES[0]]),),
)
