"""How much the motion jumps across lines through the points of a grid.

Subsets on the line of a jump J average both sides, so that their places rise across it by J r(δ), with δ the distance
from the line and r the **profile** of a subset, from −1/2 to 1/2 over its side. J is a coefficient of a least-squares
fit to the displacements around a point: a polynomial of degree 3, which follows smooth motion, and J r(δ), for lines in
four directions. It is a weighted sum of points, so that its covariance is known.

Steep motion that is smooth may look like a jump. A term of degree 5 across the line follows it, and leaves of a jump
what it was: where J is large, its significance is the smaller one of both fits, and J their mean. The scatter of J over
all points, most of which have no jump, tells how large its standard deviation is; jumps are significant beside that.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dicflow.core.arrays import Array, Codes, Index, Mask
from dicflow.core.parts import beside_borders
from dicflow.core.strain.deformation_gradient import ErrorShare, MeasuredSurface
from dicflow.core.strain.window_fits import WindowedPoints, places_of
from dicflow.core.uncertainty.covariance import displacement_covariance
from dicflow.core.uncertainty.overlap import ShapeFunction, subset_weights

__all__ = ["NORMALS", "GridOfSubsets", "Jumps", "grown", "jumps_at_points"]


NORMALS = np.array([[1.0, 0.0], [0.0, 1.0], [0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]])
"""Normals (row, col) of the lines."""
_DEPTH, _WIDTH = 1.6, 0.7
"""Distances from a point, normal to the line and along it, up to which points count [sides of a subset]."""
_DEGREE, _MIN_POINTS_PER_TERM, _MAX_CONDITION = 3, 1.5, 1e7
_DOUBTFUL = 4.0
"""Significance above which the errors of all points of a window count one by one."""
_SAMPLES = 500
"""Points whose jumps tell the scatter, at most."""
_NORMAL_MEDIANS = (1.0, 0.6745, 1.1774, 1.5382)
"""Median lengths of vectors of 1, 2 and 3 independent normal variables, in standard deviations; 1 of none."""


class GridOfSubsets(NamedTuple):
    """Subsets of a grid: their side, the distance of its points [px], and how they may deform."""

    size: int
    step: int
    shape_function: ShapeFunction

    @property
    def reach(self) -> int:
        """Distance normal to a line up to which points count [points]."""
        return max(1, round(_DEPTH * self.size / self.step))

    @property
    def width(self) -> int:
        """The same along the line."""
        return max(1, round(_WIDTH * self.size / self.step))

    @property
    def half(self) -> int:
        """Points from a rim up to which it cuts subsets."""
        return max(1, int(np.ceil(0.5 * self.size / self.step)))

    def profile(self, distance: Array, normal: Array) -> Array:
        """r at distances from a line [points], −1/2 to 1/2. normal : (2,) — of the line"""
        table = _profile(self.size, self.shape_function, float(normal[0]), float(normal[1]))
        return np.asarray(np.interp(self.step * distance, np.arange(-self.size, self.size + 1), table))


class Jumps(NamedTuple):
    """The most significant of the jumps across lines through each point of a grid.

    significance : (row, col) — |J| in standard deviations; 0 where unknown
    jump : (row, col, 3) — J [mm]; direction : (row, col) — number of the normal of its line
    of_normals : the significance (normal, row, col) and J (normal, row, col, 3) of the lines with each normal
    """

    significance: Array
    jump: Array
    direction: Codes
    of_normals: tuple[Array, Array]


class _Fit(NamedTuple):
    """The fit for lines with a normal, over points of a square (side, side) around each one.

    number : of the normal
    terms : (term, n) — of the points that count, the profile first; places : (n,) — of these in the square
    steep : (n,) — a term of degree 5 across the line
    """

    number: int
    terms: Array
    places: Index
    side: int
    steep: Array

    @property
    def weights(self) -> Array:
        """Weights (side, side) of the points in J where all of them are known."""
        in_jump = np.asarray(np.linalg.pinv(self.terms.T), dtype=np.float64)[:1]
        return np.asarray(self.on_square(in_jump)[0])

    @property
    def weights_beside_steep(self) -> Array:
        """Those (1, n) of the points that count, in a fit that has the steep term too."""
        return np.asarray(np.linalg.pinv(np.vstack([self.terms, self.steep]).T), dtype=np.float64)[:1]

    def beside_steep(self, values: Array, at: Index) -> Array:
        """J (k, 3) of a field (row, col, 3) by that fit at rows and columns (k, 2)."""
        weights = self.weights_beside_steep[0]
        return np.stack([self.around(field, at) @ weights for field in np.moveaxis(values, -1, 0)], axis=-1)

    def on_square(self, values: Array) -> Array:
        """Values (k, n) of the points that count as squares (k, side, side), 0 elsewhere."""
        whole = np.zeros((len(values), self.side**2))
        whole[:, self.places] = values
        return whole.reshape(-1, self.side, self.side)

    def around(self, field: Array, at: Index) -> Array:
        """Values (k, n) of a field (row, col) at the points that count around rows and columns (k, 2)."""
        squares = sliding_window_view(np.pad(field, self.side // 2), (self.side, self.side))
        return np.asarray(squares[at[:, 0], at[:, 1]].reshape(len(at), -1)[:, self.places])


@cache
def _profile(size: int, shape_function: ShapeFunction, row: float, col: float) -> Array:
    """r at distances of −size … size pixels from a line with the normal (row, col)."""
    weights, pixel = subset_weights(size, shape_function), np.arange(size) - size // 2
    across = np.add.outer(row * pixel, col * pixel)
    return np.array([0.5 * np.sum(weights * np.sign(np.rint(1e6 * (across + at)))) for at in range(-size, size + 1)])


def jumps_at_points(surface: MeasuredSurface, lost: Mask, subsets: GridOfSubsets) -> Jumps:
    """Jumps at all points around which none is missing, and at points near those where a jump was found.

    lost : (row, col) — where a jump was found
    """
    found = np.zeros((len(NORMALS), *lost.shape)), np.zeros((len(NORMALS), *lost.shape, 3))
    points, errors = _without_jumps(surface, subsets)
    values = points.values[..., :3] - points.values[..., 3:]
    whole = (surface.known & ~beside_borders(points.parts)).astype(np.float64)
    near = grown(lost, np.ones((2 * subsets.reach + 1,) * 2, dtype=np.uint8)) & surface.known
    ratios = [1.0]
    for fit in _fits(subsets):
        square = fit.on_square(np.ones((1, len(fit.places))))[0]
        complete = (_summed(whole, square) > len(fit.places) - 0.5) & surface.known
        at, jump = places_of(complete), _summed(values, fit.weights)[complete]
        if len(at):
            ratios.append(_scatter_over_stated(values, errors, at[:: 1 + len(at) // _SAMPLES], fit))
            _set(found, fit.number, at, *_in_whole_windows(points, errors, at, jump, fit))
        at = places_of(near & ~complete)
        if len(at):
            _set(found, fit.number, *_by_some_points(points, errors, at, fit))
    significance, jump = found[0] / np.maximum(np.mean(ratios[1:] or ratios), 1.0), found[1]
    best = significance.argmax(axis=0)[None]
    of_best = np.take_along_axis(jump, best[..., None], axis=0)[0]
    return Jumps(significance.max(axis=0), of_best, best[0].astype(np.uint8), (significance, jump))


def grown(mask: Mask, by: Codes) -> Mask:
    """The mask grown by a set of points (side, side)."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), by) > 0, dtype=np.bool_)


