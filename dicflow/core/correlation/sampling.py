"""Grey levels of a target at the pixels of one subset.

From each pixel of a run to the next, the place moves by about one pixel, so that the coefficients lie in a small window
that moves along. Weights are zero there beside a pixel's own coefficients, so that one instruction loads those of many
pixels. The part of the spline around a subset is copied first: the distance of its rows is a constant, which saves
checks whether arrays overlap.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from dicflow.core.arrays import Array, Counts, Image, Index
from dicflow.core.kernels import INNER, MAKER
from dicflow.core.photographs.interpolate import FAST_MATH, PAD, Weights, bicubic, biquintic, quintic_weights

__all__ = [
    "LANES",
    "Places",
    "copy_patch",
    "first_coefficient",
    "locate_pixels",
    "new_places",
    "sample_runs",
    "sample_scattered",
]

LANES = 16
"""Pixels that are sampled at once."""
STRIDE = 208
"""Coefficients from a row of a patch to the next, and most rows; an odd number of cache lines, so that rows do not
displace each other."""

_DRIFT_PX = 2
"""Whole pixels by which the coefficients of a run may move besides the pixels themselves."""
_TAPS = 8
"""Coefficients of a window along one side: 6 of the quintic spline, and _DRIFT_PX."""
_BEFORE = PAD - 2
"""From a pixel to the first of its six coefficients along one side, in a row or column of the spline's."""

Window = tuple[np.float32, np.float32, np.float32, np.float32, np.float32, np.float32, np.float32, np.float32]
"""Weights of the coefficients of a window along one side."""


class Places(NamedTuple):
    """Places of the pixels of one subset in the target, and grey levels there; arrays longer than a subset by LANES.

    x, y : float32 — from the whole pixel before the subset's centre [px]; g : float32 — grey levels
    box : (4,) — least and greatest whole x, least and greatest whole y
    patch : (STRIDE², ) float32 — coefficients around the subset, in rows
    """

    x: Image
    y: Image
    g: Image
    box: Index
    patch: Image


@njit(error_model="numpy", **MAKER)
def new_places(room: int) -> Places:
    """Working space for subsets of so many pixels."""
    x, y, g = np.zeros(room + LANES, np.float32), np.zeros(room + LANES, np.float32), np.zeros(room + LANES, np.float32)
    return Places(x, y, g, np.zeros(4, np.int64), np.zeros(STRIDE * STRIDE, np.float32))


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def locate_pixels(c: Array, shape: tuple[int, int], xi: Image, eta: Image, n: int, half: int, places: Places) -> bool:
    """Set the places of n pixels of a subset by a warp c (2, 6); False where some are outside the target.

    shape : (rows, cols) of the coefficients; xi, eta : offsets of the pixels in half sides
    """
    rows, cols = shape[0] - 2 * PAD, shape[1] - 2 * PAD
    x0, y0 = np.floor(c[0, 0]), np.floor(c[1, 0])
    if not (0.0 <= x0 < cols and 0.0 <= y0 < rows):
        return False
    h = float(half)
    a0, a1, a2 = np.float32(c[0, 0] - x0), np.float32(c[0, 1] * h), np.float32(c[0, 2] * h)
    a3, a4, a5 = np.float32(c[0, 3] * h * h), np.float32(c[0, 4] * h * h), np.float32(c[0, 5] * h * h)
    b0, b1, b2 = np.float32(c[1, 0] - y0), np.float32(c[1, 1] * h), np.float32(c[1, 2] * h)
    b3, b4, b5 = np.float32(c[1, 3] * h * h), np.float32(c[1, 4] * h * h), np.float32(c[1, 5] * h * h)
    left, right, top, bottom = np.int32(0), np.int32(0), np.int32(0), np.int32(0)
    for k in range(n):
        x = a0 + xi[k] * (a1 + a3 * xi[k] + a4 * eta[k]) + eta[k] * (a2 + a5 * eta[k])
        y = b0 + xi[k] * (b1 + b3 * xi[k] + b4 * eta[k]) + eta[k] * (b2 + b5 * eta[k])
        places.x[k], places.y[k] = x, y
        j, i = np.int32(np.floor(x)), np.int32(np.floor(y))
        left, right, top, bottom = min(left, j), max(right, j), min(top, i), max(bottom, i)
    places.box[0], places.box[1], places.box[2], places.box[3] = left, right, top, bottom
    return bool(x0 + left >= 0 and x0 + right < cols and y0 + top >= 0 and y0 + bottom < rows)


