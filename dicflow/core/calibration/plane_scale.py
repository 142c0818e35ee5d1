"""The scale of one camera that looks at a plane: millimetres per pixel, and how certain they are."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Self

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import fdtri

from dicflow.core.arrays import Array
from dicflow.core.matching.transform import TransformKind, apply_transform, estimate_transform, jacobian

__all__ = ["PlaneScale", "common_scale", "scale_of_board", "scale_of_length"]


_RISK = 1e-3
_LEAST_VARIANCE = 1e-10
"""Of a mark that counts as exact [px²]."""


class PlaneScale(NamedTuple):
    """mm_per_px, u : of the whole plane, and its standard uncertainty [mm/px]

    variation : largest over smallest scale in the plane, less 1, by a tilt of the camera; NaN where it is unknown
    """

    mm_per_px: float
    u: float
    variation: float = float("nan")


def scale_of_length(ends: ArrayLike, length_mm: float, u_length_mm: float, u_end_px: float) -> PlaneScale:
    """The scale from a known length: s = L / d, (u_s / s)² = (u_L / L)² + 2 (u_end / d)².

    ends : (2, 2) — of the length in the photograph [px]; u_end_px : standard uncertainty of each along the length
    """
    distance = float(np.linalg.norm(np.diff(np.asarray(ends, dtype=float), axis=0)))
    scale = length_mm / distance
    return PlaneScale(scale, scale * float(np.hypot(u_length_mm / length_mm, np.sqrt(2.0) * u_end_px / distance)))


def scale_of_board(marks: Array, points: Array, u_square: float = 0.0) -> PlaneScale:
    """The scale from a board in the plane.

    marks : (n, 2) — in the photograph, without distortion [px]; NaN where hidden
    points : (n, 2) — of the same marks on the board [mm]
    u_square : relative standard uncertainty of the board's squares
    A camera square to the plane sees the board by a similarity; its scale has the relative uncertainty σ / √Σ|p − p̄|²,
    with the residual σ of a coordinate. Where a projective transform H from pixels to the board leaves significantly
    smaller residuals (F-test of its 4 further parameters, 1 in 1000), the camera is tilted: then the mean of √|det ∂H|
    at the marks counts, and its scatter is part of the uncertainty. That of the squares is so always.
    """
    known = np.isfinite(marks).all(axis=-1)
    pixels, places = marks[known], points[known]
    square, tilted = (_Fit.of(kind, pixels, places) for kind in ("similarity", "projective"))
    spread = np.sqrt(((pixels - pixels.mean(axis=0)) ** 2).sum())
    freedom = max(1, 2 * len(pixels) - 8)
    sigma = np.sqrt(tilted.squares / freedom)
    ratio = (square.squares - tilted.squares) / 4.0 / max(sigma**2, _LEAST_VARIANCE)
    local = tilted.local if ratio > fdtri(4, freedom, 1.0 - _RISK) else square.local
    scale = float(local.mean())
    relative = float(np.sqrt((sigma / spread) ** 2 + (local.std() / scale) ** 2 + u_square**2))
    return PlaneScale(scale, scale * relative, float(local.max() / local.min() - 1.0))


class _Fit(NamedTuple):
    """A transform from pixels to a board. local : (n,) scale at each mark [mm/px]; squares : of the residuals [px²]"""

    local: Array
    squares: float

    @classmethod
    def of(cls, kind: TransformKind, pixels: Array, places: Array) -> Self:
        transform = estimate_transform(kind, pixels, places)
        local = np.sqrt(np.abs(np.linalg.det(jacobian(transform, pixels))))
        residual = (apply_transform(transform, pixels) - places) / local[:, None]
        return cls(local, float((residual**2).sum()))


def common_scale(scales: Sequence[PlaneScale]) -> PlaneScale:
    """The mean of several boards; what they differ by is part of its uncertainty."""
    values = np.array([one.mm_per_px for one in scales])
    mean_square = float(np.mean([one.u**2 for one in scales]))
    u = float(np.sqrt(mean_square + values.var()))
    return PlaneScale(float(values.mean()), u, max(one.variation for one in scales))
