"""Autocorrelation of grey levels in a mask, by Fourier transforms."""

from __future__ import annotations

import cv2
import numpy as np

from dicflow.core.arrays import Array, Image

__all__ = ["autocorrelation", "overlap"]


def autocorrelation(values: Array | Image, reach: tuple[int, int]) -> Array:
    """Σ v(x) v(x + shift) over the pixels, for shifts up to so many pixels each way (row, col); no shift in the middle.

    values : (rows, cols); reach : (along rows, along columns) [px]
    """
    shape = [cv2.getOptimalDFTSize(size + far) for size, far in zip(values.shape, reach, strict=True)]
    padded = np.zeros(shape, dtype=values.dtype)
    padded[: values.shape[0], : values.shape[1]] = values
    spectrum = cv2.dft(padded, nonzeroRows=len(values))
    power = cv2.mulSpectrums(spectrum, spectrum, 0, conjB=True)
    whole = cv2.dft(power, flags=cv2.DFT_INVERSE | cv2.DFT_SCALE)
    return np.asarray(whole[np.ix_(*(np.arange(-far, far + 1) for far in reach))], dtype=np.float64)


def overlap(inside: Array | Image, reach: tuple[int, int]) -> Array:
    """The same of a mask (rows, cols) of ones and zeros: pixels that it and its copy at each shift have in common."""
    if not inside.all():
        return autocorrelation(inside, reach)
    rows, cols = (size - np.abs(np.arange(-far, far + 1.0)) for size, far in zip(inside.shape, reach, strict=True))
    return np.outer(rows, cols)
