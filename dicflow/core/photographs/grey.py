"""Grey levels of any depth as the 8 bit that detectors and matchers take."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["to_8bit"]

_USED_PERCENT = (0.1, 99.9)


def to_8bit(image: NDArray[Any]) -> NDArray[np.uint8]:
    """The image as contiguous uint8; deeper ones are stretched over the grey levels that they use.

    image : (rows, cols) uint8 or uint16
    """
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    low, high = np.percentile(image, _USED_PERCENT)
    stretched = (image - low) * (255.0 / max(high - low, 1.0))
    return np.asarray(np.clip(np.round(stretched), 0, 255), dtype=np.uint8)
