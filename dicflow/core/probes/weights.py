"""Values at places between the points of the grid, along lines and over areas, as weighted sums of the points.

A probe knows by what weights the points around it add up, so that its standard deviation follows from theirs and from
the correlation of their errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.signal import convolve2d, correlate, correlate2d

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.surfaces.filters import slope_weights
from dicflow.core.uncertainty.covariance import sigma_along
from dicflow.core.uncertainty.overlap import Overlap

__all__ = [
    "Alike",
    "Extension",
    "Probe",
    "area_probe",
    "complete_mean",
    "difference",
    "extension",
    "length_slopes",
    "mean_probe",
    "point_probe",
    "sampled",
    "sigma_of",
    "slope_overlap",
    "value_of",
]


_REACH = 2.5
_NEAR = 2.0
_PARABOLA_POINTS = 8
_PLANE_POINTS = 4
_FLAT = 1e-3
_MANY_POINTS = 500
_GOLDEN = (5.0**0.5 - 1.0) / 2.0


class Probe(NamedTuple):
    """A weighted sum Σ wₙ zₙ over points of the grid.

    rows, cols, weights : (n,) — the weights add up to 1
    """

    rows: Index
    cols: Index
    weights: Array


class Alike(Protocol):
    """The correlation of errors at a distance on the grid."""

    def at(self, rows_apart: Index, cols_apart: Index) -> Array:
        """ρ at distances (...) [points]."""
        ...


def point_probe(grid: Array, known: Mask, place: ArrayLike, step_size: float) -> Probe | None:
    """The value at one place: of the parabola, or with few points the plane, that fits the points around it best.

    grid : (row, col, 2) — places of the points in the photograph of the first step [px]
    known : (row, col) — which of them have a value
    place : (2,) [px]
    Returns None where no points are near: the place lies beyond what was measured.
    """
    apart = (grid - np.asarray(place, dtype=np.float64)) / step_size
    distance = np.where(known, np.hypot(apart[..., 0], apart[..., 1]), np.inf)
    nearest = float(distance.min(initial=np.inf))
    if nearest > _NEAR:
        return None
    near = distance <= _REACH + nearest
    weights = _centre_weights(apart[near])
    if weights is None:
        return None
    rows, cols = np.nonzero(near)
    return Probe(rows, cols, weights)


def _centre_weights(places: Array) -> Array | None:
    """Weights (n,) of points (n, 2) in the value at 0 of the polynomial through them; None where they fix no plane."""
    x, y = places.T
    terms = np.stack([np.ones_like(x), x, y, x * x, x * y, y * y], axis=1)
    for count, least in ((6, _PARABOLA_POINTS), (3, _PLANE_POINTS)):
        design = terms[:, :count]
        if len(x) >= least and np.linalg.matrix_rank(design, tol=_FLAT) == count:
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
    """The mean over the points (row, col) of an area that have a value; None without any."""
    rows, cols = np.nonzero(inside & known)
    return Probe(rows, cols, np.full(len(rows), 1.0 / len(rows))) if len(rows) else None


def sampled(probe: Probe, most: int) -> list[Probe]:
    """Points of an area, each as a probe, spread evenly where there are more than ``most``."""
    count = len(probe.rows)
    chosen = np.arange(count)
    if count > most:
        chosen = np.unique((count * (np.arange(most) * _GOLDEN % 1.0)).astype(int))
    return [Probe(probe.rows[[index]], probe.cols[[index]], np.ones(1)) for index in chosen]


def difference(first: Probe, second: Probe) -> Probe:
    """The weighted sum that gives the value of one probe less that of another; its weights add up to 0."""
    return Probe(
        np.concatenate([first.rows, second.rows]),
        np.concatenate([first.cols, second.cols]),
        np.concatenate([first.weights, -second.weights]),
    )


def complete_mean(values: Array) -> Array:
    """Mean (…) over those of values (n, …) that are complete; NaN without any."""
    complete = values[np.isfinite(values).reshape(len(values), -1).all(axis=1)]
    return np.asarray(complete.mean(axis=0) if len(complete) else np.full(values.shape[1:], np.nan))


def value_of(probe: Probe, field: NDArray[np.floating]) -> Array:
    """Σ wₙ zₙ of a field (row, col, …)."""
    return np.asarray(np.tensordot(probe.weights, field[probe.rows, probe.cols], axes=1))


def sigma_of(probe: Probe, sigma: NDArray[np.floating], alike: Alike) -> float:
    """Standard deviation of the sum.

    sigma : (row, col) — of the points
    alike : how the errors of the points are correlated
    """
    scaled = probe.weights * sigma[probe.rows, probe.cols]
    if len(scaled) > _MANY_POINTS:
        return _sigma_of_many(probe, scaled, alike)
    rho = alike.at(probe.rows[:, None] - probe.rows, probe.cols[:, None] - probe.cols)
    return float(np.sqrt(max(float(scaled @ rho @ scaled), 0.0)))


def _sigma_of_many(probe: Probe, scaled: Array, alike: Alike) -> float:
    """The same by distances instead of pairs: Σ over distances of ρ times the autocorrelation of weight times σ."""
    row, col = probe.rows - probe.rows.min(), probe.cols - probe.cols.min()
    field = np.zeros((row.max() + 1, col.max() + 1))
    np.add.at(field, (row, col), scaled)
    apart = np.meshgrid(*(np.arange(1 - side, side) for side in field.shape), indexing="ij")
    variance = float((correlate(field, field, method="fft") * alike.at(*apart)).sum())
    return float(np.sqrt(max(variance, 0.0)))


class Extension(NamedTuple):
    """The distance of two points of the material, and what became of it, each with its standard deviation.

    first, length, elongation : now and at the reference, and the difference [mm]
    strain : elongation per first length [-]
    """

    first: tuple[float, float]
    length: tuple[float, float]
    elongation: tuple[float, float]
    strain: tuple[float, float]


def extension(
    ends: tuple[Probe, Probe], deformed: Array, reference: Array, covariance: Array, alike: Alike
) -> Extension:
    """Read an extensometer between two probes: straight distances in space.

    deformed, reference : (row, col, 3) [mm]
    covariance : (row, col, 6, 6) — of a point at the step and at the reference [mm²]
    """
    both = difference(*ends)
    now, before = value_of(both, deformed), value_of(both, reference)
    length, first = float(np.linalg.norm(now)), float(np.linalg.norm(before))
    values = (first, length, length - first, length / first - 1.0)
    sigmas = (sigma_of(both, sigma_along(covariance, slope), alike) for slope in length_slopes(now, before))
    return Extension(*zip(values, sigmas, strict=True))


def length_slopes(now: Array, before: Array) -> Array:
    """Derivatives (4, 6) of an :class:`Extension`'s values by both vectors (3,) from end to end [-, strain 1/mm]."""
    length, first = np.linalg.norm(now), np.linalg.norm(before)
    along, along_first, none = now / length, before / first, np.zeros(3)
    slopes = [[none, along_first], [along, none], [along, -along_first], [along, -along_first * length / first]]
    return np.asarray(np.reshape(slopes, (4, 6)) / np.array([1.0, 1.0, 1.0, first])[:, None])


