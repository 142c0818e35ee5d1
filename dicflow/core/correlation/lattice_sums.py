"""Sums over the squares around the points of a lattice, of which the normal equations of whole subsets are made.

Squares of neighbouring points share most of their pixels, and a monomial of the offsets is a power along the row times
one along the column. So the pixels of a row are summed for all squares that it crosses, and these sums then along the
columns, instead of all pixels of each square.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Image, Index, Mask, all_finite
from dicflow.core.kernels import INNER, KERNEL
from dicflow.core.photographs.interpolate import FAST_MATH
from dicflow.core.threads import over

__all__ = ["NO_SUMS", "LatticeSums", "index_of_sums", "lattice_sums", "sum_count"]

_SIDE_PER_STEP, _STEPS_FOR_COLUMNS = 2.2, 1.6
"""Sums over a full lattice take as long as those over each square alone where a square's side is so many times the
step of the lattice, longer by the steps that stand for the sums along columns."""
_MOST_VALUES = 2**25
"""More would take too much memory: these are 134 MB."""
_SLOPES, _SQUARES = 4, 3
"""Products that are summed: fx, fy, fx f, fy f, and fx², fx fy, fy²."""
_EVERY = 8
"""Of so many rows and columns one gives the mean grey level."""
_AT_ONCE = 4
"""Rows or columns that are added at once: to load and store a sum takes longer than to add to it."""


class LatticeSums(NamedTuple):
    """Sums over squares of pixels around the points of a lattice.

    values : (rows · cols, sums) float32 — Σ w a m, for a = fx, fy, fx f', fy f' with the monomials m = 1, ξ, η, ξ², …
        of a warp in offsets of half sides, then for a = fx², fx fy, fy² with those up to twice its degree
    level : f' = f − level [grey levels]: that is small against f where contrast is low, so that rounding is
    weight : (size,) — of a pixel by its place along either side of a square
    shape : (rows, cols) of the lattice
    left, top : of the first point [px]; step : from a point to the next [px]
    """

    values: Image
    level: float
    weight: Array
    shape: tuple[int, int]
    left: int
    top: int
    step: int


NO_SUMS = LatticeSums(np.zeros((0, 0), dtype=np.float32), 0.0, np.zeros(0), (0, 0), 0, 0, 1)
"""Of no square."""


def lattice_sums(
    images: tuple[Image, Image, Image], centres: Array, weight: Array, degree: int, threads: int = 1
) -> LatticeSums:
    """The sums for points of a lattice whose squares lie in the images; none where this is not worth it.

    images : (height, width) each — grey levels f and their derivatives fx, fy
    centres : (rows, cols, 2) — whole pixels, the centres of the squares; NaN for none
    weight : (size,) — of a pixel by its place along either side of a square
    degree : of the warp, 1 or 2
    threads : how many share the rows; the result does not depend on it
    """
    half, known = len(weight) // 2, all_finite(centres)
    found = _lattice(centres, known, half, images[0].shape) if known.sum() > 1 else None
    if found is None:
        return NO_SUMS
    x, y, step = found
    points, count = len(y) * len(x), sum_count(degree)
    is_worth_it = points * _SIDE_PER_STEP * (step + _STEPS_FOR_COLUMNS) < len(weight) * known.sum()
    if not is_worth_it or points * count > _MOST_VALUES:
        return NO_SUMS
    values, powers = np.empty((len(y), len(x), count), dtype=np.float32), _powers(weight, degree)
    level = float(images[0][::_EVERY, ::_EVERY].mean())

    def fill(rows: Index) -> None:
        corner = int(y[rows[0]]) - half, int(x[0]) - half
        _set_sums(images, level, corner, step, powers, values[rows[0] : rows[-1] + 1])

    over(threads, fill, np.array_split(np.arange(len(y)), min(threads, len(y))))
    return LatticeSums(values.reshape(-1, count), level, weight, values.shape[:2], int(x[0]), int(y[0]), step)


def sum_count(degree: int) -> int:
    """How many sums a square has, for a warp of a degree."""
    return _SLOPES * _monomials(degree) + _SQUARES * _monomials(2 * degree)


def _powers(weight: Array, degree: int) -> Image:
    """Weights times powers of the offset from the centre in half sides (2 degree + 1, pixel), and a few zeros."""
    half = len(weight) // 2
    offset = np.arange(-half, half + 1) / half
    powers = np.stack([weight * offset**power for power in range(2 * degree + 1)]).astype(np.float32)
    return np.pad(powers, ((0, 0), (0, -len(weight) % _AT_ONCE)))


def _lattice(centres: Array, known: Mask, half: int, shape: tuple[int, ...]) -> tuple[Index, Index, int] | None:
    """x and y of the lines of the lattice of known points whose squares lie in an image, and their distance [px].

    half : pixels from a centre to a side; None without such a lattice
    """
    index, places = np.argwhere(known)[:, ::-1], centres[known]
    span = np.ptp(index, axis=0)
    axis = int(span.argmax())
    step = float(np.ptp(places[:, axis]) / span[axis])
    first = places[0] - step * index[0]
    if step < 1.0 or step % 1.0 or (first % 1.0).any() or (places != first + step * index).any():
        return None
    lines = [np.arange(low, high + 1, step) for low, high in zip(places.min(axis=0), places.max(axis=0), strict=True)]
    x, y = (
        line[(line >= half) & (line < side - half)].astype(np.int64)
        for line, side in zip(lines, shape[::-1], strict=True)
    )
    return (x, y, int(step)) if len(x) and len(y) else None


def _monomials(degree: int) -> int:
    """How many there are up to a degree."""
    return (degree + 1) * (degree + 2) // 2


@njit(error_model="numpy", **INNER)
def index_of_sums(sums: LatticeSums, row: int, col: int) -> int:
    """Index of the sums of the square around a pixel; -1 where they are not known."""
    (rows, cols), down, right = sums.shape, row - sums.top, col - sums.left
    if down < 0 or right < 0 or down % sums.step != 0 or right % sums.step != 0:
        return -1
    i, j = down // sums.step, right // sums.step
    return i * cols + j if i < rows and j < cols else -1


@njit(fastmath=FAST_MATH, error_model="numpy", **KERNEL)
def _set_sums(
    images: tuple[Image, Image, Image], level: float, corner: tuple[int, int], step: int, powers: Image, values: Image
) -> None:
    """Set the sums (rows, cols, sums) of squares, the first of which has its corner at a pixel (row, col).

    images, level : f, fx, fy (height, width) and what is subtracted from f [grey levels]
    step : from a square to the next [px]
    powers : (2 degree + 1, size) — of offsets along a side, times the weight; with zeros, up to a multiple of _AT_ONCE

    The sums along rows are kept for as many rows as a square has.
    """
    (rows, cols, count), size, degree = values.shape, powers.shape[1], len(powers) // 2
    height, done = images[0].shape[0] - corner[0], 0
    of_rows = np.zeros((size, _SLOPES * (degree + 1) + _SQUARES * len(powers), cols), np.float32)
    products = np.zeros((_SLOPES + _SQUARES, step, cols + (size - 1) // step), np.float32)
    total = np.empty((count, cols), np.float32)
    for i in range(rows):
        top = i * step
        for y in range(max(done, top), min(top + size, height)):
            _set_products(images, np.float32(level), (corner[0] + y, corner[1]), products)
            _sum_along_row(products, powers, of_rows[y % size])
        done = top + size
        total[:] = np.float32(0)
        for k in range(0, size, _AT_ONCE):
            _add_rows(of_rows, top, k, powers, total)
        for j in range(cols):
            for m in range(count):
                values[i, j, m] = total[m, j]


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _set_products(
    images: tuple[Image, Image, Image], level: np.float32, first: tuple[int, int], products: Image
) -> None:
    """Set the products at the pixels of a row (product, phase, n), those that are a step apart side by side.

    first : its number, and the first of the pixels
    """
    (row, left), step, count = first, products.shape[1], products.shape[2]
    f, fx, fy = images[0][row], images[1][row], images[2][row]
    for phase in range(step):
        for n in range(min(count, (len(f) - left - phase + step - 1) // step)):
            at = left + n * step + phase
            products[0, phase, n], products[1, phase, n] = fx[at], fy[at]
            products[2, phase, n], products[3, phase, n] = fx[at] * (f[at] - level), fy[at] * (f[at] - level)
            products[4, phase, n], products[5, phase, n] = fx[at] * fx[at], fx[at] * fy[at]
            products[6, phase, n] = fy[at] * fy[at]


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _sum_along_row(products: Image, powers: Image, sums: Image) -> None:
    """Set the sums (product and power, square) over the pixels of one row in each square."""
    step, degree, at = products.shape[1], len(powers) // 2, 0
    sums[:] = np.float32(0)
    for product in range(len(products)):
        for power in range((degree if product < _SLOPES else 2 * degree) + 1):
            for j in range(0, powers.shape[1], _AT_ONCE):
                a, b, c, d = j, j + 1, j + 2, j + 3
                _add(
                    sums[at],
                    powers[power, j : j + _AT_ONCE],
                    products[product, a % step, a // step :],
                    products[product, b % step, b // step :],
                    products[product, c % step, c // step :],
                    products[product, d % step, d // step :],
                )
            at += 1


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _add_rows(of_rows: Image, top: int, k: int, powers: Image, total: Image) -> None:
    """Add the sums along the k-th to (k + 3)-th rows of squares to those of all pixels (sum, square).

    of_rows : (row modulo its length, product and power, square); top : the squares' first row
    """
    degree, size, at, out = len(powers) // 2, len(of_rows), 0, 0
    a, b = of_rows[(top + k) % size], of_rows[(top + k + 1) % size]
    c, d = of_rows[(top + k + 2) % size], of_rows[(top + k + 3) % size]
    for product in range(_SLOPES + _SQUARES):
        highest = degree if product < _SLOPES else 2 * degree
        for both in range(highest + 1):
            for down in range(both + 1):
                m = at + both - down
                _add(total[out], powers[down, k : k + _AT_ONCE], a[m], b[m], c[m], d[m])
                out += 1
        at += highest + 1


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _add(total: Image, w: Image, a: Image, b: Image, c: Image, d: Image) -> None:
    """Add four rows of numbers with their weights w (4,)."""
    for k in range(len(total)):
        total[k] += (w[0] * a[k] + w[1] * b[k]) + (w[2] * c[k] + w[3] * d[k])
