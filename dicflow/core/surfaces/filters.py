"""Moving windows over a field: fills of missing values, and local polynomial fits with their gradient.

The local polynomial is the filter of Savitzky & Golay (1964), Anal. Chem. 36:1627, in two dimensions and for fields
with holes: at every point a polynomial is fitted to what is valid inside the window around it, and evaluated at the
point. Every point has a window of its own and the input is never written to, so the result depends on no order. With
the tricube kernel it is the local regression of Cleveland (1979), J. Am. Stat. Assoc. 74:829.

The normal equations of all windows at once are correlations of the field with the separable kernels k(u) uᵃ · k(v) vᵇ;
each point then takes one small Cholesky solution.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import cv2
import numpy as np
from numba import njit
from numpy.typing import ArrayLike

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.cholesky import factorise, solve_columns

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

_SINGULAR = 1e-9
"""A pivot below this share of its diagonal element means that the points do not determine the polynomial."""


class Filled(NamedTuple):
    """A field without holes.

    values : (row, col, …)
    filled : (row, col) bool — was missing and has a value now
    """

    values: Array
    filled: Mask


class LocalFit(NamedTuple):
    """Local polynomials, evaluated at the centre of their windows; NaN where the window holds too few points.

    value : (row, col, …)
    d_row, d_col : (row, col, …) — derivative per row and per column
    leverage : (row, col) — weight of the centre in its own value; for the box kernel also Var(value) / Var(data)
    """

    value: Array
    d_row: Array
    d_col: Array
    leverage: Array


class SlopeWeights(NamedTuple):
    """By what weights the slopes of local polynomials add up their data: Σₙ wₙ zₙ over the window around each point.

    wₙ is the data's weight times Σᵢ factors[row, col, slope, i] · terms[i, row of the window, column of it].

    factors : (row, col, 2, i) — slope 0 per column, 1 per row; NaN where the points do not determine them
    terms : (i, window rows, window columns)
    """

    factors: Array
    terms: Array


def fill_moving_mean(values: ArrayLike, window: int, passes: int = 5, inside: Mask | None = None) -> Filled:
    """Fill missing points with the mean of a moving window, along columns and then along rows, several times.

    values : (row, col) or (row, col, k) — a point with any NaN is missing
    window : length of the window [points]; of an even one, the larger half lies before the point
    passes : how often; a hole wider than ``passes`` windows stays open
    inside : (row, col) bool — where to fill; everywhere if absent
    """
    field: Array = np.array(values, dtype=np.float64)
    planes = field.reshape(*field.shape[:2], -1)
    missing = np.isnan(planes).any(axis=2)
    planes[missing] = np.nan
    fillable: Mask = np.logical_and(missing, True if inside is None else inside)
    still: Mask = fillable.copy()
    for axis in (0, 1) * passes:
        if not still.any():
            break
        lines = np.flatnonzero(still.any(axis=axis))
        means = _moving_mean(planes.take(lines, axis=1 - axis), window, axis)
        row, col = np.nonzero(still.take(lines, axis=1 - axis))
        at = (row, lines[col]) if axis == 0 else (lines[row], col)
        planes[at] = means[row, col]
        still[at] = np.isnan(means[row, col, 0])
    return Filled(field, np.logical_and(fillable, ~still))


def _moving_mean(planes: Array, window: int, axis: int) -> Array:
    """Mean of the valid points in a window along one axis of (row, col, k); NaN where there is none."""
    valid = np.isfinite(planes[..., 0])
    count = _moving_sum(valid.astype(np.float64), window, axis)
    total = _moving_sum(np.where(valid[..., None], planes, 0.0), window, axis)
    return np.where(count[..., None] > 0.5, total / np.maximum(count, 1.0)[..., None], np.nan)


def _moving_sum(field: Array, window: int, axis: int) -> Array:
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
    """Which points (row, col) lie in the mask or at most ``distance`` points from one that does."""
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
    kernel : weight within the window: 1, or the tricube (1 − |u|³)³ (1 − |v|³)³ with u, v = ±1 just beyond its edge
    weights : (row, col) — a further weight of each point
    margin : a window counts with at least ``margin`` points per coefficient

    Also points that are missing themselves get a value where their window holds enough points.
    Raises ValueError for an even window or a degree out of range.
    """
    if window[0] % 2 == 0 or window[1] % 2 == 0 or not 0 <= degree <= 5:
        raise ValueError(f"expected odd windows and a degree of 0 to 5, got {window} and {degree}")
    field = np.asarray(values, dtype=np.float64)
    data = field.reshape(*field.shape[:2], -1)
    valid: Mask = np.asarray(np.isfinite(data).all(axis=2))
    weight: Array = np.where(valid, 1.0 if weights is None else np.asarray(weights, np.float64), 0.0)
    centre = data[valid].mean(axis=0) if valid.any() else np.zeros(data.shape[2])
    powers = _powers(degree)
    normal = _moments(weight, window, 2 * degree, kernel)
    centred: Array = np.where(valid[..., None], data - centre, 0.0) * weight[..., None]
    right = np.stack([_moments(centred[..., plane], window, degree, kernel) for plane in range(data.shape[2])])
    count = _moments(np.sign(weight), window, 0, "box")[0]
    solved = _solve_all(normal, right, _pairs(powers, degree), count, margin * len(powers))
    half = (np.array(window) + 1.0) / 2.0
    middle = _kernel_weights(window[0], kernel).max() * _kernel_weights(window[1], kernel).max()
    value, d_row, d_col = (solved[:, :, index, :-1].reshape(field.shape) for index in range(3))
    return LocalFit(
        value + centre.reshape(field.shape[2:]), d_row / half[0], d_col / half[1], solved[:, :, 0, -1] * weight * middle
    )


