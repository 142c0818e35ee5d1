"""Correlation of the errors of neighbouring points, whose subsets share pixels.

The place of a subset is, to first order, an average of its pixels' noise. With an affine shape function the average
is plain, with a quadratic one it is the centre value of the least-squares parabola over the subset (the kernel of
Savitzky & Golay 1964 in two dimensions), k(x, y) = f(x) + f(y). The correlation of two points is the autocorrelation of
this kernel at their distance: for either shape function a sum of up to three products of a function of the rows and one
of the columns.

Misfit that leaves derivatives of what the pattern is, such as f_x f_xx = ∂ₓ(f_x²) / 2 after a change of sharpness,
is averaged by the derivative of the kernel instead. For an affine subset this is its rims, so that such errors reach
less far along the derivative, and have another sign beyond.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Index

__all__ = [
    "Derivative",
    "Overlap",
    "ShapeFunction",
    "independent",
    "lag_products",
    "mixed",
    "overlap",
    "subset_weights",
]

ShapeFunction = Literal["affine", "quadratic"]


class Derivative(NamedTuple):
    """A derivative of the pattern, as which a subset averages errors.

    along : down or across the photograph
    edge_px : standard deviation of the weights over which it is correlated, about that of the pattern's edges [px]
    """

    along: Literal["down", "across"]
    edge_px: float


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

    def in_window(self, window: tuple[int, ...]) -> Array:
        """ρ(i, j) for up to so many rows and columns, (rows, cols)."""
        found, (rows, cols) = np.zeros(window), window
        down, across = self.down[:, :rows], self.across[:, :cols]
        found[: down.shape[1], : across.shape[1]] = down.T @ across
        return found

    def variance(self, weights: Array) -> Array:
        """Variances (...) of sums of points with weights (..., row, col), whose errors have unit variance."""
        down, across = (_pairs(lags, side) for lags, side in zip(self, weights.shape[-2:], strict=True))
        both = weights[..., None, :, :]
        return np.asarray(((down @ both) * (both @ across)).sum(axis=(-3, -2, -1)))


def lag_products(weights: Array) -> Array:
    """Sums (..., row, col) of the products of weights (..., row, col) of points so far apart, in any direction."""
    high, wide = weights.shape[-2:]
    power = np.abs(np.fft.rfft2(weights, (2 * high, 2 * wide))) ** 2
    found = np.fft.irfft2(power, (2 * high, 2 * wide))
    found[..., 1:high, :] += found[..., :high:-1, :]
    found[..., 1:wide] += found[..., :wide:-1]
    return np.asarray(found[..., :high, :wide])


def overlap(
    subset_size: int, step_size: float, shape_function: ShapeFunction = "affine", derivative: Derivative | None = None
) -> Overlap:
    """Correlation of the errors of points on a grid.

    subset_size : side of the square subsets [px]
    step_size : distance of the grid's points [px]
    derivative : of errors that a subset averages as one

    >>> overlap(20, 5.0).down[0]
    array([1.  , 0.75, 0.5 , 0.25])
    """
    step = max(1, round(step_size))
    one = np.ones(subset_size)
    half = one if shape_function == "affine" else _half_parabola(subset_size)
    edges = {derivative.along: derivative.edge_px} if derivative else {}
    down, across = (_correlations(one, half, step, edges.get(along)) for along in ("down", "across"))
    if shape_function == "affine":
        return Overlap(*(part[:1] / part[0, 0] for part in (down, across)))
    scale = np.array([1.0, 2.0, 1.0]) * down[:, 0] @ across[::-1, 0]
    return Overlap(np.array([[1.0], [2.0], [1.0]]) * down[::-1] / scale, across)


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
    shares = np.repeat([share for share, _ in parts], [len(rho.down) for _, rho in parts])
    down, across = (_stacked([rho[axis] for _, rho in parts]) for axis in range(2))
    return Overlap(shares[:, None] * down, across)


def independent() -> Overlap:
    """The correlation of independent errors: 1 at distance 0, 0 elsewhere."""
    return Overlap(np.ones((1, 1)), np.ones((1, 1)))


def _pairs(lags: Array, side: int) -> Array:
    """Values (term, side, side) of lags (term, lag) for pairs of points so far apart; 0 beyond the last lag."""
    apart = np.abs(np.subtract.outer(np.arange(side), np.arange(side)))
    return np.pad(lags, ((0, 0), (0, max(0, side - lags.shape[1]))))[:, apart]


def _stacked(parts: Sequence[Array]) -> Array:
    """Functions (term, lag) of all parts, 0 beyond the last lag of each."""
    lags = max(part.shape[1] for part in parts)
    return np.concatenate([np.pad(part, ((0, 0), (0, lags - part.shape[1]))) for part in parts])


def _half_parabola(size: int) -> Array:
    """f with k(x, y) = f(x) + f(y): Σ k = 1, and Σ k x² = Σ k y² = 0, over a square of ``size`` pixels."""
    x2 = (np.arange(size) - (size - 1) / 2.0) ** 2
    second, fourth = x2.mean(), (x2**2).mean()
    if second == 0.0:
        return np.full(size, 0.5)
    curvature = 1.0 / (2.0 * second - (fourth + second**2) / second) / size**2
    return np.asarray(curvature * (x2 - (fourth + second**2) / second / 2.0))


def _correlations(one: Array, half: Array, step: int, edge_px: float | None) -> Array:
    """Correlations (3, lag) of one with itself, with half, and of half with itself, for every so many pixels.

    edge_px : of the derivatives of both, which are averaged over such an edge; None for themselves
    """
    if edge_px is not None:
        one, half = (_derivative(values, edge_px) for values in (one, half))
    lags = np.arange(0, len(one), step)
    return np.stack([_correlation(*pair, lags) for pair in ((one, one), (one, half), (half, half))])


def _derivative(values: Array, edge_px: float) -> Array:
    """Differences of values amid zeros, averaged over an edge."""
    far = int(np.ceil(3.0 * edge_px))
    edge = np.exp(-0.5 * (np.arange(-far, far + 1) / edge_px) ** 2)
    return np.convolve(np.diff(values, prepend=0.0, append=0.0), edge)


def _correlation(first: Array, second: Array, lags: Index) -> Array:
    """Σ first[x] second[x + lag] for each lag."""
    return np.array([first[: len(first) - lag] @ second[lag:] for lag in lags])
