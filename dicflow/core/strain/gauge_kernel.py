"""The virtual strain gauge as a filter over the pixels of a photograph.

The place of a subset is a weighted mean over its pixels, and the slope in a window a weighted sum of places. So a
strain is Σ K(x) u(x) over the pixels of the gauge, and K, the subset's weights convolved with the window's, says all
that a setting does to small deformations: what it keeps of a wave, and which errors it shares with another setting.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from scipy.signal import fftconvolve

from dicflow.core.arrays import Array
from dicflow.core.strain.gauge import vsg_px
from dicflow.core.surfaces.filters import slope_weights
from dicflow.core.uncertainty.overlap import ShapeFunction, subset_weights

__all__ = ["GaugeSetting", "gauge_kernel", "kept_of_waves", "noise_correlation"]


class GaugeSetting(NamedTuple):
    """What makes a virtual strain gauge.

    subset_size, step_size : side of a subset, and distance of the points [px]
    shape_function : of the subsets; "auto" is the program's choice at each step
    window_points : side of the window of a strain [points], odd
    degree : of the polynomial in the window
    """

    subset_size: int
    step_size: int
    shape_function: ShapeFunction | Literal["auto"]
    window_points: int
    degree: int

    @property
    def side_px(self) -> float:
        """Side of the gauge [px]."""
        return vsg_px(self.window_points, self.step_size, self.subset_size)


def gauge_kernel(setting: GaugeSetting) -> Array:
    """K (rows, cols) for the slope along the columns, of a square gauge [1/px].

    Raises ValueError for the shape function "auto", which is known at a step alone.
    """
    if setting.shape_function == "auto":
        raise ValueError("a kernel needs the shape function of a step: affine or quadratic")
    points, step = setting.window_points, setting.step_size
    factors, terms = slope_weights(np.ones((points, points)), (points, points), setting.degree)
    middle = points // 2
    weights = np.tensordot(factors[middle, middle, 0], terms, axes=1) / step
    spread = np.zeros(2 * [(points - 1) * step + 1])
    spread[::step, ::step] = weights
    return np.asarray(fftconvolve(spread, subset_weights(setting.subset_size, setting.shape_function)))


def noise_correlation(kernels: Sequence[Array]) -> Array:
    """Correlation (n, n) of the errors of the same strain by several gauges at one point, all of odd sides.

    White noise of the photograph gives two gauges the covariance Σ K₁ K₂.
    """
    product = np.array([[_common(first, second) for second in kernels] for first in kernels])
    norm = np.sqrt(np.diagonal(product))
    return np.asarray(product / np.outer(norm, norm))


def _common(first: Array, second: Array) -> float:
    """Σ K₁ K₂ of two kernels about one point."""
    small, large = sorted((first, second), key=len)
    edge = (len(large) - len(small)) // 2
    inner = slice(edge, edge + len(small))
    return float((small * large[inner, inner]).sum())


def kept_of_waves(kernel: Array, periods: Array) -> Array:
    """Shares (2, period) that remain of the amplitude of strain waves along the strain's own direction, and across it.

    periods : of the waves [px]
    """
    x = np.arange(kernel.shape[0]) - (kernel.shape[0] - 1) / 2.0
    turn = 2.0 * np.pi / periods[:, None]
    along = (np.sin(turn * x) / turn) @ kernel.sum(axis=0)
    across = np.cos(turn * x) @ (kernel @ x)
    return np.stack([along, across])
