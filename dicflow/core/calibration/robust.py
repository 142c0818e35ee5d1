"""Robust losses of residual vectors in the image plane, for least squares with iterated weights.

A loss ρ of the length r of a residual replaces r². Its minimum solves the normal equations weighted by
w(r) = ρ'(r) / 2r (Holland and Welsch 1977), and the estimate's covariance is that of least squares times

    κ = mean(w² r²) / (2 mean(w + r w'/2)²)

in place of the variance per coordinate (Huber 1981, "Robust Statistics", for isotropic residuals).
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import numpy as np

from dicflow.core.arrays import Array

__all__ = ["Loss", "LossKind", "cost", "efficient_scale", "noise_sigma", "sigma_from_median", "variance", "weights"]

LossKind = Literal["squares", "huber", "cauchy"]

_EFFICIENT_SCALES = {"squares": 1.0, "huber": 1.50, "cauchy": 2.56}
"""Scales, in standard deviations per coordinate, that keep 95 % efficiency for normal residuals in the plane."""
_RAYLEIGH_MEDIAN = np.sqrt(2.0 * np.log(2.0))


class Loss(NamedTuple):
    """A loss ρ(r) of the length r of a residual.

    kind : squares (r²), huber (r² up to the scale, then linear), cauchy (s² log(1 + r²/s²))
    scale_px : length s from which a residual has less weight
    """

    kind: LossKind = "squares"
    scale_px: float = 1.0


def cost(loss: Loss, lengths: Array) -> float:
    """Σρ over residuals' lengths (...) [px²]."""
    s = loss.scale_px
    if loss.kind == "huber":
        return float(np.sum(np.where(lengths <= s, lengths**2, s * (2.0 * lengths - s))))
    if loss.kind == "cauchy":
        return float(np.sum(s**2 * np.log1p((lengths / s) ** 2)))
    return float(np.sum(lengths**2))


def weights(loss: Loss, lengths: Array) -> Array:
    """w(r) (...) in 0 … 1."""
    if loss.kind == "huber":
        return np.asarray(loss.scale_px / np.maximum(lengths, loss.scale_px))
    if loss.kind == "cauchy":
        return np.asarray(1.0 / (1.0 + (lengths / loss.scale_px) ** 2))
    return np.ones_like(lengths)


def variance(loss: Loss, lengths: Array, parameters: int) -> float:
    """κ, the factor from (JᵀJ)⁻¹ to the covariance [px²]; for squares the variance of one coordinate.

    lengths : (n,) — of the residuals; parameters : number of parameters estimated from them
    """
    weight = weights(loss, lengths)
    freedom = max(2 * lengths.size - parameters, 1)
    return float(np.sum((weight * lengths) ** 2) / freedom / np.mean(_stiffness(loss, weight)) ** 2)


def _stiffness(loss: Loss, weight: Array) -> Array:
    """w + r w'/2: half the divergence of the vector w(r) r."""
    if loss.kind == "huber":
        return np.where(weight < 1.0, 0.5 * weight, 1.0)
    return weight**2 if loss.kind == "cauchy" else weight


def noise_sigma(loss: Loss, lengths: Array, parameters: int) -> float:
    """σ of one coordinate [px]: from the sum of squares, or from the median for a robust loss."""
    robust = loss.kind != "squares"
    return sigma_from_median(lengths, parameters) if robust else float(np.sqrt(variance(loss, lengths, parameters)))


def sigma_from_median(lengths: Array, parameters: int = 0) -> float:
    """σ of one coordinate from the median length, on which a minority of outliers has little effect [px].

    parameters : number of parameters estimated from the residuals, which makes them shorter
    """
    freedom = max(1.0 - parameters / (2.0 * lengths.size), 0.1)
    return float(np.median(lengths) / _RAYLEIGH_MEDIAN / np.sqrt(freedom))


def efficient_scale(kind: LossKind, sigma_px: float) -> float:
    """The scale of a loss that keeps 95 % efficiency for normal residuals of standard deviation ``sigma_px`` [px]."""
    return _EFFICIENT_SCALES[kind] * sigma_px
