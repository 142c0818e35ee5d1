"""Slopes of polynomials that are fitted to the points of a window, as weighted sums of these points.

A window belongs to the point at its centre. It holds the points of its part of the grid to which a way leads, further
away with each step: none behind lost points that form a gap, such as a crack that has opened. Every slope is a sum
Σₙ wₙ Xₙ over the window, so that a difference of two fits is one too, and its covariance is that of a point times
Q = Σₙₘ wₙ ρₙₘ wₘ, where ρ is the correlation of points whose subsets overlap.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.cholesky import factorise, solve
from dicflow.core.kernels import INNER, KERNEL
from dicflow.core.parts import Parts, are_apart
from dicflow.core.uncertainty.overlap import Overlap

__all__ = ["WindowedPoints", "places_of", "polynomial_terms", "terms_of_degree", "widened"]


_MIN_PIVOT_SHARE = 1e-9
"""Least pivot as a share of its diagonal element; below it the points do not determine the polynomial."""
_MIN_POINTS_PER_TERM = 1.5


class WindowedPoints(NamedTuple):
    """Points of a grid, whose windows are fitted.

    values : (row, col, k) — of each point; 0 where it is missing
    weights : (row, col) — of each point in the fits; 0 where it is missing
    sigma : (row, col) — standard deviation of its errors; 0 where it is missing
    parts : of the grid
    min_share : share of a window's points that must have a value; at least 1.5 per term of a polynomial in any case
    """

    values: Array
    weights: Array
    sigma: Array
    parts: Parts
    min_share: float

    def slope_weights(self, at: Index, window: tuple[int, int], degree: int) -> Array:
        """Weights (n, 2, high, wide) of the points of a window in its slopes per column and per row.

        at : (n, 2) — row and column of the centres
        window : (high, wide), odd numbers of points
        degree : of the polynomials, 1 or more
        Where the window has too few points for the degree the weights are NaN.
        """
        functionals = np.zeros((1, 2, terms_of_degree(degree)))
        functionals[0, 0, 2], functionals[0, 1, 1] = 2.0 / (window[1] + 1.0), 2.0 / (window[0] + 1.0)
        return self.functional_weights(at, window, functionals)

    def functional_weights(self, at: Index, window: tuple[int, int], functionals: Array) -> Array:
        """Weights (n, m, high, wide) of the points in linear functionals of the fitted polynomials.

        functionals : (n or 1, m, terms) — coefficients of the :func:`polynomial_terms` in each
        """
        powers = _powers(functionals.shape[-1])
        needed = max(_MIN_POINTS_PER_TERM * len(powers), self.min_share * window[0] * window[1])
        exponents = np.arange(2 * int(powers.sum(axis=1).max()) + 1)[:, None]
        down, across = (_offsets(side) ** exponents for side in window)
        wanted = np.ascontiguousarray(functionals)
        return np.asarray(_fit_weights(self.weights, self.parts, at, (down, across), powers, wanted, needed))

    def sums(self, at: Index, weights: Array) -> Array:
        """Sums (n, m, k) of the values with weights (n, m, high, wide)."""
        half, rows = weights.shape[2] // 2, at[:, 0]
        top = max(0, int(rows.min(initial=len(self.values))) - half)
        used = self.values[top : int(rows.max(initial=0)) + half + 1]
        return np.asarray(_sums(np.ascontiguousarray(np.moveaxis(used, 2, 0)), at - np.array([top, 0]), weights))

    def variances(self, at: Index, weights: Array, rho: Overlap) -> Array:
        """Covariances (n, m, m) of such sums for unit variance at the centre."""
        forms = _forms(self.sigma, at, weights, rho.down, rho.across)
        return np.asarray(forms / self.sigma[at[:, 0], at[:, 1]][:, None, None] ** 2)


def places_of(known: Mask) -> Index:
    """Rows and columns (n, 2) of the known points of a grid."""
    return np.ascontiguousarray(np.argwhere(known))


def terms_of_degree(degree: int) -> int:
    """Number of terms of a polynomial in two variables."""
    return (degree + 1) * (degree + 2) // 2


def polynomial_terms(window: tuple[int, int], count: int) -> Array:
    """The first terms 1, y, x, y², y x, x², … at the points of a window, (count, high, wide); x, y = ±1 beyond it."""
    down, across = map(_offsets, window)
    return np.stack([np.outer(down**a, across**b) for a, b in _powers(count)])


def _powers(count: int) -> Index:
    """Exponents (a, b) of yᵃ xᵇ in the first terms, (count, 2)."""
    powers = [(total - b, b) for total in range(count) for b in range(total + 1)]
    return np.array(powers[:count], dtype=np.int64)


def _offsets(side: int) -> Array:
    """Coordinates (side,) of the rows or columns of a window, ±1 beyond it."""
    return np.asarray(2.0 * np.arange(-(side // 2), side // 2 + 1) / (side + 1.0))


def widened(weights: Array, window: tuple[int, int]) -> Array:
    """Weights (n, m, high, wide) as those of a wider window, whose further points do not count."""
    high, wide = ((side - own) // 2 for side, own in zip(window, weights.shape[2:], strict=True))
    return np.pad(weights, [(0, 0), (0, 0), (high, high), (wide, wide)])


@njit(**KERNEL)
def _fit_weights(
    weights: Array,
    parts: Parts,
    at: Index,
    along: tuple[Array, Array],
    powers: Index,
    functionals: Array,
    needed: float,
) -> Array:
    """See :meth:`WindowedPoints.functional_weights`.

    along : powers of y at the rows of a window (2 · degree + 1, high), and of x at its columns (2 · degree + 1, wide)
    powers : (term, 2) — exponents of y and x in the terms; needed : least number of points
    """
    (size, high), wide = along[0].shape, along[1].shape[1]
    wanted = functionals.shape[1]
    result = np.full((len(at), wanted, high, wide), np.nan)
    own, of_columns = np.empty((high, wide)), np.empty((size, wide))
    moments = np.empty((size, size))
    matrix, vector = np.empty((len(powers), len(powers))), np.empty(len(powers))
    for n in range(len(at)):
        if _connected_weights(weights, parts, at[n], own) < needed - 0.5:
            continue
        _set_moments(own, along, of_columns, moments)
        _normal_matrix(moments, powers, matrix)
        if not factorise(matrix, _MIN_PIVOT_SHARE):
            continue
        for m in range(wanted):
            for i in range(len(powers)):
                vector[i] = functionals[n if len(functionals) > 1 else 0, m, i]
            solve(matrix, vector)
            _weighted_polynomial(own, along, powers, vector, of_columns, result[n, m])
    return result


@njit(**INNER)
def _connected_weights(weights: Array, parts: Parts, centre: Index, own: Array) -> int:
    """Set the weights (high, wide) of the points of a window to which a way leads from its centre, 0 for others.

    Returns their number.
    """
    high, wide = own.shape
    top, left = centre[0] - high // 2, centre[1] - wide // 2
    count, has_gap = 0, False
    for i in range(high):
        for j in range(wide):
            a, b = top + i, left + j
            own[i, j] = 0.0
            if not (0 <= a < weights.shape[0] and 0 <= b < weights.shape[1]):
                continue
            if weights[a, b] == 0.0 or are_apart(parts, centre[0], centre[1], a, b):
                has_gap = True
                continue
            own[i, j] = weights[a, b]
            count += 1
    return count - _hide(own) if has_gap else count


@njit(**INNER)
def _hide(own: Array) -> int:
    """Set the weights (high, wide) of the points to which no way leads from the centre to 0; returns their number.

    Rings of points around the centre follow each other, so that a way leads to a point if one of its neighbours on the
    ring before counts.
    """
    high, wide = own.shape
    row, col = high // 2, wide // 2
    hidden = 0
    for ring in range(2, max(row, col) + 1):
        for i in range(max(row - ring, 0), min(row + ring + 1, high)):
            step = 1 if abs(i - row) == ring else 2 * ring
            for j in range(col - ring, col + ring + 1, step):
                if 0 <= j < wide and own[i, j] != 0.0 and not _has_way(own, i, j, ring - 1):
                    own[i, j] = 0.0
                    hidden += 1
    return hidden


@njit(**INNER)
def _has_way(own: Array, i: int, j: int, ring: int) -> bool:
    """Whether a neighbour of a point counts that lies on a ring around the centre."""
    high, wide = own.shape
    row, col = high // 2, wide // 2
    for a in range(max(i - 1, 0), min(i + 2, high)):
        for b in range(max(j - 1, 0), min(j + 2, wide)):
            if own[a, b] != 0.0 and max(abs(a - row), abs(b - col)) == ring:
                return True
    return False


@njit(**INNER)
def _set_moments(own: Array, along: tuple[Array, Array], of_columns: Array, moments: Array) -> None:
    """Set the moments Σ w yᵃ xᵇ of the weights of a window, as far as the normal matrix has them.

    of_columns : (a, wide) — set to Σ w yᵃ over each column
    """
    down, across = along
    for a in range(len(down)):
        for j in range(own.shape[1]):
            of_columns[a, j] = 0.0
        for i in range(own.shape[0]):
            for j in range(own.shape[1]):
                of_columns[a, j] += down[a, i] * own[i, j]
        for b in range(len(down) - a):
            moments[a, b] = 0.0
            for j in range(own.shape[1]):
                moments[a, b] += of_columns[a, j] * across[b, j]


@njit(**INNER)
def _normal_matrix(moments: Array, powers: Index, matrix: Array) -> None:
    """Set the lower triangle of the normal matrix of a fit."""
    for i in range(len(matrix)):
        for j in range(i + 1):
            matrix[i, j] = moments[powers[i, 0] + powers[j, 0], powers[i, 1] + powers[j, 1]]


@njit(**INNER)
def _weighted_polynomial(
    own: Array, along: tuple[Array, Array], powers: Index, vector: Array, of_columns: Array, result: Array
) -> None:
    """Set wₙ Σᵢ vᵢ tᵢₙ over a window.

    of_columns : (a, wide) — set to the factors of yᵃ in each column
    """
    down, across = along
    terms = len(down) // 2 + 1
    for a in range(terms):
        for j in range(own.shape[1]):
            of_columns[a, j] = 0.0
    for k in range(len(powers)):
        for j in range(own.shape[1]):
            of_columns[powers[k, 0], j] += vector[k] * across[powers[k, 1], j]
    for i in range(own.shape[0]):
        for j in range(own.shape[1]):
            result[i, j] = 0.0
        for a in range(terms):
            for j in range(own.shape[1]):
                result[i, j] += down[a, i] * of_columns[a, j]
        for j in range(own.shape[1]):
            result[i, j] *= own[i, j]


@njit(**INNER)
def _on_grid(centre: int, side: int, length: int) -> tuple[int, int]:
    """The first row or column of a window that lies on the grid, and the one after the last.

    centre : of the window on the grid; side, length : of the window and of the grid
    """
    return max(0, side // 2 - centre), min(side, side // 2 + length - centre)


@njit(**KERNEL)
def _sums(values: Array, at: Index, weights: Array) -> Array:
    """Sums (n, m, k) over windows of values (k, row, col)."""
    wanted, high, wide = weights.shape[1:]
    result = np.zeros((len(at), wanted, len(values)))
    for n in range(len(at)):
        top, left = at[n, 0] - high // 2, at[n, 1] - wide // 2
        first_row, end_row = _on_grid(at[n, 0], high, values.shape[1])
        first, end = _on_grid(at[n, 1], wide, values.shape[2])
        for i in range(first_row, end_row):
            for k in range(len(values)):
                row = values[k, top + i, left + first : left + end]
                for m in range(wanted):
                    result[n, m, k] += _scalar_product(weights[n, m, i, first:end], row)
    return result


@njit(**KERNEL)
def _forms(sigma: Array, at: Index, weights: Array, down: Array, across: Array) -> Array:
    """Quadratic forms (n, m, m) of weights (n, m, high, wide), times sigma, with a correlation of points.

    down, across : (term, lag) — factors of the correlation along columns and rows, for points so many apart

    What of a window lies on the grid is laid out row after row with zeros between, so that sums along rows and columns
    are long loops.
    """
    wanted, high, wide = weights.shape[1:]
    gap = across.shape[1] - 1
    result = np.full((len(at), wanted, wanted), np.nan)
    room = high * (wide + gap)
    scaled, half, full = np.empty((wanted, room)), np.empty(room), np.empty(room)
    for n in range(len(at)):
        if np.isnan(weights[n, 0, high // 2, wide // 2]):
            continue
        size, pitch = _lay_out(weights[n], sigma, at[n], gap, scaled)
        for a in range(wanted):
            for b in range(a + 1):
                result[n, a, b] = 0.0
        for term in range(len(down)):
            for a in range(wanted):
                _correlate(scaled[a, :size], down[term], pitch, half)
                _correlate(half[:size], across[term], 1, full)
                for b in range(a + 1):
                    result[n, a, b] += _scalar_product(full[:size], scaled[b])
        for a in range(wanted):
            for b in range(a):
                result[n, b, a] = result[n, a, b]
    return result


@njit(**INNER)
def _lay_out(weights: Array, sigma: Array, centre: Index, gap: int, scaled: Array) -> tuple[int, int]:
    """Set weights (m, high, wide) times the sigma of their points, as far as these lie on the grid.

    gap : number of zeros after each row. Returns the number of elements, and that from one row to the next.
    """
    wanted, high, wide = weights.shape
    top, left = centre[0] - high // 2, centre[1] - wide // 2
    first_row, end_row = _on_grid(centre[0], high, sigma.shape[0])
    first, end = _on_grid(centre[1], wide, sigma.shape[1])
    pitch = end - first + gap
    for m in range(wanted):
        for i in range(first_row, end_row):
            start = (i - first_row) * pitch - first
            for j in range(first, end):
                scaled[m, start + j] = weights[m, i, j] * sigma[top + i, left + j]
            for j in range(end, end + gap):
                scaled[m, start + j] = 0.0
    return (end_row - first_row) * pitch, pitch


@njit(**INNER)
def _correlate(values: Array, lags: Array, stride: int, result: Array) -> None:
    """Set the sums over the values (n,) around each, weighted by their distance in strides."""
    for k in range(len(values)):
        result[k] = lags[0] * values[k]
    for lag in range(1, len(lags)):
        away, factor = lag * stride, lags[lag]
        _add(result, factor, values[away:])
        _add(result[away:], factor, values)


@njit(**INNER)
def _add(result: Array, factor: float, values: Array) -> None:
    """Add values times a factor, as far as both arrays reach."""
    for k in range(min(len(result), len(values))):
        result[k] += factor * values[k]


@njit(fastmath={"reassoc"}, **INNER)
def _scalar_product(first: Array, second: Array) -> float:
    """Sum of the products of the elements, in an order that vectorises."""
    total = 0.0
    for k in range(len(first)):
        total += first[k] * second[k]
    return total
