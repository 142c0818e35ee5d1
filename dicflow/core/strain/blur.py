"""What virtual strain gauges of different size blur, from how their strains differ beyond noise.

The field is thought of as waves of a few periods along and across each strain, with unknown powers P ≥ 0. A gauge keeps
the share T of a wave, so two gauges differ in the mean square by

    D₁₂ = v₁₂ + Σ |T₁ − T₂|² P,    v₁₂ = σ₁² + σ₂² − 2 ρ₁₂ σ₁ σ₂,

where ρ is the correlation of their errors. Non-negative least squares over all pairs give P (Lawson & Hanson 1974,
Solving least squares problems, ch. 23), and with it the bias of each gauge against the field itself, b² = Σ |1 − T|² P.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from dicflow.core.arrays import Array
from dicflow.core.strain.gauge_kernel import kept_of_waves, noise_correlation

__all__ = ["difference_by_noise", "estimated_bias", "mean_square_differences"]

_PERIODS_PER_OCTAVE = 2
_LONGEST = 6.0
"""Longest period of a wave, in sides of the largest gauge."""
_MODEL_ERROR = 0.1
"""Of a difference beyond noise, relative: gauges at a rim are one-sided, and waves lie in all directions."""


def mean_square_differences(strains: Array) -> Array:
    """D (n, n) of the strains (n, point) of several gauges at the same points."""
    product = strains @ strains.T / strains.shape[1]
    square = np.diagonal(product)
    return np.asarray(np.maximum(square[:, None] + square - 2.0 * product, 0.0))


def difference_by_noise(sigma: Array, kernels: Sequence[Array]) -> Array:
    """v (n, n), the mean square difference of several gauges by noise. sigma : (n,) of each strain"""
    scaled = noise_correlation(kernels) * np.outer(sigma, sigma)
    return np.asarray(np.add.outer(sigma**2, sigma**2) - 2.0 * scaled)


def estimated_bias(differences: Array, by_noise: Array, kernels: Sequence[Array], area_px: float) -> Array:
    """Root mean square of the bias (n,) of each gauge.

    differences, by_noise : D and v (n, n)
    area_px : of the measured region [px²]; a gauge measures it so many times as it fits into it
    """
    sides = np.array([float(kernel.shape[0]) for kernel in kernels])
    periods = _periods(sides.min(), sides.max())
    kept = np.stack([kept_of_waves(kernel, periods).ravel() for kernel in kernels])
    first, second = np.triu_indices(len(kernels), 1)
    beyond = (differences - by_noise)[first, second]
    times = 2.0 * area_px / np.minimum(sides[first], sides[second]) ** 2
    scatter = by_noise[first, second] * np.sqrt(2.0 / np.maximum(times, 1.0))
    weight = 1.0 / np.hypot(scatter, _MODEL_ERROR * differences[first, second]).clip(1e-30)
    design = (kept[first] - kept[second]) ** 2 * weight[:, None]
    scale = np.linalg.norm(design, axis=0).clip(1e-30)
    power, _ = nnls(design / scale, beyond * weight)
    return np.asarray(np.sqrt((1.0 - kept) ** 2 @ (power / scale)))


def _periods(smallest: float, largest: float) -> Array:
    """Periods of waves that some gauges keep better than others [px]."""
    octaves = np.log2(_LONGEST * largest / smallest)
    return np.asarray(smallest * 2.0 ** (np.arange(octaves * _PERIODS_PER_OCTAVE + 1) / _PERIODS_PER_OCTAVE))
