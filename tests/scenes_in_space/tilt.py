"""A plate that turns rigidly by 15°, 30° and 45° about the vertical, towards the left camera."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Place, Scene, bounds, rectangle, turned

__all__ = ["SCENE", "turning"]


def turning(x: float, y: float) -> Place:
    """Turns about an axis through the origin by the load [°]."""

    def place(material: np.ndarray, load: float) -> np.ndarray:
        flat = np.concatenate([material, np.zeros_like(material[..., :1])], axis=-1)
        return turned(flat, (np.radians(load) * x, np.radians(load) * y, 0.0))

    return place


SCENE = Scene(
    (0.0, 15.0, 30.0, 45.0), (Part(turning(0.0, 1.0), bounds(36.0, 28.0)),), rectangle(-36.0, -28.0, 36.0, 28.0)
)