def _without_jumps(surface: MeasuredSurface, subsets: GridOfSubsets) -> tuple[WindowedPoints, list[ErrorShare]]:
    """The points, and the errors of their displacements, with those errors that they would have without a jump.

    Beside a jump the errors are those by the jump itself, so that these are as large as the least ones around. Subsets
    that the rim of the region cuts keep their own.
    """
    points, known = surface.points, surface.known
    around = np.ones((subsets.reach + 1,) * 2, dtype=np.uint8)
    least = cv2.erode(np.where(known, points.sigma, np.inf), around)
    outside = np.pad(points.parts.number == 0, subsets.half, constant_values=True)
    cut = grown(outside, np.ones((2 * subsets.half + 1,) * 2, dtype=np.uint8))
    cut = cut[subsets.half : -subsets.half, subsets.half : -subsets.half]
    sigma = np.where(known, np.where(cut, points.sigma, least), 0.0)
    share = np.divide(sigma, points.sigma, out=np.ones_like(sigma), where=known)[..., None, None] ** 2
    errors = [one._replace(covariance=share * displacement_covariance(one.covariance)) for one in surface.errors]
    return points._replace(sigma=sigma), errors


def _fits(subsets: GridOfSubsets) -> Iterator[_Fit]:
    """The fits for all normals; none where too few points count."""
    depth, width = subsets.reach, subsets.width
    half = int(np.ceil(np.hypot(depth, width)))
    row, col = np.mgrid[-half : half + 1, -half : half + 1]
    for number, normal in enumerate(NORMALS):
        across, along = row * normal[0] + col * normal[1], row * normal[1] - col * normal[0]
        places = np.flatnonzero((np.abs(across) < depth + 0.1) & (np.abs(along) < width + 0.1))
        x, y = across.ravel()[places] / depth, along.ravel()[places] / depth
        powers = [x**a * y**b for a in range(_DEGREE + 1) for b in range(_DEGREE + 1 - a)]
        terms = np.stack([subsets.profile(depth * x, normal), *powers])
        if len(places) >= _MIN_POINTS_PER_TERM * len(terms) and np.linalg.cond(terms) ** 2 < _MAX_CONDITION:
            yield _Fit(number, terms, places, 2 * half + 1, x**5)


def _summed(values: Array, weights: Array) -> Array:
    """Sums of a field (row, col, …) with weights (side, side) around each point."""
    return np.asarray(cv2.filter2D(values, -1, weights, borderType=cv2.BORDER_CONSTANT))


