"""A band 4 mm wide in which all of the shear of a plate happens, 0.4 at its middle."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, rectangle

_HALF_MM, _SHEAR, _INCLINATION = 2.0, 0.4, 0.4


def _place(material: np.ndarray, load: float) -> np.ndarray:
    x, y = material[..., 0], material[..., 1]
    across = y * np.cos(_INCLINATION) - x * np.sin(_INCLINATION)
    slip = load * _SHEAR * _HALF_MM * np.tanh(across / _HALF_MM)
    return np.stack([x + slip * np.cos(_INCLINATION), y + slip * np.sin(_INCLINATION), 0.2 * load + 0.0 * x], axis=-1)


SCENE = Scene((0.0, 0.25, 0.5, 1.0), (Part(_place, bounds(32.0, 26.0)),), rectangle(-32.0, -26.0, 32.0, 26.0))
