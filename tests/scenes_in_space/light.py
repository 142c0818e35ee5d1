"""The gentle scene under changing light: dimmer, then brighter on one side, where it clips, with a moving glare."""

from __future__ import annotations

import numpy as np

from tests.scenes_in_space import gentle
from tests.scenes_in_space.cameras import SIZE

_CHANGES = ((1.0, 0.0, 0.0), (0.6, 0.3, 0.0), (1.35, 0.5, 90.0))
"""Mean light, its slope across the photograph, and the glare [grey levels] of each step."""
_GLARE_PX = 60.0


def _look(grey: np.ndarray, step: int, side: int) -> np.ndarray:
    mean, slope, glare = _CHANGES[step]
    width, height = SIZE
    x, y = np.arange(width), np.arange(height)[:, None]
    square = ((x - 0.35 * width + 40.0 * side) ** 2 + (y - 0.6 * height) ** 2) / _GLARE_PX**2
    return grey * (mean + slope * (x / width - 0.5)) + glare * np.exp(-square)


SCENE = gentle.SCENE._replace(look=_look)
