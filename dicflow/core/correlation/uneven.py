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

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Image, Index, Mask
from dicflow.core.cholesky import factorise, solve
from dicflow.core.correlation.misfit import Residuals
from dicflow.core.kernels import INNER
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
    cell = ((fit.offsets + size // 2) * _CELLS // size) @ [1, _CELLS]
    by_cell = np.argsort(cell, kind="stable")
    first = np.searchsorted(cell[by_cell], np.arange(_CELLS**2 + 1))
    columns = np.concatenate([fit.jacobian, np.stack([np.ones_like(fit.f), fit.f, fit.residual])])
    weighted = (np.sqrt(fit.weight) * columns)[..., by_cell].transpose(1, 0, 2)
    spread = np.zeros(len(fit.f))
    _spread(np.ascontiguousarray(weighted, dtype=np.float32), first, _PARTS, _GROUPS, spread)
    return spread


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
_FIRST_HALF = int(_GROUPS.max()) - 7
"""First group of the halves."""


@njit(cache=True, nogil=True, error_model="numpy")
def _spread(columns: Image, first: Index, parts: Mask, groups: Index, spread: Array) -> None:
    """The loop of :func:`uneven_variance` over subsets.

    columns : (n, term, pixel) — derivatives by the warp, 1, grey levels and residuals, times the roots of weights
    first : (cell + 1,) — first pixel of each cell
    """
    terms = columns.shape[1] - 1
    sums, rest = np.empty((len(first), terms + 1, terms + 1)), np.empty((terms + 1, terms + 1))
    rows, whole, place = np.empty((2, terms)), np.empty((2, 2)), np.empty((2, 2))
    shifts, expected = np.empty(int(groups.max()) + 1), np.empty(int(groups.max()) + 1)
    for k in range(len(columns)):
        _products(columns[k], first, sums)
        _leave_out(sums, parts[0], 0, rest)
        if not _place(rest, rows, whole):
            continue
        for group in range(len(shifts)):
            shifts[group], expected[group] = 0.0, 0.0
        variance = sums[-1, terms, terms] / sums[-1, terms - 2, terms - 2]
        for b in range(len(parts)):
            if not (_leave_out(sums, parts[b], len(first) - 1, rest) and _place(rest, rows, place)):
                continue
            if place[0, 1] + place[1, 1] < _MAX_RATIO * (whole[0, 1] + whole[1, 1]):
                for axis in range(2):
                    shifts[groups[b]] += (place[axis, 0] - whole[axis, 0]) ** 2
                    expected[groups[b]] += variance * (place[axis, 1] - whole[axis, 1])
        spread[k] = _largest(shifts, expected)


@njit(error_model="numpy", **INNER)
def _largest(shifts: Array, expected: Array) -> float:
    """The largest sum of squares of shifts among the groups of parts where they count."""
    largest = 0.0
    for group in range(len(shifts)):
        if shifts[group] > _LIMITS[min(group, 2)] * expected[group]:
            largest = max(largest, (1.0 if group < _FIRST_HALF else _HALVES_SHARE) * shifts[group])
    return largest


@njit(error_model="numpy", **INNER)
def _leave_out(sums: Array, part: Mask, cells: int, rest: Array) -> bool:
    """The products over all pixels without a part's among the first cells, into ``rest``; False where few are left."""
    size = len(rest)
    for i in range(size):
        for j in range(i + 1):
            rest[i, j] = sums[-1, i, j]
    for c in range(cells):
        if part[c]:
            for i in range(size):
                for j in range(i + 1):
                    rest[i, j] -= sums[c, i, j]
    ones = size - 3
    return bool(rest[ones, ones] > _MIN_SHARE * sums[-1, ones, ones])


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _products(columns: Image, first: Index, sums: Array) -> None:
    """Products of columns (term, pixel) over each cell, then over all: lower triangles (cell + 1, term, term)."""
    for i in range(len(columns)):
        for j in range(i + 1):
            sums[-1, i, j] = 0.0
    for c in range(len(first) - 1):
        for i in range(len(columns)):
            for j in range(i + 1):
                product = np.float32(0.0)
                for p in range(first[c], first[c + 1]):
                    product += columns[i, p] * columns[j, p]
                sums[c, i, j] = product
                sums[-1, i, j] += product


@njit(error_model="numpy", **INNER)
def _place(products: Array, rows: Array, out: Array) -> bool:
    """Shift of the centre along x and y, and its variance for noise of one grey level, into ``out`` (2, 2).

    products : (terms + 1, terms + 1) — of the columns; replaced by a factor
    Returns False where the pixels do not determine a place.
    """
    terms = len(products) - 1
    if not factorise(products[:terms, :terms], _MIN_PIVOT_SHARE):
        return False
    for axis in range(2):
        centre = axis * (terms - 2) // 2
        for i in range(terms):
            rows[axis, i] = 1.0 if i == centre else 0.0
        solve(products[:terms, :terms], rows[axis])
        out[axis, 0], out[axis, 1] = 0.0, rows[axis, centre]
        for i in range(terms):
            out[axis, 0] += rows[axis, i] * products[terms, i]
    return True
