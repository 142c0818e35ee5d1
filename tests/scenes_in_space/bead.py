"""A bead pressed into a sheet: a ridge 2.4 mm high with a radius of 5 mm at its crest, into which material is drawn."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, rectangle

_HEIGHT_MM, _HALF_MM, _INCLINATION = 2.4, 3.5, 0.3


def _place(material: np.ndarray, load: float) -> np.ndarray:
    x, y = material[..., 0], material[..., 1]
    across = (x * np.cos(_INCLINATION) + y * np.sin(_INCLINATION)) / _HALF_MM
    drawn = -0.1 * load * np.tanh(across) * _HALF_MM
    height = -load * _HEIGHT_MM * np.exp(-0.5 * across**2)
    return np.stack([x + drawn * np.cos(_INCLINATION), y + drawn * np.sin(_INCLINATION), height], axis=-1)


SCENE = Scene((0.0, 0.3, 0.65, 1.0), (Part(_place, bounds(30.0, 26.0)),), rectangle(-30.0, -26.0, 30.0, 26.0))
