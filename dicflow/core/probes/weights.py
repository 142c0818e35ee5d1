"""Values at places between the points of the grid, along lines and over areas, as weighted sums over points.

The standard deviation of a sum follows from its weights, the standard deviations of the points and the correlation of
their errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.surfaces.filters import slope_weights
from dicflow.core.uncertainty.covariance import sigma_along
from dicflow.core.uncertainty.overlap import Overlap

__all__ = [
    "ErrorCorrelation",
    "Extension",
    "Probe",
    "area_probe",
    "bias_of",
    "complete_mean",
    "difference",
    "extension",
    "extension_bias",
    "length_slopes",
    "mean_probe",
    "point_probe",
    "sample_probes",
    "sigma_of",
    "strain_correlation",
    "value_of",
]


_FIT_RADIUS_STEPS = 2.5
"""Radius of the points that a value at a place is fitted to, beyond the distance of the nearest [steps of the grid]."""
_MAX_DISTANCE_STEPS = 2.0
"""Distance of the nearest point beyond which a place has no value [steps of the grid]."""
_MIN_PARABOLA_POINTS = 8
_MIN_PLANE_POINTS = 4
_RANK_TOLERANCE = 1e-3
_MAX_POINTS_IN_PAIRS = 500
"""Points up to which a standard deviation is summed over all pairs; with more, over distances."""
_GOLDEN_RATIO = (5.0**0.5 - 1.0) / 2.0


class Probe(NamedTuple):
    """A weighted sum Σ wₙ zₙ over points of the grid.

    rows, cols, weights : (n,) — the weights add up to 1
    """

    rows: Index
    cols: Index
    weights: Array


class ErrorCorrelation(Protocol):
    """The correlation of errors at a distance on the grid."""

    def at(self, rows_apart: Index, cols_apart: Index) -> Array:
        """ρ at distances (...) [points]."""
        ...


def point_probe(grid: Array, known: Mask, place: ArrayLike, step_size: float) -> Probe | None:
    """The value at one place: of the parabola, or with few points the plane, fitted to the points around it.

    grid : (row, col, 2) — places of the points in the first photograph [px]
    known : (row, col) — which of them have a value
    place : (2,) [px]
    Returns None where no points are near, or those near do not define a plane.
    """
    apart = (grid - np.asarray(place, dtype=np.float64)) / step_size
    distance = np.where(known, np.hypot(apart[..., 0], apart[..., 1]), np.inf)
    nearest = float(distance.min(initial=np.inf))
    if nearest > _MAX_DISTANCE_STEPS:
        return None
    near = distance <= _FIT_RADIUS_STEPS + nearest
    weights = _centre_weights(apart[near])
    if weights is None:
        return None
    rows, cols = np.nonzero(near)
    return Probe(rows, cols, weights)


def _centre_weights(places: Array) -> Array | None:
    """Weights (n,) of points (n, 2) in the value at 0 of the polynomial fitted to them; None if they fix no plane."""
    x, y = places.T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    for count, min_points in ((6, _MIN_PARABOLA_POINTS), (3, _MIN_PLANE_POINTS)):
        design = terms[:, :count]
        if len(x) >= min_points and np.linalg.matrix_rank(design, tol=_RANK_TOLERANCE) == count:
            return np.asarray(np.linalg.pinv(design)[0])
    return None


def mean_probe(parts: Sequence[Probe | None]) -> Probe | None:
    """The mean of several probes, as along a line; None where one of them has no value."""
    whole = [part for part in parts if part is not None]
    if not whole or len(whole) < len(parts):
        return None
    places = np.concatenate([np.stack([part.rows, part.cols], axis=1) for part in whole])
    weights = np.concatenate([part.weights for part in whole]) / len(whole)
    unique, which = np.unique(places, axis=0, return_inverse=True)
    sums = np.asarray(np.bincount(which.ravel(), weights), dtype=np.float64)
    return Probe(unique[:, 0], unique[:, 1], sums)


def area_probe(inside: Mask, known: Mask) -> Probe | None:
    """The mean over the known points inside an area, (row, col) each; None without any."""
    rows, cols = np.nonzero(inside & known)
    return Probe(rows, cols, np.full(len(rows), 1.0 / len(rows))) if len(rows) else None


def sample_probes(probe: Probe, max_count: int) -> list[Probe]:
    """The points of an area, each as a probe; if more than ``max_count``, that many, spread evenly."""
    count = len(probe.rows)
    chosen = np.arange(count)
    if count > max_count:
        chosen = np.unique((count * (np.arange(max_count) * _GOLDEN_RATIO % 1.0)).astype(int))
    return [Probe(probe.rows[[index]], probe.cols[[index]], np.ones(1)) for index in chosen]


def difference(first: Probe, second: Probe) -> Probe:
    """The value of one probe minus that of another, as a weighted sum; its weights add up to 0."""
    return Probe(
        np.concatenate([first.rows, second.rows]),
        np.concatenate([first.cols, second.cols]),
        np.concatenate([first.weights, -second.weights]),
    )


def complete_mean(values: Array) -> Array:
    """Mean (…) over those of values (n, …) that contain no NaN; NaN without any."""
    complete = values[np.isfinite(values).reshape(len(values), -1).all(axis=1)]
    return np.asarray(complete.mean(axis=0) if len(complete) else np.full(values.shape[1:], np.nan))


def value_of(probe: Probe, field: NDArray[np.floating]) -> Array:
    """Σ wₙ zₙ of a field (row, col, …)."""
    return np.asarray(np.tensordot(probe.weights, field[probe.rows, probe.cols], axes=1))


def sigma_of(probe: Probe, sigma: NDArray[np.floating], correlation: ErrorCorrelation) -> float:
    """Standard deviation of a probe's value.

    sigma : (row, col) — of the points
    correlation : of the errors of the points
    """
    scaled = probe.weights * sigma[probe.rows, probe.cols]
    if len(scaled) > _MAX_POINTS_IN_PAIRS:
        return _sigma_of_many(probe, scaled, correlation)
    rho = correlation.at(probe.rows[:, None] - probe.rows, probe.cols[:, None] - probe.cols)
    return float(np.sqrt(max(float(scaled @ rho @ scaled), 0.0)))


def bias_of(probe: Probe, bias: NDArray[np.floating]) -> float:
    """Standard deviation of the bias of a probe's value, from that of its points (row, col), which they share."""
    return float(np.abs(probe.weights) @ bias[probe.rows, probe.cols])