def slope_weights(weights: Array, window: tuple[int, int], degree: int) -> SlopeWeights:
    """The weights by which :func:`local_polynomial` with a box kernel finds its slopes.

    weights : (row, col) — of each point, 0 where it is missing
    window, degree : as there; the degree is 1 at least
    """
    powers = _powers(degree)
    down, across = _offsets(window[0]), _offsets(window[1])
    terms = np.stack([np.outer(down**a, across**b) for a, b in powers])
    moments = _moments(weights, window, 2 * degree, "box")[_pairs(powers, degree)]
    normal = np.moveaxis(moments, (0, 1), (-2, -1))
    diagonal = np.einsum("...ii->...i", normal)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = normal * scale[..., :, None] * scale[..., None, :]
    solvable = np.linalg.eigvalsh(scaled)[..., 0] > _SINGULAR
    inverse = np.linalg.inv(np.where(solvable[..., None, None], scaled, np.eye(len(powers))))
    factors = (inverse * scale[..., :, None] * scale[..., None, :])[..., [2, 1], :]
    factors /= (np.array(window)[::-1, None] + 1.0) / 2.0
    factors[~solvable] = np.nan
    return SlopeWeights(factors, terms)


def _powers(degree: int) -> list[tuple[int, int]]:
    """Exponents (a, b) of rowᵃ colᵇ by total degree: (0, 0), (1, 0), (0, 1), (2, 0), …"""
    return [(total - b, b) for total in range(degree + 1) for b in range(total + 1)]


def _pairs(powers: list[tuple[int, int]], degree: int) -> Index:
    """(n, n) — which moment of the weights is element (i, j) of the normal matrix."""
    index = {power: i for i, power in enumerate(_powers(2 * degree))}
    return np.array([[index[a + c, b + d] for c, d in powers] for a, b in powers], dtype=np.int64)


def _kernel_weights(size: int, kernel: Kernel) -> Array:
    if kernel == "box":
        return np.ones(size)
    return (1.0 - np.abs(_offsets(size)) ** 3) ** 3


def _offsets(size: int) -> Array:
    """Places of a window's points, scaled so that ±1 lies one point beyond its edge."""
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
    return np.asarray(cv2.sepFilter2D(field, cv2.CV_64F, along_row, along_col, borderType=cv2.BORDER_CONSTANT))


@njit(cache=True, nogil=True)
def _solve_all(normal, right, pairs, count, needed):  # type: ignore[no-untyped-def]
    """Coefficients of 1, row and col for every point and data plane, and last the same for a unit pulse at the centre.

    normal : (moment, row, col), right : (k, n, row, col), pairs : (n, n), count : (row, col)
    Returns (row, col, 3, k + 1); a gradient of degree 0 is 0.
    """
    rows, cols = count.shape
    planes, n = right.shape[0], right.shape[1]
    solved = np.full((rows, cols, 3, planes + 1), np.nan)
    matrix = np.empty((n, n))
    side = np.zeros((n, planes + 1))
    for row in range(rows):
        for col in range(cols):
            if count[row, col] < needed - 0.5:
                continue
            for i in range(n):
                for j in range(i + 1):
                    matrix[i, j] = normal[pairs[i, j], row, col]
                for plane in range(planes):
                    side[i, plane] = right[plane, i, row, col]
                side[i, planes] = 1.0 if i == 0 else 0.0
            if factorise(matrix, _SINGULAR):
                solve_columns(matrix, side)
                for i in range(3):
                    for plane in range(planes + 1):
                        solved[row, col, i, plane] = side[i, plane] if i < n else 0.0
    return solved
