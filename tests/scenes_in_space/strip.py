"""A strip pulled between grips, which hinder its contraction, to a stretch of 2.19; the photographs are JPEG files."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, rectangle

_HALF_WIDTH, _HALF_LENGTH, _GRIP_MM = 10.0, 15.0, 5.0
_REACH_MM = 6.0
"""Distance from a grip over which its hindrance fades."""
_STEPS = 8


def _place(material: np.ndarray, load: float) -> np.ndarray:
    x, y = material[..., 0], material[..., 1]
    free = np.prod([1.0 - np.exp(-(((_HALF_LENGTH + sign * y) / _REACH_MM) ** 2)) for sign in (-1, 1)], axis=0)
    narrow = 1.0 - (1.0 - load**-0.5) * free
    height = 0.8 * (1.0 - narrow) + 0.3 * np.log(load) * (x * narrow / _HALF_WIDTH) ** 2
    return np.stack([x * narrow + 0.2 * np.log(load), load * y, height], axis=-1)


def _grip(sign: int) -> Part:
    def place(material: np.ndarray, load: float) -> np.ndarray:
        x, y = material[..., 0], material[..., 1]
        return np.stack([x + 0.2 * np.log(load), y + sign * (load - 1.0) * _HALF_LENGTH, 0.0 * x - 1.0], axis=-1)

    ends = sorted([sign * _HALF_LENGTH, sign * (_HALF_LENGTH + _GRIP_MM)])
    return Part(place, (-_HALF_WIDTH - 4.0, ends[0], _HALF_WIDTH + 4.0, ends[1]), grey=110.0)


SCENE = Scene(
    tuple(2.19 ** (step / _STEPS) for step in range(_STEPS + 1)),
    (Part(_place, bounds(_HALF_WIDTH, _HALF_LENGTH)), _grip(-1), _grip(1)),
    rectangle(-_HALF_WIDTH, -_HALF_LENGTH, _HALF_WIDTH, _HALF_LENGTH),
    gauges={
        "the long extensometer": np.array([[0.0, -10.0], [0.0, 10.0]]),
        "the short extensometer": np.array([[3.0, -4.0], [2.0, 5.0]]),
    },
    reported=(_STEPS // 2, _STEPS),
    speckle=0.45,
    jpeg=92,
)