class _Table(NamedTuple):
    """A correlation as a table (2 n + 1, 2 m + 1), its middle at no distance."""

    values: Array

    def at(self, rows_apart: Index, cols_apart: Index) -> Array:
        middle = np.array(self.values.shape) // 2
        row, col = (np.clip(lag + m + 1, 0, 2 * m + 2) for lag, m in zip((rows_apart, cols_apart), middle, strict=True))
        return np.asarray(np.pad(self.values, 1)[row, col])


def slope_overlap(rho: Overlap, window: tuple[int, int], degree: int, directions: ArrayLike) -> Alike:
    """How alike the errors of strains are, whose windows share points, for full windows.

    rho : correlation of the points' errors
    window, degree : of the fits
    directions : (k, 2) — the strain's error is that of the slopes per column and per row in these proportions, the
        errors of the k of them being independent of one another
    """
    factors, terms = slope_weights(np.ones(window), window, degree)
    slopes = np.tensordot(factors[window[0] // 2, window[1] // 2], terms, axes=1)
    weights = np.tensordot(np.asarray(directions, dtype=np.float64), slopes, axes=1)
    shared = sum(correlate2d(part, part) for part in weights)
    reach = [np.arange(-part.shape[1] + 1, part.shape[1]) for part in (rho.down, rho.across)]
    spread = convolve2d(shared, rho.at(*np.meshgrid(*reach, indexing="ij")))
    return _Table(spread / spread[spread.shape[0] // 2, spread.shape[1] // 2])
