"""Moving windows over a field: fills of missing values, and local polynomial fits with their gradient.

The local polynomial is the filter of Savitzky & Golay (1964), Anal. Chem. 36:1627, in two dimensions and for fields
with holes: at every point a polynomial is fitted to the valid points of the window around it and evaluated at its
centre. With the tricube kernel it is the local regression of Cleveland (1979), J. Am. Stat. Assoc. 74:829.

The normal equations of all windows are correlations of the field with the separable kernels k(u) uᵃ · k(v) vᵇ. Whole
windows share their matrix; every other point needs one small Cholesky solution.
"""

from __future__ import annotations

from functools import cache
from typing import Literal, NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.cholesky import factorise, solve_columns
from dicflow.core.kernels import INNER, KERNEL

__all__ = [
    "Filled",
    "Kernel",
    "LocalFit",
    "SlopeWeights",
    "fill_moving_mean",
    "local_polynomial",
    "odd_window",
    "slope_weights",
    "within_reach",
]

Kernel = Literal["box", "tricube"]

_MIN_PIVOT_SHARE = 1e-9
"""Least pivot as a share of its diagonal element; below it the points do not determine the polynomial."""


class Filled(NamedTuple):
    """A field after its holes are filled.

    values : (row, col, …)
    filled : (row, col) bool — points that were missing and are filled
    """

    values: Array
    filled: Mask


class LocalFit(NamedTuple):
    """Local polynomials at the centres of their windows; NaN where the window holds too few points.

    value : (row, col, …)
    d_row, d_col : (row, col, …) — derivative per row and per column
    leverage : (row, col) — weight of the centre in its own value; for the box kernel also Var(value) / Var(data)
    """

    value: Array
    d_row: Array
    d_col: Array
    leverage: Array


class SlopeWeights(NamedTuple):
    """Weights wₙ of the data zₙ in the slopes of local polynomials, Σₙ wₙ zₙ over the window around each point.

    wₙ is the data's own weight times Σᵢ factors[row, col, slope, i] · terms[i, window row, window column].

    factors : (row, col, 2, i) — slope 0 per column, 1 per row; NaN where the points do not determine the polynomial
    terms : (i, window rows, window columns)
    """

    factors: Array
    terms: Array


def fill_moving_mean(values: ArrayLike, window: int, passes: int = 5, inside: Mask | None = None) -> Filled:
    """Fill missing points with the mean of a moving window, in several passes along columns and rows in turn.

    values : (row, col) or (row, col, k) — a point with any NaN is missing
    window : length of the window [points]; the larger half of an even window lies before the point
    passes : number of passes; a hole wider than ``passes`` windows is not filled completely
    inside : (row, col) bool — points to fill; all if absent
    """
    field: Array = np.array(values, dtype=np.float64)
    planes = field.reshape(*field.shape[:2], -1)
    missing = np.isnan(planes).any(axis=2)
    planes[missing] = np.nan
    fillable: Mask = np.logical_and(missing, True if inside is None else inside)
    remaining: Mask = fillable.copy()
    for axis in (0, 1) * passes:
        if not remaining.any():
            break
        lines = np.flatnonzero(remaining.any(axis=axis))
        means = _moving_mean(planes.take(lines, axis=1 - axis), window, axis)
        row, col = np.nonzero(remaining.take(lines, axis=1 - axis))
        at = (row, lines[col]) if axis == 0 else (lines[row], col)
        planes[at] = means[row, col]
        remaining[at] = np.isnan(means[row, col, 0])
    return Filled(field, np.logical_and(fillable, ~remaining))


def _moving_mean(planes: Array, window: int, axis: int) -> Array:
    """Mean of the valid points in a window along one axis of (row, col, k); NaN for a window without valid points."""
    valid = np.isfinite(planes[..., 0])
    count = _moving_sum(valid.astype(np.float64), window, axis)
    total = _moving_sum(np.where(valid[..., None], planes, 0.0), window, axis)
    return np.where(count[..., None] > 0.5, total / np.maximum(count, 1.0)[..., None], np.nan)


