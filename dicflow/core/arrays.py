"""Types of arrays by what they hold, and which elements are finite; docstrings give shapes, units and frames."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["Array", "Bytes", "Codes", "Counts", "Grey", "Image", "Index", "Iterations", "Mask", "all_finite"]

Array = NDArray[np.float64]
"""Numbers in double precision."""
Image = NDArray[np.float32]
"""Numbers in single precision, one for each pixel: grey levels, their derivatives, weights, offsets."""
Grey = NDArray[Any]
"""Grey levels as a file holds them: uint8 or uint16."""
Bytes = NDArray[np.uint8]
"""Grey levels of 8 bits."""
Mask = NDArray[np.bool_]
"""True or False for each element."""
Codes = NDArray[np.uint8]
"""Codes of an enumeration, such as a status."""
Index = NDArray[np.int64]
"""Indices into the axes of another array, such as rows, columns and whole pixels."""
Counts = NDArray[np.int32]
"""Counts of pixels, or numbers of connected parts."""
Iterations = NDArray[np.int16]
"""Numbers of iterations."""


def all_finite(values: Array | Image, axes: int = 1) -> Mask:
    """Whether all numbers along the last axes are finite, as the coordinates of a place: (...) of (..., n) for one.

    Their sum tells it, ten times faster than a reduction over short axes; so it must not exceed the largest number.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        total = sum(values[(..., *index)] for index in np.ndindex(*values.shape[values.ndim - axes :]))
    return np.asarray(np.isfinite(total), dtype=np.bool_)
