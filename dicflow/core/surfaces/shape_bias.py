"""What subsets do not follow: the bias of measured places by their shape function.

A subset of side h with an affine shape function measures, at its centre, the least-squares plane through the motion of
its pixels, and one with a quadratic shape function the parabola (Schreier and Sutton 2002, Exp. Mech. 42:303). What the
plane or parabola leaves out, the same fit to the measured points in a window of side L > h leaves out once more, only
more of it: with M the mean square of the offsets along one side, M_L/M_h times the bias for planes, and (M_L/M_h)²
times for parabolas. So the bias is the difference of this fit and the measured place, over that factor.
"""

from __future__ import annotations

from typing import Literal, NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.parts import Parts, beside_borders
from dicflow.core.surfaces.filters import local_polynomial

__all__ = ["PlacesOfSubsets", "ShapeBias", "affine_suffices", "as_of_affine", "shape_bias"]


_MIN_WINDOW = 7
"""Least side of a window [points]."""
_REACH = 2.2
"""Side of a window over that of a subset: small enough for short waves, and so large that noise hardly counts."""
_NEIGHBOUR_SIGMA = 0.5
"""Standard deviation of the weights of neighbours over which the bias is averaged [sides of the window]."""
_INDEPENDENT = 8.0
"""Independent differences in such an average: 4π · 0.5² squares of the window's side, over the area of about 0.6² of
them in which the errors of differences are correlated."""
_SHARE_OF_SIGMA = 1.0 / 3.0
"""Bias over σ from which an affine shape function does not suffice."""
_MAX_BIASED = 0.03
"""Share of the points that may have such a bias."""
_STANDARD_ERRORS = 2.0
"""Standard errors by which the bias of a point must exceed that."""
_QUADRATIC_VARIANCE = 1.0 + 5.0 / 4.0 + 5.0 / 4.0
"""Variance of the place of a quadratic subset over that of an affine one, of white noise and an even pattern."""


class PlacesOfSubsets(NamedTuple):
    """Where subsets of a grid were found in a photograph.

    places : (rows, cols, 2) [px]; NaN where unknown
    variance : (rows, cols, 2) — by noise [px²]
    """

    places: Array
    variance: Array


class ShapeBias(NamedTuple):
    """Bias of places by a shape function, from the points around each one; NaN where no place is known.

    square : (rows, cols, 2) — mean over the neighbours, less what noise alone gives [px²]
    noise : (rows, cols, 2) — variance of a single estimate by noise [px²]
    """

    square: Array
    noise: Array

    @property
    def deviation(self) -> Array:
        """The bias as a standard deviation (rows, cols, 2) [px]."""
        return np.asarray(np.sqrt(np.maximum(self.square, 0.0)))


def shape_bias(
    found: PlacesOfSubsets,
    subset_size: int,
    step_size: int,
    shape_function: Literal["affine", "quadratic"],
    parts: Parts | None = None,
    jumps: Mask | None = None,
) -> ShapeBias:
    """Bias of places by a shape function.

    subset_size, step_size : side of the subsets, distance of the points in the first photograph [px]
    parts : of the grid, each of which moves on its own; None for a single one
    jumps : (rows, cols) — points beside a crack; what the windows that hold one show does not count, nor across a cut
    """
    if parts is None or parts.is_single:
        return _of_part(found, subset_size, step_size, shape_function, jumps)
    disturbed = beside_borders(parts) if jumps is None else beside_borders(parts) | jumps
    whole = ShapeBias(np.full(found.places.shape, np.nan), np.full(found.places.shape, np.nan))
    for number in range(1, int(parts.number.max()) + 1):
        here = (parts.number == number)[..., None]
        alone = found._replace(places=np.where(here, found.places, np.nan))
        of_part = _of_part(alone, subset_size, step_size, shape_function, disturbed)
        whole = ShapeBias(*(np.where(here, new, old) for new, old in zip(of_part, whole, strict=True)))
    return whole


def _of_part(
    found: PlacesOfSubsets,
    subset_size: int,
    step_size: int,
    shape_function: Literal["affine", "quadratic"],
    disturbed: Mask | None,
) -> ShapeBias:
    """The same for points that move as one, but for disturbed ones."""
    degree = {"affine": 1, "quadratic": 2}[shape_function]
    side = max(_MIN_WINDOW, _odd(_REACH * subset_size / step_size))
    ratio = (step_size**2 * (side**2 - 1) / (subset_size**2 - 1)) ** degree
    fit = local_polynomial(found.places, (side, side), degree)
    bias = (fit.value - found.places) / ratio
    noise = found.variance * np.clip(1.0 - fit.leverage, 0.0, 1.0)[..., None] / ratio**2
    known = np.asarray(np.isfinite(found.places).all(axis=-1))[..., None]
    counts = known[..., 0] if disturbed is None else known[..., 0] & ~_within(disturbed, side)
    square = _neighbours_mean(bias**2 - noise, counts, _NEIGHBOUR_SIGMA * side)
    return ShapeBias(np.where(known, square, np.nan), np.where(known, noise, np.nan))


def affine_suffices(bias: ShapeBias, variance: Array) -> bool:
    """Whether the bias of affine subsets is small against the noise nearly everywhere.

    bias : of an affine shape function; variance : (rows, cols, 2) — of the places by noise [px²]
    """
    known = np.asarray(np.isfinite(bias.square + variance).all(axis=-1))
    if not known.any():
        return True
    limit, noise = _SHARE_OF_SIGMA**2 * variance[known], bias.noise[known]
    error = np.sqrt((4.0 * limit * noise + 2.0 * noise**2) / _INDEPENDENT)
    biased = (bias.square[known] > limit + _STANDARD_ERRORS * error).any(axis=-1)
    return bool(biased.mean() <= _MAX_BIASED)


def as_of_affine(found: PlacesOfSubsets, subset_size: int, step_size: int) -> PlacesOfSubsets:
    """The places of quadratic subsets as affine ones would have them: smoothed by planes over the side of a subset."""
    side = max(3, _odd(subset_size / step_size))
    smooth = local_polynomial(found.places, (side, side), 1).value
    known = np.asarray(np.isfinite(found.places).all(axis=-1))
    return PlacesOfSubsets(np.where(known[..., None], smooth, np.nan), found.variance / _QUADRATIC_VARIANCE)


def _odd(side: float) -> int:
    return 2 * int(side / 2.0) + 1


def _within(disturbed: Mask, side: int) -> Mask:
    """Points (rows, cols) with a disturbed one in the window of a side around them."""
    return np.asarray(cv2.dilate(disturbed.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)


def _neighbours_mean(values: Array, known: Mask, sigma: float) -> Array:
    """Means of values (rows, cols, 2) over the known ones around each point; 0 where there are none."""
    counts = np.asarray(np.isfinite(values).all(axis=-1) & known)
    filled = np.where(counts[..., None], values, 0.0)
    total, share = (
        cv2.GaussianBlur(part, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
        for part in (filled, counts.astype(np.float64))
    )
    return np.asarray(np.where(share[..., None] > 1e-6, total / np.maximum(share[..., None], 1e-6), 0.0))
