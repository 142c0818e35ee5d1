"""A slightly curved sheet that stretches, shears and turns a little: affine subsets suffice."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space.specimen import Part, Scene, bounds, rectangle, turned


def _place(material: np.ndarray, load: float) -> np.ndarray:
    x, y = material[..., 0], material[..., 1]
    stretched = np.stack([(1.0 - 0.3 * load) * x + 0.2 * load * y, (1.0 + load) * y, 1e-3 * x * x], axis=-1)
    return turned(stretched, (load, 2.0 * load, load)) + 20.0 * load * np.array([1.0, -0.6, 1.5])


SCENE = Scene((0.0, 0.01, 0.02), (Part(_place, bounds(36.0, 28.0)),), rectangle(-36.0, -28.0, 36.0, 28.0))
