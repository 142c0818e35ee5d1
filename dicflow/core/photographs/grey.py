"""Photographs as detectors and matchers need them: in 8 bits, and with fewer pixels."""

from __future__ import annotations

import cv2
import numpy as np

from dicflow.core.arrays import Bytes, Grey

__all__ = ["reduced", "scale_for", "to_8bit"]

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


def scale_for(image: Grey, pixels: int) -> float:
    """Scale at which an image (rows, cols) has so many pixels at most [-]."""
    return min(1.0, float(np.sqrt(pixels / image.size)))


def reduced(grey: Bytes, scale: float) -> Bytes:
    """Grey levels (rows, cols) at a scale, each the mean of those it covers; unchanged at a scale of 1 or more."""
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1.0 else grey
    return np.asarray(small, dtype=np.uint8)
