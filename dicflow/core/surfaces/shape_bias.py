"""What subsets do not follow: the bias of measured places by their shape function.

A subset of side h with an affine shape function measures, at its centre, the least-squares plane through the motion of
its pixels, and one with a quadratic shape function the parabola (Schreier and Sutton 2002, Exp. Mech. 42:303). What the
plane or parabola leaves out, the same fit to the measured points in a window of side L > h leaves out once more, only
more of it: by the ratio of what both leave out of r² or of r⁴, the first power of the distance that they do not follow.
So the bias is the difference of this fit and the measured place, over that ratio.

A wide window and many neighbours leave little to noise, but hide the bias of motion that changes within them, as in a
shear band, and spread it to where motion is even. So a narrower window and nearer neighbours count instead where they
differ by more than noise.
"""

from __future__ import annotations

from functools import cache, partial
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Image, Mask, all_finite
from dicflow.core.parts import Parts, beside_borders
from dicflow.core.surfaces.filters import local_polynomial
from dicflow.core.threads import at_once, over
from dicflow.core.uncertainty.overlap import ShapeFunction, overlap

__all__ = ["PlacesOfSubsets", "ShapeBias", "affine_suffices", "as_of_affine", "shape_bias"]


_MIN_WINDOW, _MIN_NARROW = 7, 5
"""Least side of a window [points]; the points of a smaller one do not follow a wave well enough to tell a bias as small
as many neighbours do, but one that is larger."""
_REACH = 2.2
"""Side of a window over that of a subset: small enough for short waves, and so large that noise hardly counts."""
_NARROW_REACH = 1.5
"""The same of a narrower window."""
_DIFFERENT = 4.0
"""Standard errors, if it were the same, by which the mean over nearer neighbours must differ from that over many."""
_UNSURE = 1.5
"""Standard deviation over the least one around, above which a point is much less certain; half a subset has √2."""
_NEIGHBOUR_SIGMA = 0.5
"""Standard deviation of the weights of neighbours over which the bias is averaged [sides of the window]."""
_NEARER_SIGMA = 0.25
"""The same for nearer neighbours: a bias changes its sign within half a subset."""
_INDEPENDENT = 32.0
"""Independent differences in such an average, times the square of that standard deviation: 4π of these squares, over
the area of about 0.6² sides of the window in which the errors of differences are correlated."""
_SHARE_OF_SIGMA = 1.0 / 3.0
"""Bias over σ from which an affine shape function does not suffice."""
_MAX_BIASED = 0.03
"""Share of the points that may have such a bias."""
_STANDARD_ERRORS = 2.0
"""Standard errors by which the bias of a point must exceed that."""
_LEAST_SHARE = np.float32(1e-6)
"""Weight of the neighbours that count, over that of all, below which their mean fades to 0."""
_DEGREES: dict[ShapeFunction, int] = {"affine": 1, "quadratic": 2}
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
    nearest : (rows, cols, 2) — square, or that by a narrower window where it differs by more than noise [px²]
    """

    square: Image
    noise: Image
    nearest: Image

    @property
    def deviation(self) -> Image:
        """The bias as a standard deviation (rows, cols, 2) [px]."""
        return np.asarray(np.sqrt(np.maximum(self.nearest, 0.0)))


def shape_bias(
    found: PlacesOfSubsets,
    subset_size: int,
    step_size: int,
    shape_function: ShapeFunction,
    parts: Parts | None = None,
    jumps: Mask | None = None,
    threads: int = 1,
) -> ShapeBias:
    """Bias of places by a shape function.

    subset_size, step_size : side of the subsets, distance of the points in the first photograph [px]
    parts : of the grid, each of which moves on its own; None for a single one
    jumps : (rows, cols) — points beside a crack; what the windows that hold one show does not count, nor across a cut
    """
    if parts is None or parts.is_single:
        return _of_part(found, (subset_size, step_size), shape_function, jumps, threads)
    disturbed = beside_borders(parts) if jumps is None else beside_borders(parts) | jumps
    whole = ShapeBias(*np.full((3, *found.places.shape), np.nan, dtype=np.float32))
    for number in range(1, int(parts.number.max()) + 1):
        here = (parts.number == number)[..., None]
        alone = found._replace(places=np.where(here, found.places, np.nan))
        of_part = _of_part(alone, (subset_size, step_size), shape_function, disturbed, threads)
        whole = ShapeBias(*(np.where(here, new, old) for new, old in zip(of_part, whole, strict=True)))
    return whole


def _of_part(
    found: PlacesOfSubsets, grid: tuple[int, int], shape_function: ShapeFunction, disturbed: Mask | None, threads: int
) -> ShapeBias:
    """The same for points that move as one, but for disturbed ones. grid : subset_size, step_size"""
    in_points = grid[0] / grid[1]
    wide, narrow = (max(_MIN_WINDOW, _odd(reach * in_points)) for reach in (_REACH, _NARROW_REACH))
    least = max(_MIN_NARROW, 2 * int(np.ceil(0.5 * (in_points - 1.0))) + 1)
    variance = _as_around(found.variance, wide)
    differences = partial(_differences, found.places, variance, grid, shape_function, disturbed)
    by_side = over(threads, differences, sorted({wide, narrow, least}, reverse=True))
    square, *nearer = at_once(
        threads,
        partial(by_side[0].mean_square, _NEIGHBOUR_SIGMA),
        *(partial(near.mean_square, _NEARER_SIGMA) for near in by_side),
    )
    nearest = square
    for near, other in zip(by_side, nearer, strict=True):
        error = _DIFFERENT * _standard_error(np.maximum(nearest, 0.0), near.noise, _NEARER_SIGMA)
        is_less = (near.side >= narrow) & (other + error < nearest)
        nearest = np.where(is_less | (other - error > nearest), other, nearest)
    return ShapeBias(square, by_side[0].noise, nearest)


class _Differences(NamedTuple):
    """What fits in a window of a side [points] and places differ by; arrays are (rows, cols, …).

    excess : (…, 3) — squares of the biases less the noise, along both axes [px²], and 1, where they count; else 0
    noise : (…, 2) — variances of the biases [px²]; NaN where these are unknown
    known : (…) — at which points the bias is known
    """

    excess: Image
    noise: Image
    known: Mask
    side: int

    def mean_square(self, sigma: float) -> Image:
        """Mean of squares over the neighbours, less noise. sigma : of their weights [sides of the window]"""
        sums = cv2.GaussianBlur(self.excess, (0, 0), sigma * self.side, borderType=cv2.BORDER_CONSTANT)
        share = np.maximum(sums[..., 2:], _LEAST_SHARE)
        return np.where(self.known[..., None], sums[..., :2] / share, np.float32(np.nan))


def _differences(
    places: Array,
    variance: Image,
    grid: tuple[int, int],
    shape_function: ShapeFunction,
    disturbed: Mask | None,
    side: int,
) -> _Differences:
    """What fits in a window of a side [points] and the places of subsets differ by.

    variance : of the places by noise [px²]; grid : side of the subsets, distance of the points [px]
    """
    size, step = grid
    ratio = _left_out(side, step, shape_function) / _left_out(size, 1, shape_function)
    fit = local_polynomial(places, (side, side), _DEGREES[shape_function])
    share = _correlated_share(side, size, step, shape_function) * np.clip(1.0 - fit.leverage, 0.0, 1.0) / ratio**2
    bias = ((fit.value - places) / ratio).astype(np.float32)
    noise = share.astype(np.float32)[..., None] * variance
    square = bias * bias - noise
    counts = all_finite(square)
    if disturbed is not None:
        counts &= ~_within(disturbed, side)
    excess = np.empty((*counts.shape, 3), dtype=np.float32)
    excess[..., :2] = np.where(counts[..., None], square, np.float32(0.0))
    excess[..., 2] = counts
    known = all_finite(bias)
    return _Differences(excess, np.where(known[..., None], noise, np.float32(np.nan)), known, side)


def _as_around(variance: Array, side: int) -> Image:
    """Variances (rows, cols, 2), those of much less certain points as the least within the window of a side around.

    Where subsets do not follow the motion their residuals tell so, which is no noise.
    """
    square, own = np.ones((side, side), dtype=np.uint8), variance.astype(np.float32)
    least = cv2.erode(np.where(np.isfinite(own), own, np.float32(np.inf)), square).reshape(own.shape)
    return np.where(own / np.float32(_UNSURE**2) > least, least, own)


@cache
def _centre_weights(side: int, shape_function: ShapeFunction) -> Array:
    """Weights (side, side) of points in the centre of a plane or parabola that is fitted to them."""
    down, across = np.mgrid[-1.0 : 1.0 : side * 1j, -1.0 : 1.0 : side * 1j].reshape(2, -1)
    degree = _DEGREES[shape_function]
    terms = np.stack([down**a * across**b for a in range(degree + 1) for b in range(degree + 1 - a)], axis=1)
    return np.asarray(np.linalg.pinv(terms)[0].reshape(side, side))


def _left_out(side: int, step: int, shape_function: ShapeFunction) -> float:
    """What a fit to points of a window of a side [points], so many pixels apart, leaves out at its centre.

    Of r² for planes and r⁴ for parabolas, the first even power of the distance r [px] that these do not follow.
    """
    offset = step * (np.arange(side) - side // 2)
    square = np.add.outer(offset**2, offset**2).astype(np.float64)
    return float(np.sum(_centre_weights(side, shape_function) * square ** _DEGREES[shape_function]))


@cache
def _correlated_share(side: int, size: int, step: int, shape_function: ShapeFunction) -> float:
    """Variance of fit less point in a whole window, over that of points whose subsets do not overlap."""
    weights = _centre_weights(side, shape_function).copy()
    weights[side // 2, side // 2] -= 1.0
    return float(overlap(size, step, shape_function).variance(weights) / (weights**2).sum())


def _standard_error(square: Array | Image, noise: Image, sigma: float) -> Image:
    """Standard error of a mean of squares over neighbours, by noise. sigma : of their weights [sides of the window]"""
    return np.asarray(np.sqrt((4.0 * square * noise + 2.0 * noise**2) / (_INDEPENDENT * sigma**2)))


def affine_suffices(bias: ShapeBias, variance: Array) -> bool:
    """Whether the bias of affine subsets is small against the noise nearly everywhere.

    bias : of an affine shape function; variance : (rows, cols, 2) — of the places by noise [px²]
    """
    known = all_finite(bias.square + variance)
    if not known.any():
        return True
    limit, noise = _SHARE_OF_SIGMA**2 * variance[known], bias.noise[known]
    error = _standard_error(limit, noise, _NEIGHBOUR_SIGMA)
    biased = (bias.square[known] > limit + _STANDARD_ERRORS * error).any(axis=-1)
    return bool(biased.mean() <= _MAX_BIASED)


def as_of_affine(found: PlacesOfSubsets, subset_size: int, step_size: int) -> PlacesOfSubsets:
    """The places of quadratic subsets as affine ones would have them: smoothed by planes over the side of a subset."""
    side = max(3, _odd(subset_size / step_size))
    smooth = local_polynomial(found.places, (side, side), 1).value
    known = all_finite(found.places)
    return PlacesOfSubsets(np.where(known[..., None], smooth, np.nan), found.variance / _QUADRATIC_VARIANCE)


def _odd(side: float) -> int:
    return 2 * int(side / 2.0) + 1


def _within(disturbed: Mask, side: int) -> Mask:
    """Points (rows, cols) with a disturbed one in the window of a side around them."""
    return np.asarray(cv2.dilate(disturbed.astype(np.uint8), np.ones((side, side), np.uint8)) > 0)
