"""Conversion of grey levels to the 8 bits that detectors and matchers need."""

from __future__ import annotations

import numpy as np

from dicflow.core.arrays import Bytes, Grey

__all__ = ["to_8bit"]

_STRETCHED_PERCENTILES = (0.1, 99.9)


def to_8bit(image: Grey) -> Bytes:
    """The image as contiguous uint8; of a 16-bit image the percentiles 0.1 … 99.9 are stretched to 0 … 255.

    image : (rows, cols) uint8 or uint16
    """
    if image.dtype == np.uint8:
        return np.ascontiguousarray(image)
    low, high = np.percentile(image, _STRETCHED_PERCENTILES)
    stretched = (image - low) * (255.0 / max(high - low, 1.0))
    return np.asarray(np.clip(np.round(stretched), 0, 255), dtype=np.uint8)