def _moving_sum(field: Array, window: int, axis: int) -> Array:
    """Sum over a window along one axis; points outside the field count as 0."""
    size, anchor = ((1, window), (0, window // 2)) if axis == 0 else ((window, 1), (window // 2, 0))
    sums = cv2.boxFilter(field, cv2.CV_64F, size, anchor=anchor, normalize=False, borderType=cv2.BORDER_CONSTANT)
    return np.asarray(sums).reshape(field.shape)


def odd_window(window_px: tuple[float, float], step_px: float = 1.0) -> tuple[int, int]:
    """Points per side of a window given in pixels: the nearest odd number, at least 3.

    window_px : (rows, cols) [px]
    step_px : distance of the grid's points [px]

    >>> odd_window((80.0, 20.0), 5.0)
    (17, 5)
    """
    rows, cols = (max(3, 2 * int(side / step_px / 2.0) + 1) for side in window_px)
    return rows, cols


def within_reach(mask: ArrayLike, distance: float) -> Mask:
    """Which points (row, col) are at most ``distance`` [points] from the mask, those in it included."""
    inside: Mask = np.array(mask, dtype=np.bool_)
    if not inside.any():
        return inside
    away = cv2.distanceTransform((~inside).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
    return np.asarray(away <= distance)


def local_polynomial(
    values: ArrayLike,
    window: tuple[int, int],
    degree: int,
    *,
    kernel: Kernel = "box",
    weights: ArrayLike | None = None,
    margin: float = 1.5,
) -> LocalFit:
    """Fit a polynomial to the valid points of the window around every point.

    values : (row, col) or (row, col, k) — a point with any NaN is missing
    window : (rows, cols), odd numbers of points; at edges and holes the fit uses what lies inside
    degree : largest total degree a + b of the terms rowᵃ colᵇ, 0 … 5
    kernel : weight within the window: 1, or the tricube (1 − |u|³)³ (1 − |v|³)³ with u, v = ±1 one point beyond it
    weights : (row, col) — additional weight of each point
    margin : least number of points in a window per coefficient

    Missing points get a value too, where their window holds enough points.
    Raises ValueError for an even window or a degree out of range.
    """
    if window[0] % 2 == 0 or window[1] % 2 == 0 or not 0 <= degree <= 5:
        raise ValueError(f"expected odd windows and a degree of 0 to 5, got {window} and {degree}")
    field = np.asarray(values, dtype=np.float64)
    data = np.ascontiguousarray(np.moveaxis(field.reshape(*field.shape[:2], -1), 2, 0))
    valid: Mask = np.asarray(np.isfinite(data).all(axis=0))
    weight: Array = np.where(valid, 1.0 if weights is None else np.asarray(weights, np.float64), 0.0)
    known: Array = np.where(valid, data, 0.0)
    centre = known.sum(axis=(1, 2)) / max(int(valid.sum()), 1)
    powers = _powers(degree)
    normal = _moments(weight, window, 2 * degree, kernel)
    count = normal[0] if weights is None and kernel == "box" else _moments(np.sign(weight), window, 0, "box")[0]
    solved, leverage = _solve_all(
        normal,
        np.stack([_moments(plane, window, degree, kernel) for plane in (known - centre[:, None, None]) * weight]),
        _moment_indices(powers, degree),
        count,
        margin * len(powers),
        _of_whole_window(window, degree, kernel),
        float(window[0] * window[1]) if weights is None and min(window) > degree else np.inf,
    )
    half = (np.array(window) + 1.0) / 2.0
    middle = _kernel_weights(window[0], kernel).max() * _kernel_weights(window[1], kernel).max()
    value, d_row, d_col = (part.reshape(field.shape) for part in solved)
    return LocalFit(
        value + centre.reshape(field.shape[2:]), d_row / half[0], d_col / half[1], leverage * weight * middle
    )


def slope_weights(weights: Array, window: tuple[int, int], degree: int) -> SlopeWeights:
    """The weights of the data in the slopes of :func:`local_polynomial` with the box kernel.

    weights : (row, col) — of each point, 0 where it is missing
    window, degree : as there; the degree is at least 1
    """
    powers = _powers(degree)
    down, across = _offsets(window[0]), _offsets(window[1])
    terms = np.stack([np.outer(down**a, across**b) for a, b in powers])
    moments = _moments(weights, window, 2 * degree, "box")[_moment_indices(powers, degree)]
    normal = np.moveaxis(moments, (0, 1), (-2, -1))
    diagonal = np.einsum("...ii->...i", normal)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = normal * scale[..., :, None] * scale[..., None, :]
    solvable = np.linalg.eigvalsh(scaled)[..., 0] > _MIN_PIVOT_SHARE
    inverse = np.linalg.inv(np.where(solvable[..., None, None], scaled, np.eye(len(powers))))
    factors = (inverse * scale[..., :, None] * scale[..., None, :])[..., [2, 1], :]
    factors /= (np.array(window)[::-1, None] + 1.0) / 2.0
    factors[~solvable] = np.nan
    return SlopeWeights(factors, terms)


def _powers(degree: int) -> list[tuple[int, int]]:
    """Exponents (a, b) of rowᵃ colᵇ by total degree: (0, 0), (1, 0), (0, 1), (2, 0), …"""
    return [(total - b, b) for total in range(degree + 1) for b in range(total + 1)]


def _moment_indices(powers: list[tuple[int, int]], degree: int) -> Index:
    """Indices (n, n) into the moments of the weights for the elements of the normal matrix."""
    index = {power: i for i, power in enumerate(_powers(2 * degree))}
    return np.array([[index[a + c, b + d] for c, d in powers] for a, b in powers], dtype=np.int64)


def _kernel_weights(size: int, kernel: Kernel) -> Array:
    """Weights (size,) of a kernel along one side of a window."""
    if kernel == "box":
        return np.ones(size)
    return (1.0 - np.abs(_offsets(size)) ** 3) ** 3


def _offsets(size: int) -> Array:
    """Coordinates (size,) of a window's points, scaled so that ±1 lies one point beyond its edge."""
    half = size // 2
    return np.arange(-half, half + 1) / (half + 1.0)


def _moments(field: Array, window: tuple[int, int], degree: int, kernel: Kernel) -> Array:
    """Σ field · k(u) uᵃ · k(v) vᵇ over the window around every point, for all a + b ≤ degree; (moment, row, col)."""
    rows, cols = window
    unit = np.ones(1)
    powers = _powers(degree)
    moments = np.empty((len(powers), *field.shape))
    for a in range(degree + 1):
        tall = _correlate(field, unit, _kernel_weights(rows, kernel) * _offsets(rows) ** a)
        for b in range(degree + 1 - a):
            wide = _correlate(tall, _kernel_weights(cols, kernel) * _offsets(cols) ** b, unit)
            moments[powers.index((a, b))] = wide
    return moments


def _correlate(field: Array, along_row: Array, along_col: Array) -> Array:
    """Correlation of a field with a separable kernel; points outside the field count as 0."""
    return np.asarray(cv2.sepFilter2D(field, cv2.CV_64F, along_row, along_col, borderType=cv2.BORDER_CONSTANT))


@cache
def _of_whole_window(window: tuple[int, int], degree: int, kernel: Kernel) -> Array:
    """Weights (n, n) of the moments in the coefficients, for a window whose points are all valid and of weight 1.

    Zeros where a side has too few points for the degree.
    """
    rows, cols = (np.stack([_offsets(side) ** a for a in range(2 * degree + 1)]) for side in window)
    of_rows, of_cols = rows @ _kernel_weights(window[0], kernel), cols @ _kernel_weights(window[1], kernel)
    powers = np.array(_powers(degree))
    if min(window) <= degree:
        return np.zeros((len(powers), len(powers)))
    a, b = np.moveaxis(powers[:, None] + powers, -1, 0)
    return np.asarray(np.linalg.inv(of_rows[a] * of_cols[b]))


@njit(**INNER)
def _multiply(of_whole: Array, moments: Array, coefficients: Array) -> None:
    """The coefficients (3, k, col) of windows along a row as if these were whole; of degree 0 only the first are set.

    of_whole : (n, n) — weights of the moments; moments : (k, n, col)
    """
    planes, n, cols = moments.shape
    for i in range(min(n, 3)):
        for plane in range(planes):
            total = coefficients[i, plane]
            total[:] = 0.0
            for j in range(n):
                weight, values = of_whole[i, j], moments[plane, j]
                for col in range(cols):
                    total[col] += weight * values[col]


@njit(**INNER)
def _solve(normal: Array, indices: Index, moments: Array, matrix: Array, side: Array) -> bool:
    """Solve for the coefficients (n, k + 1) of one window; False where the polynomial is not determined.

    normal : (moment,) of its weights; moments : (k, n)
    matrix : (n, n) — working space; side : set to the coefficients, those of a unit pulse at the centre last
    """
    planes, n = moments.shape
    for i in range(n):
        for j in range(i + 1):
            matrix[i, j] = normal[indices[i, j]]
        for plane in range(planes):
            side[i, plane] = moments[plane, i]
        side[i, planes] = 0.0
    side[0, planes] = 1.0
    if not factorise(matrix, _MIN_PIVOT_SHARE):
        return False
    solve_columns(matrix, side)
    return True


@njit(**KERNEL)
def _solve_all(
    normal: Array, right: Array, indices: Index, count: Array, needed: float, of_whole: Array, whole: float
) -> tuple[Array, Array]:
    """Coefficients of 1, row and col for every point and data plane, and the first of them for a pulse at the centre.

    normal : (moment, row, col); right : (k, n, row, col); indices : (n, n) into the moments
    count : (row, col) — points in the window; needed : least count
    of_whole : (n, n) — weights of the moments in the coefficients where the count is ``whole``
    Returns (3, row, col, k) and (row, col); the gradient of degree 0 is 0; NaN where the polynomial is not determined.
    """
    (planes, n), (rows, cols) = right.shape[:2], count.shape
    solved, leverage = np.full((3, rows, cols, planes), np.nan), np.full((rows, cols), np.nan)
    of_row, matrix, side = np.zeros((3, planes, cols)), np.empty((n, n)), np.zeros((max(n, 3), planes + 1))
    for row in range(rows):
        if count[row].max() > whole - 0.5:
            _multiply(of_whole, right[:, :, row], of_row)
        for col in range(cols):
            if count[row, col] < needed - 0.5:
                continue
            is_whole = count[row, col] > whole - 0.5
            if not is_whole and not _solve(normal[:, row, col], indices, right[:, :, row, col], matrix, side[:n]):
                continue
            for i in range(3):
                for plane in range(planes):
                    solved[i, row, col, plane] = of_row[i, plane, col] if is_whole else side[i, plane]
            leverage[row, col] = of_whole[0, 0] if is_whole else side[0, planes]
    return solved, leverage
