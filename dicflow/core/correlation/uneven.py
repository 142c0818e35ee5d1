"""How much the place of a subset depends on single parts of it.

Grey levels that do not show the material's motion, in a reflection, behind a wire, beyond a crack, where paint has come
off, pull the place of a subset. Without them it would lie elsewhere. So each part of a subset is left out in turn, and
one step of Gauss-Newton from the residuals gives the shift δ of the place. Noise alone makes shifts of the covariance

    σ² ((A − A_b)⁻¹ − A⁻¹)

for the normal matrices A of all pixels and A_b of the part (the jackknife; Tukey, Annals of Mathematical Statistics 29,
1958). Squares beyond that, summed over parts that cover the subset, give the variance of the place by uneven residuals.
The parts are cells, squares of cells, and halves; what disturbs a subset is about as large as one of these.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Image, Index, Mask
from dicflow.core.correlation.residuals import Residuals
from dicflow.core.kernels import INNER, KERNEL, MAKER
from dicflow.core.photographs.interpolate import FAST_MATH

__all__ = ["uneven_variance"]


_CELLS = 6
"""Cells along the side of a subset."""
_LIMITS = (2.5, 3.0, 8.0)
"""Squares of shifts without cells, squares of cells, or a larger part, over their variance by noise as strong as the
residual: above it they count. Residuals of interpolation reach 2."""
_MAX_RATIO = 12.0
"""Variance of a place without a part over that of the whole subset; above it the rest determines no place of its own,
as in a subset that is cut."""
_HALVES_SHARE = 0.25
"""Of the squares of shifts without a half: half of the pixels alone determine a place too badly."""
_MIN_SHARE = 0.45
"""Of the pixels, that must be left."""
_MIN_PIVOT_SHARE = 1e-6
"""With a smaller pivot, the pixels left do not determine a place."""


def uneven_variance(fit: Residuals, size: int) -> Array:
    """Variance (n,) of the places of subsets by residuals that differ from part to part [px²].

    size : side of the subsets [px]
    """
    variance = np.zeros(len(fit.f))
    _spread(fit, _pixels_by_cell(size), size // 2, _CELLS_OF_PARTS, _GROUPS, variance)
    return variance


@cache
def _pixels_by_cell(size: int) -> Index:
    """Numbers of the pixels in each cell (cell, most), filled up by −1."""
    band = np.arange(size) * _CELLS // size
    cell = (band[:, None] * _CELLS + band).reshape(-1)
    counts = np.bincount(cell, minlength=_CELLS**2)
    table = np.full((_CELLS**2, int(counts.max())), -1)
    for k in range(_CELLS**2):
        table[k, : counts[k]] = np.flatnonzero(cell == k)
    return table


def _parts() -> tuple[Mask, Index]:
    """Cells of each part (part, cell), and the group of parts that it belongs to (part,)."""
    i, j = np.divmod(np.arange(_CELLS**2), _CELLS)
    squares, middle = (i // 2) * (_CELLS // 2) + j // 2, (_CELLS - 1) / 2
    cells = [np.arange(_CELLS**2) == k for k in range(_CELLS**2)]
    larger = [squares == k for k in range((_CELLS // 2) ** 2)]
    lines = [sign * line for line in (i - middle, j - middle, i - j, i + j - 2 * middle) for sign in (-1, 1)]
    thirds = [line > np.quantile(line, 0.66) for line in lines]
    halves = [line > 0 for line in lines]
    groups = [0] * len(cells) + [1] * len(larger) + list(range(2, 2 + len(thirds) + len(halves)))
    return np.array(cells + larger + thirds + halves), np.array(groups, dtype=np.int64)


_PARTS, _GROUPS = _parts()
_CELLS_OF_PARTS = np.array(
    [np.pad(np.flatnonzero(part), (0, _CELLS**2 - part.sum()), constant_values=-1) for part in _PARTS]
)
"""Numbers of the cells of each part (part, cell), filled up by −1."""
_FIRST_HALF = int(_GROUPS.max()) - 7
"""First group of the halves."""
_LANES = 64
"""Systems of equations that are solved side by side: one without each part, and that of all pixels."""


@njit(error_model="numpy", **KERNEL)
def _spread(fit: Residuals, pixels: Index, half: int, cells: Index, groups: Index, spread: Array) -> None:
    """The loop of :func:`uneven_variance` over subsets.

    pixels : (cell, most) — of each cell; cells : (part, cell) — of each part; both filled up by −1
    """
    terms, padded = 2 * fit.terms + 2, -(-pixels.shape[1] // 16) * 16
    columns = np.zeros((len(pixels), terms + 1, padded), dtype=np.float32)
    sums, total = np.empty((len(pixels), _pairs(terms + 1))), np.empty(_pairs(terms + 1))
    lanes, usable, places = np.empty((len(total), _LANES)), np.empty(_LANES, dtype=np.bool_), np.empty((4, _LANES))
    shifts, expected = np.empty(int(groups.max()) + 1), np.empty(int(groups.max()) + 1)
    for k in range(len(fit.f)):
        _set_columns(fit, k, pixels, half, columns)
        _products(columns, sums, total)
        _leave_out(sums, total, cells, lanes)
        _solve_lanes(lanes, terms, usable, places)
        if usable[len(cells)]:
            _sum_shifts(places, usable, total, groups, shifts, expected)
            spread[k] = _largest(shifts, expected)


@njit(error_model="numpy", **INNER)
def _pairs(n: int) -> int:
    """Number of elements of a lower triangle."""
    return n * (n + 1) // 2


@njit(error_model="numpy", **INNER)
def _set_columns(fit: Residuals, k: int, pixels: Index, half: int, columns: Image) -> None:
    """The columns of the normal equations of the k-th subset, times the roots of weights: (cell, term, pixel).

    Brightness and contrast come first, the coefficients of the warp except those of the centre, then these, of x and
    of y, and at last the residuals.
    """
    side, terms = 2 * half + 1, fit.terms
    for cell in range(len(pixels)):
        out = columns[cell]
        for i in range(pixels.shape[1]):
            at = pixels[cell, i]
            root = np.sqrt(fit.weight[k, at]) if at >= 0 else np.float32(0.0)
            xi, eta = np.float32((at % side - half) / half), np.float32((at // side - half) / half)
            x, y = root * fit.by_x[k, at], root * fit.by_y[k, at]
            out[0, i], out[1, i], out[2 * terms + 2, i] = root, root * fit.f[k, at], root * fit.residual[k, at]
            out[2, i], out[3, i], out[terms + 1, i], out[terms + 2, i] = x * xi, x * eta, y * xi, y * eta
            if terms == 6:
                out[4, i], out[5, i], out[6, i] = x * xi * xi, x * xi * eta, x * eta * eta
                out[9, i], out[10, i], out[11, i] = y * xi * xi, y * xi * eta, y * eta * eta
            out[2 * terms, i], out[2 * terms + 1, i] = x, y


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _products(columns: Image, sums: Array, total: Array) -> None:
    """Lower triangles of the products of all columns: over each cell (cell, pair), and over all (pair,)."""
    for pair in range(len(total)):
        total[pair] = 0.0
    for cell in range(len(columns)):
        pair = 0
        for i in range(columns.shape[1]):
            for j in range(i + 1):
                product = np.float32(0.0)
                for p in range(columns.shape[2]):
                    product += columns[cell, i, p] * columns[cell, j, p]
                sums[cell, pair] = product
                total[pair] += product
                pair += 1


@njit(error_model="numpy", **MAKER)
def _leave_out(sums: Array, total: Array, cells: Index, lanes: Array) -> None:
    """Products without each part, and in the next lane all of them, into ``lanes`` (pair, lane)."""
    rest = np.empty(len(total))
    for lane in range(_LANES):
        for pair in range(len(rest)):
            rest[pair] = total[pair]
        if lane < len(cells):
            for c in cells[lane]:
                if c < 0:
                    break
                for pair in range(len(rest)):
                    rest[pair] -= sums[c, pair]
        for pair in range(len(rest)):
            lanes[pair, lane] = rest[pair]


@njit(fastmath=FAST_MATH, error_model="numpy", **MAKER)
def _solve_lanes(a: Array, terms: int, usable: Mask, places: Array) -> None:
    """Shifts of the centre along x and y, and their variances for noise of one grey level, into ``places`` (4, lane).

    a : (pair, lane) — normal equations, replaced by Cholesky's factors; the right side is the last row, the centre's
        coefficients are the two before it
    usable : (lane,) — set to False where too few pixels are left, or these determine no place
    """
    for lane in range(_LANES):
        usable[lane] = a[0, lane] > _MIN_SHARE * a[0, _LANES - 1]
    pivot = np.empty(_LANES)
    for j in range(terms):
        first, jj = _pairs(j), _pairs(j) + j
        for lane in range(_LANES):
            pivot[lane] = a[jj, lane]
        for k in range(j):
            _subtract(a, jj, first + k, first + k)
        for lane in range(_LANES):
            is_firm = a[jj, lane] > _MIN_PIVOT_SHARE * pivot[lane]
            usable[lane] &= is_firm
            a[jj, lane] = 1.0 / np.sqrt(a[jj, lane] if is_firm else 1.0)
        for i in range(j + 1, terms + 1):
            for k in range(j):
                _subtract(a, _pairs(i) + j, _pairs(i) + k, first + k)
            for lane in range(_LANES):
                a[_pairs(i) + j, lane] *= a[jj, lane]
    x, y, right = _pairs(terms - 2), _pairs(terms - 1), _pairs(terms)
    for lane in range(_LANES):
        pivot_x, pivot_y, across = a[x + terms - 2, lane], a[y + terms - 1, lane], a[y + terms - 2, lane]
        places[1, lane] = a[right + terms - 1, lane] * pivot_y
        places[0, lane] = (a[right + terms - 2, lane] - across * places[1, lane]) * pivot_x
        places[2, lane] = pivot_x * pivot_x * (1.0 + (across * pivot_y) ** 2)
        places[3, lane] = pivot_y * pivot_y


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _subtract(a: Array, target: int, first: int, second: int) -> None:
    """Subtract the product of two elements from a third one, in all lanes."""
    for lane in range(_LANES):
        a[target, lane] -= a[first, lane] * a[second, lane]


@njit(error_model="numpy", **INNER)
def _sum_shifts(places: Array, usable: Mask, total: Array, groups: Index, shifts: Array, expected: Array) -> None:
    """Set the sums of squares of the shifts without the parts of each group, and what noise makes of them."""
    whole, variance = len(groups), total[-1] / total[0]
    for group in range(len(shifts)):
        shifts[group], expected[group] = 0.0, 0.0
    for b in range(len(groups)):
        if usable[b] and places[2, b] + places[3, b] < _MAX_RATIO * (places[2, whole] + places[3, whole]):
            for axis in range(2):
                shifts[groups[b]] += (places[axis, b] - places[axis, whole]) ** 2
                expected[groups[b]] += variance * (places[2 + axis, b] - places[2 + axis, whole])


@njit(error_model="numpy", **INNER)
def _largest(shifts: Array, expected: Array) -> float:
    """The largest sum of squares of shifts among the groups of parts where they count."""
    largest = 0.0
    for group in range(len(shifts)):
        if shifts[group] > _LIMITS[min(group, 2)] * expected[group]:
            largest = max(largest, (1.0 if group < _FIRST_HALF else _HALVES_SHARE) * shifts[group])
    return largest