@njit(error_model="numpy", **INNER)
def first_coefficient(c: Array, width: int, degree: int) -> int:
    """Index of the first coefficient that belongs to the whole pixel before the centre of a subset.

    c : (2, 6) — warp; width : coefficients per row
    """
    before = PAD - degree // 2
    return (int(c[1, 0]) + before) * width + int(c[0, 0]) + before


@njit(error_model="numpy", **INNER)
def copy_patch(coefficients: Image, c: Array, places: Places) -> bool:
    """Copy the coefficients around a subset that was located by a warp c (2, 6); False if they are too many.

    Beyond the border of the spline, where weights are zero, any numbers remain.
    """
    left, right, top, bottom = places.box
    width, height = right - left + _DRIFT_PX + _TAPS, bottom - top + _DRIFT_PX + _TAPS
    if width + LANES > STRIDE or height > STRIDE:
        return False
    row, col = int(c[1, 0]) + top + _BEFORE - _DRIFT_PX, int(c[0, 0]) + left + _BEFORE - _DRIFT_PX
    up, down = max(0, -row), min(height, coefficients.shape[0] - row)
    before, beyond = max(0, -col), min(width, coefficients.shape[1] - col)
    _copy_rows(coefficients, row + up, col + before, down - up, beyond - before, up * STRIDE + before, places.patch)
    return True


@njit(error_model="numpy", **INNER)
def _copy_rows(image: Image, row: int, col: int, height: int, width: int, at: int, out: Image) -> None:
    """Copy a part of an image into a patch from index ``at`` on; unsigned indices let the compiler copy whole rows."""
    top, left, stride = np.uint64(row), np.uint64(col), np.uint64(STRIDE)
    for i in range(np.uint64(height)):
        first = np.uint64(at) + i * stride
        for j in range(np.uint64(width)):
            out[first + j] = image[top + i, left + j]


@njit(error_model="numpy", **INNER)
def sample_runs(degree: int, c: Array, half: int, row_rest: Counts, n: int, places: Places) -> None:
    """Set the grey levels of n pixels by the copied coefficients, run by run.

    c : (2, 6) — warp; row_rest : for each pixel, how many are left of its row, itself included

    What is set beyond the end of a run, the next one overwrites.
    """
    left, top = places.box[0] - _DRIFT_PX, places.box[2] - _DRIFT_PX
    back_x, run_x = _run(c[0, 1] - 1.0, half * (2.0 * abs(c[0, 3]) + abs(c[0, 4])))
    back_y, run_y = _run(c[1, 1], half * (2.0 * abs(c[1, 3]) + abs(c[1, 4])))
    run, k = min(run_x, run_y), 0
    while k < n:
        x, y = np.floor(places.x[k]) - back_x, np.floor(places.y[k]) - back_y
        at = np.uint64((int(y) - top) * STRIDE + int(x) - left)
        _sample(at, degree, x, y, np.uint64(k), places)
        k += min(run, int(row_rest[k]))


@njit(error_model="numpy", **MAKER)
def sample_scattered(coefficients: Image, c: Array, degree: int, n: int, places: Places) -> None:
    """Set the grey levels of n pixels that were located by a warp c (2, 6), one by one."""
    flat, width = coefficients.ravel(), coefficients.shape[1]
    first = first_coefficient(c, width, degree)
    for k in range(n):
        x, y = np.floor(places.x[k]), np.floor(places.y[k])
        at, t, s = np.uint64(first + int(y) * width + int(x)), places.x[k] - x, places.y[k] - y
        if degree == 3:
            places.g[k] = bicubic(flat, at, np.uint64(width), t, s)
        else:
            places.g[k] = biquintic(flat, at, np.uint64(width), t, s)


