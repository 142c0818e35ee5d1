"""The gentle scene, with later photographs out of focus: blurred by 1, 2, 3 and 4.5 px."""

from __future__ import annotations

import cv2
import numpy as np

from tests.scenes_in_space import gentle

_SIGMAS_PX = (0.0, 1.0, 2.0, 3.0, 4.5)


def _look(grey: np.ndarray, step: int, side: int) -> np.ndarray:
    sigma = _SIGMAS_PX[step]
    return cv2.GaussianBlur(grey, (0, 0), sigma) if sigma else grey


SCENE = gentle.SCENE._replace(loads=(0.0, 0.005, 0.01, 0.015, 0.02), look=_look)