def _sigma_of_many(probe: Probe, scaled: Array, correlation: ErrorCorrelation) -> float:
    """The same, summed over distances instead of pairs: ρ times the autocorrelation of weight times σ."""
    row, col = probe.rows - probe.rows.min(), probe.cols - probe.cols.min()
    field = np.zeros((row.max() + 1, col.max() + 1))
    np.add.at(field, (row, col), scaled)
    apart = np.meshgrid(*(np.arange(1 - side, side) for side in field.shape), indexing="ij")
    variance = float((_autocorrelation(field) * correlation.at(*apart)).sum())
    return float(np.sqrt(max(variance, 0.0)))


def _autocorrelation(field: Array) -> Array:
    """Σ f[row, col] f[row + i, col + j] at all distances (i, j); (2 rows − 1, 2 cols − 1), distance 0 in the middle."""
    shape = [2 * side - 1 for side in field.shape]
    fast = [cv2.getOptimalDFTSize(side) for side in shape]
    spectrum = np.fft.rfft2(field, fast) * np.fft.rfft2(field[::-1, ::-1], fast)
    return np.asarray(np.fft.irfft2(spectrum, fast)[: shape[0], : shape[1]])


def _correlated(field: Array, kernel: Array) -> Array:
    """Σ kernel[i, j] field[row + i, col + j] wherever they overlap; (rows + high − 1, cols + wide − 1).

    Sums go along the rows of the kernel by fours, as in scipy.signal: loading that takes longer than these sums do.
    """
    high, wide = kernel.shape
    padded = np.pad(field, ((high - 1, high - 1), (wide - 1, wide - 1)))
    rows, cols = padded.shape[0] - high + 1, padded.shape[1] - wide + 1
    total = np.zeros((rows, cols))
    for i in range(high):
        shares = [kernel[i, j] * padded[i : i + rows, j : j + cols] for j in range(wide)]
        for j in range(0, wide - wide % 4, 4):
            total += shares[j] + shares[j + 1] + shares[j + 2] + shares[j + 3]
        for share in shares[wide - wide % 4 :]:
            total += share
    return total


