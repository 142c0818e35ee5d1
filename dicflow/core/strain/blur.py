"""What virtual strain gauges of different size blur, from how their strains differ beyond noise.

The field is thought of as waves of a few periods along and across each strain, with unknown powers P ≥ 0. A gauge keeps
the share T of a wave, so two gauges differ in the mean square by

    D₁₂ = a v₁₂ + Σ |T₁ − T₂|² P,    v₁₂ = σ₁² + σ₂² − 2 ρ₁₂ σ₁ σ₂,

where ρ is the correlation of their errors, and a = 1 if σ is right. Weighted least squares over all pairs give P and a,
neither of them negative (Lawson & Hanson 1974, Solving least squares problems, ch. 23). A wave is believed only as far
as it explains more than one standard deviation of the differences: the sum of the powers, each in its own such unit, is
penalised (the lasso of Tibshirani 1996, J. R. Stat. Soc. B 58:267). With P the bias of a gauge against the field itself
is b² = Σ |1 − T|² P.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import nnls

from dicflow.core.arrays import Array
from dicflow.core.strain.gauge_kernel import kept_of_waves, noise_correlation

__all__ = ["difference_by_noise", "estimated_bias", "mean_square_differences"]

_PERIODS_PER_OCTAVE = 2
_SHORTEST, _LONGEST = 2.0, 6.0
"""Shortest and longest period of a wave, in sides of the smallest and of the largest gauge."""
_MODEL_ERROR = 0.1
"""Of a difference, relative: gauges at a rim are one-sided, and waves lie in all directions."""
_INDEPENDENT = 10.0
"""So many differences of independent scatter all pairs are worth."""
_RIDGE = 1e-9


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
    measured, noise = differences[first, second], by_noise[first, second]
    times = 2.0 * area_px / np.minimum(sides[first], sides[second]) ** 2
    scatter = np.hypot(noise * np.sqrt(2.0 / np.maximum(times, 1.0)), _MODEL_ERROR * measured)
    weight = np.sqrt(_INDEPENDENT / len(first)) / np.maximum(scatter, 1e-30)
    design = np.column_stack([(kept[first] - kept[second]) ** 2, noise]) * weight[:, None]
    power = _believed(design, measured * weight)
    return np.asarray(np.sqrt((1.0 - kept) ** 2 @ power))


def _believed(design: Array, measured: Array) -> Array:
    """Powers P of the waves: the least |A P − D|² + 2 Σ |A's column| P, without the last column's penalty.

    design, measured : A (pair, wave and noise) and D (pair,), over their scatter
    """
    scale = np.maximum(np.linalg.norm(design, axis=0), 1e-30)
    scaled = design / scale
    penalty = np.append(np.ones(len(scale) - 1), 0.0)
    root = np.linalg.cholesky(scaled.T @ scaled + _RIDGE * np.eye(len(scale)))
    found, _ = nnls(root.T, np.linalg.solve(root, scaled.T @ measured - penalty))
    return np.asarray((found / scale)[:-1])


def _periods(smallest: float, largest: float) -> Array:
    """Periods of waves that some gauges keep better than others [px]."""
    shortest = _SHORTEST * smallest
    octaves = np.log2(_LONGEST * largest / shortest)
    return np.asarray(shortest * 2.0 ** (np.arange(octaves * _PERIODS_PER_OCTAVE + 1) / _PERIODS_PER_OCTAVE))