def _in_whole_windows(
    points: WindowedPoints, errors: list[ErrorShare], at: Index, jump: Array, fit: _Fit
) -> tuple[Array, Array]:
    """Jumps (n, 3) at rows and columns (n, 2), around which no point is missing, and their significance (n,).

    jump : (n, 3) — without the steep term; changed where both fits count
    """
    significance = _in_standard_deviations(jump, _typical_covariance(errors, at, fit.weights))
    doubtful = np.flatnonzero(significance > _DOUBTFUL)
    if len(doubtful):
        here = np.ascontiguousarray(at[doubtful])
        weights = np.broadcast_to(fit.weights, (len(here), 1, *fit.weights.shape))
        covariance = _covariance(points, errors, here, np.ascontiguousarray(weights))
        both = jump[doubtful], fit.beside_steep(points.values[..., :3] - points.values[..., 3:], here)
        significance[doubtful] = np.minimum(*(_in_standard_deviations(one, covariance) for one in both))
        jump[doubtful] = np.mean(both, axis=0)
    return jump, significance


def _typical_covariance(errors: list[ErrorShare], at: Index, weights: Array) -> Array:
    """Covariances (n, 3, 3) of sums with weights (side, side), if all points have the errors of that in the middle."""
    rows, cols = at.T
    return np.asarray(np.sum([one.rho.variance(weights) * one.covariance[rows, cols] for one in errors], axis=0))


def _scatter_over_stated(values: Array, errors: list[ErrorShare], at: Index, fit: _Fit) -> float:
    """Ratio of the scatter of jumps in values (row, col, 3) at rows and columns (n, 2), n > 0, to what is stated."""
    covariance = _typical_covariance(errors, at, fit.on_square(fit.weights_beside_steep)[0])
    axes = int((np.diagonal(covariance, axis1=1, axis2=2) > 0.0).any(axis=0).sum())
    scaled = _in_standard_deviations(fit.beside_steep(values, at), covariance)
    return float(np.median(scaled)) / _NORMAL_MEDIANS[axes]


def _covariance(points: WindowedPoints, errors: list[ErrorShare], at: Index, weights: Array) -> Array:
    """Covariances (n, 3, 3) of sums with weights (n, 1, side, side) around rows and columns (n, 2)."""
    rows, cols = at.T
    shares = [points.variances(at, weights, one.rho) * one.covariance[rows, cols] for one in errors]
    return np.asarray(np.sum(shares, axis=0))


def _by_some_points(
    points: WindowedPoints, errors: list[ErrorShare], at: Index, fit: _Fit
) -> tuple[Index, Array, Array]:
    """Where the known points tell, of rows and columns (n, 2): these (m, 2), jumps (m, 3), their significance (m,)."""
    own = points.parts.number[at[:, 0], at[:, 1]]
    part = fit.around(points.parts.number.astype(np.float64), at)
    weights = np.where(part == own[:, None], fit.around(points.weights, at), 0.0)
    weights /= np.maximum(weights.max(axis=1, keepdims=True, initial=0.0), 1e-300)
    normal = (fit.terms * weights[:, None]) @ fit.terms.T
    firm = np.linalg.cond(normal) < _MAX_CONDITION
    at, weights = np.ascontiguousarray(at[firm]), weights[firm]
    unit = np.broadcast_to(np.eye(len(fit.terms))[:, :1], (len(at), len(fit.terms), 1))
    squares = fit.on_square((np.linalg.solve(normal[firm], unit)[..., 0] @ fit.terms) * weights)[:, None]
    both = points.sums(at, squares)[:, 0]
    jump = both[:, :3] - both[:, 3:]
    return at, jump, _in_standard_deviations(jump, _covariance(points, errors, at, squares))


def _set(found: tuple[Array, Array], number: int, at: Index, jump: Array, significance: Array) -> None:
    """Set the significance (n,) and jumps (n, 3) at rows and columns (n, 2) across lines with one normal."""
    rows, cols = at.T
    found[0][number, rows, cols], found[1][number, rows, cols] = significance, jump


def _in_standard_deviations(vectors: Array, covariance: Array) -> Array:
    """√(vᵀ C⁻¹ v), (n,), of vectors (n, 3), by elimination; an axis without variance does not count."""
    left, rest, total = covariance.copy(), vectors.copy(), np.zeros(len(vectors))
    least = 1e-9 * np.trace(covariance, axis1=1, axis2=2)
    for k in range(3):
        counts = left[:, k, k] > least
        pivot = np.divide(1.0, left[:, k, k], out=np.zeros_like(total), where=counts)
        total += rest[:, k] ** 2 * pivot
        for i in range(k + 1, 3):
            factor = left[:, i, k] * pivot
            rest[:, i] -= factor * rest[:, k]
            left[:, i, k + 1 :] -= factor[:, None] * left[:, k, k + 1 :]
    return np.asarray(np.sqrt(total))