class Extension(NamedTuple):
    """Reading of an extensometer between two material points: values, each with its standard deviation.

    first, length : distance at the reference state and at the step [mm]
    elongation : their difference [mm]
    strain : elongation per first length [-]
    """

    first: tuple[float, float]
    length: tuple[float, float]
    elongation: tuple[float, float]
    strain: tuple[float, float]


def extension(
    ends: tuple[Probe, Probe], deformed: Array, reference: Array, covariance: Array, correlation: ErrorCorrelation
) -> Extension:
    """Read an extensometer between two probes: straight distances in space.

    deformed, reference : (row, col, 3) [mm]
    covariance : (row, col, 6, 6) — of a point at the step and at the reference state [mm²]
    """
    between = difference(*ends)
    after, before = value_of(between, deformed), value_of(between, reference)
    length, first = float(np.linalg.norm(after)), float(np.linalg.norm(before))
    values = (first, length, length - first, length / first - 1.0)
    sigmas = (sigma_of(between, sigma_along(covariance, slope), correlation) for slope in length_slopes(after, before))
    return Extension(*zip(values, sigmas, strict=True))


def extension_bias(ends: tuple[Probe, Probe], deformed: Array, reference: Array, bias: Array) -> list[float]:
    """Standard deviations of the bias of an :class:`Extension`'s values by that of the displacements of both ends.

    bias : (row, col, 3) — of U, V and W [mm]; that of one end is independent of the other's
    """
    between = difference(*ends)
    slopes = length_slopes(value_of(between, deformed), value_of(between, reference))[:, :3]
    squares = sum(np.square([bias_of(end, bias[..., axis]) for axis in range(3)]) for end in ends)
    return [float(value) for value in np.sqrt(slopes**2 @ squares)]


def length_slopes(after: Array, before: Array) -> Array:
    """Derivatives (4, 6) of an :class:`Extension`'s values by both vectors (3,) from end to end [-, strain 1/mm]."""
    length, first = np.linalg.norm(after), np.linalg.norm(before)
    along, along_first, none = after / length, before / first, np.zeros(3)
    slopes = [[none, along_first], [along, none], [along, -along_first], [along, -along_first * length / first]]
    return np.asarray(np.reshape(slopes, (4, 6)) / np.array([1.0, 1.0, 1.0, first])[:, None])


class _TabulatedCorrelation(NamedTuple):
    """A correlation as a table (2 n + 1, 2 m + 1), with distance 0 in the middle; 0 beyond it."""

    values: Array

    def at(self, rows_apart: Index, cols_apart: Index) -> Array:
        middle = np.array(self.values.shape) // 2
        row, col = (np.clip(lag + m + 1, 0, 2 * m + 2) for lag, m in zip((rows_apart, cols_apart), middle, strict=True))
        return np.asarray(np.pad(self.values, 1)[row, col])


def strain_correlation(rho: Overlap, window: tuple[int, int], degree: int, directions: ArrayLike) -> ErrorCorrelation:
    """Correlation of the errors of strains, whose windows share points; for windows without missing points.

    rho : correlation of the points' errors
    window, degree : of the fits
    directions : (k, 2) — coefficients of the slopes per column and per row in the strain's error, for k independent
        errors of the points
    """
    factors, terms = slope_weights(np.ones(window), window, degree)
    slopes = np.tensordot(factors[window[0] // 2, window[1] // 2], terms, axes=1)
    weights = np.tensordot(np.asarray(directions, dtype=np.float64), slopes, axes=1)
    shared = np.sum([_correlated(part, part) for part in weights], axis=0)
    reach = [np.arange(-part.shape[1] + 1, part.shape[1]) for part in (rho.down, rho.across)]
    spread = _correlated(shared[::-1, ::-1], rho.at(*np.meshgrid(*reach, indexing="ij")))[::-1, ::-1]
    return _TabulatedCorrelation(spread / spread[spread.shape[0] // 2, spread.shape[1] // 2])
