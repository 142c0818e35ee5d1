"""A plate that turns rigidly by 15°, 30° and 45° about the horizontal."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, rectangle, turned


def _place(material: np.ndarray, load: float) -> np.ndarray:
    flat = np.concatenate([material, np.zeros_like(material[..., :1])], axis=-1)
    return turned(flat, (np.radians(load), 0.0, 0.0))


SCENE = Scene((0.0, 15.0, 30.0, 45.0), (Part(_place, bounds(36.0, 28.0)),), rectangle(-36.0, -28.0, 36.0, 28.0))