@njit(error_model="numpy", **INNER)
def _run(slip: float, spread: float) -> tuple[np.float32, int]:
    """How many of the _DRIFT_PX pixels lie behind the first pixel of a run, and how many pixels a run has at most.

    slip, spread : motion per pixel besides the pixel itself at the centre of the subset, and how much it may differ
    """
    least, most = slip - spread, slip + spread
    back = 0.0 if least >= 0.0 else (_DRIFT_PX if most <= 0.0 else 1.0)
    ahead = (_DRIFT_PX - back) / most if most > 0.0 else np.inf
    behind = back / -least if least < 0.0 else np.inf
    return np.float32(back), 1 + int(min(ahead, behind, LANES - 1.0))


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _sample(
    at: np.uint64,
    degree: int,
    x: np.float32,
    y: np.float32,
    k: np.uint64,
    places: Places,
) -> None:
    """Grey levels of LANES pixels from the k-th on; the window of the first one starts at the place (x, y)."""
    if degree == 3:
        for j in range(np.uint64(LANES)):
            u, v = places.x[k + j] - np.float32(j) - x, places.y[k + j] - y
            t, s = u - np.floor(u), v - np.floor(v)
            across, down = _window(_cubic_weights(t), u - t), _window(_cubic_weights(s), v - s)
            places.g[k + j] = _weighted(places.patch, at + j, across, down)
    else:
        for j in range(np.uint64(LANES)):
            u, v = places.x[k + j] - np.float32(j) - x, places.y[k + j] - y
            t, s = u - np.floor(u), v - np.floor(v)
            across, down = _window(quintic_weights(t), u - t), _window(quintic_weights(s), v - s)
            places.g[k + j] = _weighted(places.patch, at + j, across, down)


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _cubic_weights(t: np.float32) -> Weights:
    """Values at an offset t, 0 … 1, of the four B-splines of degree 3 that are not zero there, between two zeros."""
    sixth, half, two_thirds, one, zero = (
        np.float32(1 / 6),
        np.float32(0.5),
        np.float32(2 / 3),
        np.float32(1),
        np.float32(0),
    )
    r = one - t
    middle, next_one = two_thirds + t * t * (half * t - one), two_thirds + r * r * (half * r - one)
    return zero, sixth * r * r * r, middle, next_one, sixth * t * t * t, zero


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _window(w: Weights, drift: np.float32) -> Window:
    """Weights of a window from those of six coefficients that begin ``drift`` = 0, 1 or 2 after its first one."""
    one, two, zero = np.float32(1), np.float32(2), np.float32(0)
    a = one if drift == zero else zero
    b = one if drift == one else zero
    c = one if drift == two else zero
    return (
        a * w[0],
        a * w[1] + b * w[0],
        a * w[2] + b * w[1] + c * w[0],
        a * w[3] + b * w[2] + c * w[1],
        a * w[4] + b * w[3] + c * w[2],
        a * w[5] + b * w[4] + c * w[3],
        b * w[5] + c * w[4],
        c * w[5],
    )


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _weighted(patch: Image, at: np.uint64, across: Window, down: Window) -> np.float32:
    """Weighted sum of a window of coefficients, from index ``at`` on."""
    width = np.uint64(STRIDE)
    at1 = at + width
    at2 = at1 + width
    at3 = at2 + width
    at4 = at3 + width
    at5 = at4 + width
    at6 = at5 + width
    value: np.float32 = (
        down[0] * _weighted_row(patch, at, across)
        + down[1] * _weighted_row(patch, at1, across)
        + down[2] * _weighted_row(patch, at2, across)
        + down[3] * _weighted_row(patch, at3, across)
        + down[4] * _weighted_row(patch, at4, across)
        + down[5] * _weighted_row(patch, at5, across)
        + down[6] * _weighted_row(patch, at6, across)
        + down[7] * _weighted_row(patch, at6 + width, across)
    )
    return value


@njit(fastmath=FAST_MATH, error_model="numpy", **INNER)
def _weighted_row(patch: Image, at: np.uint64, across: Window) -> np.float32:
    """Weighted sum of one row of a window, from index ``at`` on."""
    one = np.uint64(1)
    at1 = at + one
    at2 = at1 + one
    at3 = at2 + one
    at4 = at3 + one
    at5 = at4 + one
    at6 = at5 + one
    value: np.float32 = (
        across[0] * patch[at]
        + across[1] * patch[at1]
        + across[2] * patch[at2]
        + across[3] * patch[at3]
        + across[4] * patch[at4]
        + across[5] * patch[at5]
        + across[6] * patch[at6]
        + across[7] * patch[at6 + one]
    )
    return value
