"""Correlation of the errors of neighbouring points, whose subsets share pixels.

The place of a subset is, to first order, an average of its pixels' noise. With an affine shape function the average
is plain, with a quadratic one it is the centre value of the least-squares parabola over the subset (the kernel of
Savitzky & Golay 1964 in two dimensions), k(x, y) = f(x) + f(y). The correlation of two points is the autocorrelation of
this kernel at their distance: for either shape function a sum of up to three products of a function of the rows and one
of the columns.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Index

__all__ = ["Overlap", "ShapeFunction", "independent", "mixed", "overlap", "subset_weights"]

ShapeFunction = Literal["affine", "quadratic"]


class Overlap(NamedTuple):
    """Correlation of errors on a regular grid: ρ(i, j) = Σₜ down[t, |i|] · across[t, |j|] at i rows, j columns apart.

    down, across : (term, lag) — taken as 0 beyond the last lag; ρ(0, 0) = 1
    """

    down: Array
    across: Array

    def at(self, rows_apart: Index, cols_apart: Index) -> Array:
        """ρ at distances (...) [points]."""
        down, across = (
            np.pad(part, ((0, 0), (0, 1)))[:, np.minimum(np.abs(lag), part.shape[1])]
            for part, lag in ((self.down, rows_apart), (self.across, cols_apart))
        )
        return np.asarray((down * across).sum(axis=0))

    def variance(self, weights: Array) -> float:
        """Variance of a sum of points with weights (row, col), whose errors have unit variance."""
        bands = []
        for lags, side in zip((self.down, self.across), weights.shape, strict=True):
            apart = np.abs(np.subtract.outer(np.arange(side), np.arange(side)))
            bands.append(np.pad(lags, ((0, 0), (0, max(0, side - lags.shape[1]))))[:, apart])
        return float((bands[0] @ weights @ bands[1] * weights).sum())


def overlap(subset_size: int, step_size: float, shape_function: ShapeFunction = "affine") -> Overlap:
    """Correlation of the errors of points on a grid.

    subset_size : side of the square subsets [px]
    step_size : distance of the grid's points [px]

    >>> overlap(20, 5.0).down[0]
    array([1.  , 0.75, 0.5 , 0.25])
    """
    lags = np.arange(0, subset_size, max(1, round(step_size)))
    one = np.ones(subset_size)
    plain = _correlation(one, one, lags)
    if shape_function == "affine":
        return Overlap(plain[None] / subset_size, plain[None] / subset_size)
    half = _half_parabola(subset_size)
    crossed, parabolic = _correlation(half, one, lags), _correlation(half, half, lags)
    scale = 2.0 * (parabolic[0] * plain[0] + crossed[0] ** 2)
    return Overlap(np.stack([parabolic, 2.0 * crossed, plain]) / scale, np.stack([plain, crossed, parabolic]))


def subset_weights(subset_size: int, shape_function: ShapeFunction = "affine") -> Array:
    """Weights k (rows, cols) of a subset's pixels in its place; their sum is 1."""
    if shape_function == "affine":
        return np.full((subset_size, subset_size), 1.0 / subset_size**2)
    half = _half_parabola(subset_size)
    return np.asarray(np.add.outer(half, half))


def mixed(parts: Sequence[tuple[float, Overlap]]) -> Overlap:
    """Correlation of sums of independent errors, Σ sₖ ρₖ.

    parts : share sₖ in the variance of the sum, and the correlation ρₖ of each, on one grid and of subsets of one size
    """
    down = np.concatenate([share * rho.down for share, rho in parts])
    return Overlap(down, np.concatenate([rho.across for _, rho in parts]))


def independent() -> Overlap:
    """The correlation of independent errors: 1 at distance 0, 0 elsewhere."""
    return Overlap(np.ones((1, 1)), np.ones((1, 1)))


def _half_parabola(size: int) -> Array:
    """f with k(x, y) = f(x) + f(y): Σ k = 1, and Σ k x² = Σ k y² = 0, over a square of ``size`` pixels."""
    x2 = (np.arange(size) - (size - 1) / 2.0) ** 2
    second, fourth = x2.mean(), (x2**2).mean()
    if second == 0.0:
        return np.full(size, 0.5)
    curvature = 1.0 / (2.0 * second - (fourth + second**2) / second) / size**2
    return np.asarray(curvature * (x2 - (fourth + second**2) / second / 2.0))


def _correlation(first: Array, second: Array, lags: Index) -> Array:
    """Σ first[x] second[x + lag] for each lag."""
    return np.array([first[: len(first) - lag] @ second[lag:] for lag in lags])
