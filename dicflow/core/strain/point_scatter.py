"""How much points scatter about smooth motion, and how far their errors reach, beside what is stated.

Noise of the photographs is known, but what misfit makes of a subset's place is an estimate, which rests on assumptions
about residuals and pattern. Where it leaves derivatives of the pattern its errors reach less far than the pixels which
neighbours share (:mod:`dicflow.core.uncertainty.overlap`). The points tell: residuals of a polynomial of degree 3 in a
wide window, their differences between neighbours and their slopes are weighted sums of the points. Their variances are
known for noise, for misfit that a subset averages, and for such that it averages as a derivative down or across. The
variances of these kinds, none negative, that fit best count, for U, V and W each.

Motion may be steeper than the polynomial follows. So of a scatter above σ counts what residuals in small windows and
those of degree 5 have too, less the bias that is known. Misfit also differs from region to region, with the blur or the
light: residuals in small windows, averaged over the neighbours, tell how much.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import cache
from itertools import product
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.parts import beside_borders
from dicflow.core.strain.deformation_gradient import MeasuredSurface
from dicflow.core.strain.degree_choice import ChosenGradient
from dicflow.core.strain.small_jumps import GridOfSubsets
from dicflow.core.strain.window_fits import polynomial_terms, terms_of_degree
from dicflow.core.uncertainty.covariance import displacement_variances
from dicflow.core.uncertainty.overlap import Derivative, Overlap, ShapeFunction, mixed, overlap

__all__ = ["AxisScatter", "scatter_of_points", "with_scatter_as_bias"]


_PER_SUBSET = 4.5
"""Points along the side of a subset that count, about: more of a closer grid tell nothing new."""
_SIDE, _LEAST_SIDE, _DEGREE = 4.0, 7, 3
"""Side of the windows in subsets, the least one in points, and the degree of the polynomials: a higher one would leave
less of the errors that slopes have."""
_NARROW_SIDE, _HIGHER_DEGREE = 2.5, 5
"""Side of the windows where none of the others is whole, and the degree with which they follow steeper motion."""
_SMALL_SIDE, _SMALL_LEAST_SIDE, _SMALL_DEGREE = 1.1, 5, 3
"""The same of small windows, which follow steep motion."""
_WITHIN, _MEDIAN = ((0.6827, 1.0), (0.9545, 2.0)), ((0.5, 0.6745),)
"""Quantiles of sizes that tell a standard deviation, as their mean, each with that of a normal variable."""
_EDGES_PX = (1.5, 4.0)
"""Edges of a fine pattern and of a coarse or blurred one."""
_KINDS = (None, *(Derivative(along, edge) for edge in _EDGES_PX for along in ("down", "across")))
"""How a subset averages errors: plainly, or as derivatives."""
_CHANCE, _CHANCE_OF_KINDS = 0.25, 0.1
"""Mean squares of differences between logarithms of standard deviations that chance makes, times the number of subsets
without overlap, and of those about a common difference, which tell kinds of errors apart."""
_NEGLIGIBLE = 0.05
"""Excess of a scatter over σ that counts for nothing, and share of misfit in the variance that does."""
_REGION, _REGION_CHANCE = 3.0, 0.5
"""Standard deviation of the weights of neighbours in a region [subsets], and the square of a difference between regions
that is taken for chance, times their number of subsets."""
_MOST_IN_REGION, _OUTLIER = 4.0, 16.0
"""Largest misfit in a region over that of all, and squares of residuals over their variance that count at most."""
_BIASED = 0.3
"""Bias of a displacement from which its residual tells nothing about misfit, since motion is steep there [σ]."""


class AxisScatter(NamedTuple):
    """Errors of the displacements along one axis, beside what is stated.

    variances : of errors that subsets average plainly, and as the derivatives of each kind, over what is stated
    regions : (row, col) — variance of all these errors at each point, over that of all points
    """

    variances: tuple[float, ...]
    regions: Array

    @property
    def variance(self) -> Array:
        """Of the errors (row, col), over what is stated."""
        return np.asarray(sum(self.variances) * self.regions)

    @property
    def noise(self) -> Array:
        """Variance (row, col) of what may be noise of the photographs: at most what is stated."""
        return np.asarray(np.minimum(self.variance, 1.0))

    @property
    def is_as_stated(self) -> bool:
        """Whether nothing differs from what is stated."""
        return self.variances[0] == 1.0 and not any(self.variances[1:]) and bool((self.regions == 1.0).all())

    def correlation(self, size: int, step: float, shape_function: ShapeFunction) -> Overlap:
        """Of the errors of two points, of subsets of a size every so many pixels."""
        total = sum(self.variances)
        kinds = zip(self.variances, _KINDS, strict=True)
        return mixed([(part / total, overlap(size, step, shape_function, kind)) for part, kind in kinds if part > 0.0])


def with_scatter_as_bias(chosen: ChosenGradient, seen: Sequence[AxisScatter]) -> ChosenGradient:
    """The chosen gradients, with what their points scatter beyond what is stated as bias instead of noise.

    The rows of F have the errors of the first two axes.
    """
    share = np.stack([np.sqrt(axis.noise / axis.variance) for axis in seen[:2]], axis=-1)
    scale = share[..., [0, 0, 1, 1]]
    covariance = scale[..., :, None] * scale[..., None, :] * chosen.surface.covariance
    more = chosen.surface.covariance - covariance
    return chosen._replace(surface=chosen.surface._replace(covariance=covariance), bias=chosen.bias + more)


class _Window(NamedTuple):
    """Side of windows [points], and degree of the polynomials in them."""

    side: int
    degree: int


class _Axis(NamedTuple):
    """Displacements along an axis, of every so many points of a grid: those between tell nothing new.

    values, variances : (row, col) — and what is stated of their errors
    squares_of_bias : (row, col) — 0 if unknown
    wide, small : (row, col) — where no point of such a window is missing
    shares : of each shape function in the variances
    """

    values: Array
    variances: Array
    squares_of_bias: Array
    wide: Mask
    small: Mask
    shares: Mapping[ShapeFunction, float]

    def scaled_residuals(self, weights: Array, where: Mask) -> Array:
        """Sums (m, n) with weights (m, side, side) around points, over the standard deviations of these."""
        sums = [cv2.filter2D(self.values, -1, one, borderType=cv2.BORDER_CONSTANT)[where] for one in weights]
        return np.asarray(np.stack(sums) / np.sqrt(self.variances[where]))


class _Grid(NamedTuple):
    """The grid of these points.

    stride : points of the whole grid; size, step : of the subsets [px]
    side : of wide windows [subsets]
    """

    stride: int
    size: int
    step: int
    side: float = _SIDE

    @classmethod
    def of(cls, subsets: GridOfSubsets, known: Mask) -> _Grid:
        """The grid for subsets at known points (row, col)."""
        stride = max(1, round(subsets.size / subsets.step / _PER_SUBSET))
        grid = cls(stride, subsets.size, stride * subsets.step)
        return grid if grid.whole(known, grid.wide).any() else grid._replace(side=_NARROW_SIDE)

    @property
    def wide(self) -> _Window:
        """Wide windows."""
        return _Window(self._odd_side(self.side, _LEAST_SIDE), _DEGREE)

    @property
    def followed(self) -> _Window:
        """Narrower windows with polynomials that follow steeper motion."""
        return _Window(self._odd_side(_NARROW_SIDE, _LEAST_SIDE), _HIGHER_DEGREE)

    @property
    def small(self) -> _Window:
        """Small windows."""
        return _Window(self._odd_side(_SMALL_SIDE, _SMALL_LEAST_SIDE), _SMALL_DEGREE)

    def _odd_side(self, relative: float, least: int) -> int:
        """Side of windows [points], from that in subsets."""
        return max(least, 2 * round((relative * self.size / self.step - 1.0) / 2.0) + 1)

    def whole(self, known: Mask, window: _Window) -> Mask:
        """Points (row, col) in whose windows none is missing. known : of the whole grid"""
        kernel = np.ones((self.stride * (window.side - 1) + 1,) * 2, dtype=np.uint8)
        eroded = cv2.erode(np.pad(known.astype(np.uint8), 1), kernel)[1:-1, 1:-1]
        return np.asarray(eroded[:: self.stride, :: self.stride] > 0)

    def by_kind(self, window: _Window, shares: Mapping[ShapeFunction, float]) -> Array:
        """Variances (kind, 7) of the residuals by errors of each kind with unit variance."""
        parts = [share * _variances_by_kind(window, self.size, self.step, shape) for shape, share in shares.items()]
        return np.asarray(np.sum(parts, axis=0))


def scatter_of_points(
    surface: MeasuredSurface,
    subsets: GridOfSubsets,
    shapes: Sequence[ShapeFunction],
    bias: Array | None = None,
    misfit_share: float = 0.0,
) -> list[AxisScatter]:
    """The errors of U, V and W as the points show them, or as they are stated where the difference may be chance.

    Of the misfit the share 1 − c / d² is as found, and the rest as stated: d² are the squares of the differences
    between what is seen and what is stated, and c those that chance makes. Noise is known without what is seen.

    shapes : shape functions of the shares in the errors of the surface
    bias : (row, col, 3) — of the displacements, of which the squares are taken out of more scatter; None if unknown
    misfit_share : of misfit in the variances
    """
    known, shape = np.asarray(surface.known & ~beside_borders(surface.points.parts)), surface.known.shape
    grid, as_stated = _Grid.of(subsets, known), AxisScatter(tuple(_as_stated().tolist()), np.ones(shape))
    axes = _axes(surface, grid, known, shapes, bias)
    if misfit_share <= _NEGLIGIBLE and all(_over_stated(grid, axis) < (1.0 + _NEGLIGIBLE) ** 2 for axis in axes):
        return 3 * [as_stated]
    return [_seen(grid, axis, misfit_share, shape) if _is_known(axis) else as_stated for axis in axes]


def _axes(
    surface: MeasuredSurface, grid: _Grid, known: Mask, shapes: Sequence[ShapeFunction], bias: Array | None
) -> list[_Axis]:
    """The points along each axis. known : (row, col) — those that count and lie beside no other part"""
    part = (slice(None, None, grid.stride),) * 2
    wide, small = (grid.whole(known, window) for window in (grid.wide, grid.small))
    values = surface.points.values[part]
    moved = values[..., :3] - values[..., 3:]
    by_shape = np.stack([displacement_variances(one.covariance[part]) for one in surface.errors])
    squares = np.zeros_like(moved) if bias is None else np.nan_to_num(bias[part]) ** 2
    total = by_shape.sum(axis=0)
    along = (np.ascontiguousarray(np.moveaxis(field, -1, 0)) for field in (moved, total, squares))
    whole = [_Axis(one, variances, biased, wide, small, {}) for one, variances, biased in zip(*along, strict=True)]
    shares = (_shares(by_shape[:, wide, axis].sum(axis=1), shapes) for axis in range(len(whole)))
    return [_unbiased(axis)._replace(shares=share) for axis, share in zip(whole, shares, strict=True)]


def _unbiased(axis: _Axis) -> _Axis:
    """An axis without the windows around points where motion is known to be steep, if these are fewer."""
    steep = axis.squares_of_bias >= _BIASED**2 * axis.variances
    wide, small = (mask & ~steep if 2 * (mask & steep).sum() < mask.sum() else mask for mask in (axis.wide, axis.small))
    return axis._replace(wide=wide, small=small)


def _is_known(axis: _Axis) -> bool:
    """Whether there are wide windows, and errors."""
    return bool(axis.wide.any() and (axis.variances[axis.wide] > 0.0).all())


def _over_stated(grid: _Grid, axis: _Axis) -> float:
    """Variance of the residuals in small windows over that by errors as they are stated; 0 without any."""
    return _over_expected(grid, axis, grid.small, _as_stated()) if _is_known(axis) else 0.0


def _over_expected(grid: _Grid, axis: _Axis, window: _Window, variances: Array) -> float:
    """Variance of the residuals in windows over that by errors of each kind with variances (kind,)."""
    where = axis.small if window == grid.small else axis.wide
    seen = _by_quantiles(axis.scaled_residuals(_residuals(window)[:1], where), *_MEDIAN)[0]
    return float(seen / (variances @ grid.by_kind(window, axis.shares)[:, 0]))


def _shares(sums: Array, shapes: Sequence[ShapeFunction]) -> dict[ShapeFunction, float]:
    """Share of each shape function in sums (shape,) of variances; all of the first one where these are 0."""
    shares = sums / sums.sum() if sums.sum() > 0.0 else np.eye(len(sums))[0]
    return dict(zip(shapes, shares.tolist(), strict=True))


def _by_quantiles(scaled: Array, *quantiles: tuple[float, float]) -> Array:
    """Variances (…) of values (…, n), by quantiles of their sizes, each with that of a normal variable."""
    shares, of_normal = np.array(quantiles).T
    found = np.quantile(np.abs(scaled), shares, axis=-1)
    return np.asarray((np.moveaxis(found, 0, -1) / of_normal).mean(axis=-1) ** 2)


def _seen(grid: _Grid, axis: _Axis, misfit_share: float, shape: tuple[int, ...]) -> AxisScatter:
    """Errors along an axis, as the points show them. shape : of the whole grid"""
    fitted = _fitted(grid, axis, misfit_share)
    regions = _regions(grid, axis, fitted, misfit_share)
    if (regions != 1.0).any():
        fitted = _fitted(grid, axis._replace(variances=regions * axis.variances), misfit_share)
    whole = regions.repeat(grid.stride, axis=0).repeat(grid.stride, axis=1)
    return AxisScatter(tuple(fitted.tolist()), whole[: shape[0], : shape[1]])


def _as_stated() -> Array:
    """Variances (kind,) as they are stated."""
    return np.asarray(np.eye(len(_KINDS))[0])


def _fitted(grid: _Grid, axis: _Axis, misfit_share: float) -> Array:
    """Variances (kind,) of all errors, as residuals in wide windows show them.

    More than is stated may be motion that the polynomials do not follow: then those count that leave less.
    """
    fitted = _fitted_in(grid, axis, grid.wide, misfit_share)
    if fitted.sum() <= 1.0:
        return fitted
    followed = _fitted_in(grid, axis, grid.wide._replace(degree=_HIGHER_DEGREE), misfit_share)
    fitted = min(fitted, followed, key=lambda one: float(one.sum()))
    total = fitted.sum()
    if total <= 1.0:
        return fitted
    biased = np.mean(axis.squares_of_bias[axis.wide] / axis.variances[axis.wide])
    plain = (_over_expected(grid, axis, one, _as_stated()) for one in (grid.small, grid.followed))
    return _at_most(fitted, min(total * _over_expected(grid, axis, grid.small, fitted), *plain) - biased)


def _fitted_in(grid: _Grid, axis: _Axis, window: _Window, misfit_share: float) -> Array:
    """Variances (kind,) by noise as stated, and misfit of the kinds with which residuals are as they are seen.

    Of the kinds counts what chance does not make of them beside plain misfit, and of all what it does not make of it
    beside what is stated.
    """
    seen = _by_quantiles(axis.scaled_residuals(_residuals(window), axis.wide), *_WITHIN)
    by_kind = grid.by_kind(window, axis.shares)
    noise, stated = 1.0 - misfit_share, by_kind[0]
    kinds, plain = (_none_negative((part / seen).T, 1.0 - noise * stated / seen) for part in (by_kind, by_kind[:1]))
    independent = np.count_nonzero(axis.wide) * (grid.step / grid.size) ** 2
    misfit = plain[0] * _as_stated()
    misfit += _beyond_chance(seen, (noise + plain[0]) * stated, _CHANCE_OF_KINDS / independent) * (kinds - misfit)
    share = _beyond_chance(seen, stated, _CHANCE / independent)
    return np.asarray((1.0 - share * misfit_share) * _as_stated() + share * misfit)


def _none_negative(terms: Array, wanted: Array) -> Array:
    """Coefficients (k,), none negative, of terms (m, k) whose sum differs least from what is wanted (m,).

    They are those of least squares with some of the terms alone, of all choices that leave none negative.
    """
    choices = np.array(list(product((0.0, 1.0), repeat=terms.shape[1])))
    found = choices * (np.linalg.pinv(terms * choices[:, None]) @ wanted)
    squares = ((found @ terms.T - wanted) ** 2).sum(axis=1)
    return np.asarray(found[np.where((found >= 0.0).all(axis=1), squares, np.inf).argmin()])


def _beyond_chance(seen: Array, expected: Array, chance: float) -> float:
    """Share of the difference between variances (m,) that are seen and expected that is not chance (James and Stein).

    chance : mean square of the differences between logarithms of standard deviations
    """
    differences = float((0.25 * np.log(seen / expected) ** 2).sum())
    return max(0.0, 1.0 - (len(seen) - 2) * chance / max(differences, 1e-12))


def _at_most(fitted: Array, variance: float) -> Array:
    """Variances (kind,) of errors with at most one in all, but not less than is stated.

    A small excess counts for nothing. The more is taken away, the less the kinds count: what was fitted is motion then.
    """
    total = fitted.sum()
    deviation = float(np.clip(variance, 1.0, total)) ** 0.5
    share = (_NEGLIGIBLE / max(total**0.5 - deviation, _NEGLIGIBLE)) ** 2
    excess = 1.0 - (_NEGLIGIBLE / max(deviation - 1.0, _NEGLIGIBLE)) ** 2
    kinds = (1.0 - share) * _as_stated() + share * fitted / total
    return np.asarray((1.0 + excess * (deviation**2 - 1.0)) * kinds)


def _regions(grid: _Grid, axis: _Axis, fitted: Array, misfit_share: float) -> Array:
    """Variance of the errors at each point (row, col) over that of all, by the misfit in the region around.

    fitted : (kind,) — variances of all
    """
    noise, total = 1.0 - misfit_share, float(fitted.sum())
    misfit = total - noise
    if misfit <= 0.0:
        return np.ones(axis.variances.shape)
    expected = float(fitted @ grid.by_kind(grid.small, axis.shares)[:, 0])
    squares = np.zeros(axis.small.shape)
    squares[axis.small] = axis.scaled_residuals(_residuals(grid.small)[:1], axis.small)[0] ** 2 / expected
    sigma = _REGION * grid.size / grid.step
    near, sums = (
        cv2.GaussianBlur(field, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
        for field in (axis.small.astype(np.float64), np.minimum(squares, _OUTLIER))
    )
    mean = np.divide(sums, near, out=np.ones_like(sums), where=near > 1e-6)
    mean /= mean[axis.small].mean()
    chance = _REGION_CHANCE / (4.0 * np.pi * _REGION**2)
    share = max(0.0, 1.0 - chance / max(float(((mean[axis.small] - 1.0) ** 2).mean()), 1e-12))
    relative = ((1.0 + share * (mean - 1.0)) * total - noise) / misfit
    return np.asarray((noise + misfit * np.clip(relative, 0.0, _MOST_IN_REGION)) / total)


@cache
def _variances_by_kind(window: _Window, size: int, step: int, shape_function: ShapeFunction) -> Array:
    """Variances (kind, 7) of the residuals by errors of each kind with unit variance, of subsets of one kind."""
    weights = _residuals(window)
    return np.stack([overlap(size, step, shape_function, kind).variance(weights) for kind in _KINDS])


@cache
def _residuals(window: _Window) -> Array:
    """Weights (7, side, side) of points in residuals of a polynomial over a window.

    Of the point at the centre, the differences between it and the next one and across it, along rows and columns, and
    the slopes over half the window.
    """
    side, degree = window
    terms = polynomial_terms((side, side), terms_of_degree(degree)).reshape(-1, side**2)
    left = np.eye(side**2) - np.linalg.pinv(terms) @ terms
    row, col = np.mgrid[:side, :side] - side // 2
    points = [((row == a) & (col == b)).astype(float) for a, b in ((0, 0), (0, 1), (0, -1), (1, 0), (-1, 0))]
    near = np.maximum(np.abs(row), np.abs(col)) <= side // 4
    here, right, before, below, above = points
    sums = np.stack([here, right - here, right - before, below - here, below - above, near * col, near * row])
    return np.ascontiguousarray((sums.reshape(7, -1) @ left).reshape(sums.shape))
