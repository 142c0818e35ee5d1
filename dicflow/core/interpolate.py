"""Grey values between pixels: cubic convolution (Keys 1981), exact for quadratic grey levels.

Four pixels per direction. Linear interpolation blurs and biases sub-pixel matching far more, and the fixed-point tables
of image libraries round a place to 1/32 px; here the place is taken as it is given.
"""

from __future__ import annotations

from typing import Any

import numba
import numpy as np
from numpy.typing import NDArray

__all__ = ["cubic", "cubic_slopes", "cubic_weights"]


@numba.njit(cache=True, nogil=True, inline="always")
def cubic_weights(t: float) -> tuple[float, float, float, float]:
    """Weights of the pixels at −1, 0, 1, 2 for the place t, 0 ≤ t < 1."""
    return (
        ((-0.5 * t + 1.0) * t - 0.5) * t,
        (1.5 * t - 2.5) * t * t + 1.0,
        ((-1.5 * t + 2.0) * t + 0.5) * t,
        (0.5 * t - 0.5) * t * t,
    )


@numba.njit(cache=True, nogil=True, inline="always")
def cubic_slopes(t: float) -> tuple[float, float, float, float]:
    """Derivatives of :func:`cubic_weights` by t [1/px]."""
    return (
        (-1.5 * t + 2.0) * t - 0.5,
        (4.5 * t - 5.0) * t,
        (-4.5 * t + 4.0) * t + 0.5,
        (1.5 * t - 1.0) * t,
    )


@numba.njit(cache=True, nogil=True)
def cubic(image: NDArray[Any], x: float, y: float) -> float:
    """Grey value of an image (rows, cols) at (x, y); NaN outside the outermost pixel centres.

    Beyond the border the outermost pixels are repeated.
    """
    rows, cols = image.shape
    if not (0.0 <= x <= cols - 1.0 and 0.0 <= y <= rows - 1.0):
        return np.nan
    left, top = int(x), int(y)
    across, down = cubic_weights(x - left), cubic_weights(y - top)
    value = 0.0
    if 1 <= left < cols - 2 and 1 <= top < rows - 2:
        for j in range(4):
            row = image[top + j - 1]
            value += down[j] * (
                across[0] * row[left - 1]
                + across[1] * row[left]
                + across[2] * row[left + 1]
                + across[3] * row[left + 2]
            )
        return value
    for j in range(4):
        row = image[min(max(top + j - 1, 0), rows - 1)]
        for i in range(4):
            value += down[j] * across[i] * row[min(max(left + i - 1, 0), cols - 1)]
    return value
