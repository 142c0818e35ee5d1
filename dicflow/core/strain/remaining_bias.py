"""Systematic error of a strain's polynomials, estimated from the points.

A polynomial of too low a degree for its window has a bias. It is estimated by a **pilot**, a polynomial in a window
1.5 times as wide. The fit, applied to a pilot of a higher degree, differs from the pilot by its bias: a change δF of
the gradient, which would be noise alone without it. From degree 3 the pilot has the degree of the fit; a bias grows
with the window's side by at least the power of the degree, so that it is a share of the change between both.

δF is a weighted sum of the points, so its covariance is known. The mean of δF δFᵀ − Cov δF over neighbouring points, in
units of the fit's own σ, less four times its standard error, estimates the second moments of the bias. A small bias
that is much the same over several windows, as in a sheet that is bent evenly, shows in the mean of δF over these.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.parts import beside_borders
from dicflow.core.strain.deformation_gradient import MeasuredSurface, SurfaceGradient
from dicflow.core.strain.window_fits import places_of, polynomial_terms, terms_of_degree, widened
from dicflow.core.threads import over

__all__ = ["CUBIC", "RelativeBias", "WindowFit", "at_least", "relative_bias", "relative_bias_at_rims"]


CUBIC = 3
"""Degree of the pilot, and the highest that is chosen."""
_PILOT = 1.5
"""Side of the pilot's window in sides of the window."""
_STANDARD_ERRORS, _STANDARD_ERRORS_NEAR = 4.0, 2.0
"""Standard errors by which the mean of changes must exceed that of noise, and that of the near neighbours alone."""
_REACH, _FAR = 0.6, 2.5
"""Standard deviations of the weights in means of squares, and of changes, over neighbours [sides of the window]."""
_NEAR, _EVERYWHERE = 1.7, 4.0
"""Standard deviations of these weights up to which neighbours count: beside a narrow band of much strain, whose bias is
thousands of times that of its surroundings, only those whose windows reach into it."""
_MEAN_SIGMAS, _ALONE_SIGMAS = 2.5, 3.5
"""Standard errors that a mean of changes must exceed, and above which a single change is no part of it."""
_AREA = 0.8
"""Area over which the errors of changes are correlated, Σ ρ² over all distances [squares of the window's side]."""
_NEGLIGIBLE = 1e-3
"""Second moment of a bias below which it is taken as 0 [σ² of the fit]."""
_CHUNK = 1000
"""Windows whose changes are computed at once."""


class WindowFit(NamedTuple):
    """Polynomials of a degree in a window (rows, cols) [points]."""

    window: tuple[int, int]
    degree: int

    @property
    def pilot(self) -> tuple[int, int]:
        """The pilot's window [points]."""
        rows, cols = (2 * int(np.ceil((_PILOT * side - 1.0) / 2.0)) + 1 for side in self.window)
        return rows, cols


class RelativeBias(NamedTuple):
    """Second moments (row, col, 4, 4) of the bias of a fit in F₁₁, F₁₂, F₂₁, F₂₂, in units of σ of each.

    near : by the changes at the neighbours; stated : the same, or by the mean over several windows where that is more
    """

    near: Array
    stated: Array


class _Samples(NamedTuple):
    """Cells of some rows and columns of the grid, in the middle of each of which changes are sampled.

    shape : (rows, cols) — of the cells
    stride : rows and columns of a cell
    window : of the fit [points]
    """

    shape: tuple[int, int]
    stride: int
    window: tuple[int, int]

    def places(self, wanted: Mask) -> Index:
        """Rows and columns (n, 2) of the samples that are wanted."""
        first, part = self.stride // 2, np.zeros(wanted.shape, dtype=np.bool_)
        part[first :: self.stride, first :: self.stride] = True
        return places_of(wanted & part)

    def cells(self, places: Index, values: Array) -> Array:
        """A field of the cells with the values (n, …) of samples, 0 elsewhere."""
        field = np.zeros((*self.shape, *values.shape[1:]))
        field[places[:, 0] // self.stride, places[:, 1] // self.stride] = values
        return field

    def at(self, places: Index, cells: Array) -> Array:
        """Values (n, …) of a field of the cells at samples."""
        return np.asarray(cells[places[:, 0] // self.stride, places[:, 1] // self.stride])

    def on_grid(self, cells: Array, shape: tuple[int, ...]) -> Array:
        """A field of the cells (row, col, …) on the whole grid: of each point that of its cell."""
        whole = cells.repeat(self.stride, axis=0).repeat(self.stride, axis=1)
        return np.asarray(whole[: shape[0], : shape[1]])

    def sums(self, values: Array, reach: float, furthest: float = _EVERYWHERE) -> Array:
        """Weighted sums over the neighbours of each cell, of a field (row, col, k); the weights add up to 1.

        reach : standard deviation of the weights [sides of the window]
        furthest : of them, up to which neighbours count
        """
        return _filtered(values, *self._weights(reach, furthest))

    def variances(self, variances: Array, reach: float, furthest: float = _EVERYWHERE) -> Array:
        """Variances of such sums, from those (row, col, k) of values whose errors are correlated over an area."""
        correlated = max(1.0, _AREA * self.window[0] * self.window[1] / self.stride**2)
        return correlated * _filtered(variances, *(weights**2 for weights in self._weights(reach, furthest)))

    def _weights(self, reach: float, furthest: float) -> Iterator[Array]:
        """Weights of cells along columns and rows, from the one furthest before to the one furthest after."""
        for side in self.window:
            cells = max(1, round(furthest * reach * side / self.stride))
            weights = np.exp(-0.5 * (np.arange(-cells, cells + 1) * self.stride / (reach * side)) ** 2)
            yield weights / weights.sum()


def _filtered(values: Array, down: Array, across: Array) -> Array:
    """Sums over the neighbours of each cell, of a field (row, col, k), with weights along columns and rows."""
    return np.asarray(cv2.sepFilter2D(values, -1, across, down, borderType=cv2.BORDER_CONSTANT)).reshape(values.shape)


def relative_bias(surface: MeasuredSurface, fit: WindowFit, wanted: Mask) -> RelativeBias:
    """The bias of a fit. wanted : (row, col) — points around which it is estimated; 0 far from them"""
    rows, cols = wanted.shape
    stride = max(1, min(*fit.window, 2 * rows, 2 * cols) // 2)
    samples = _Samples((-(-rows // stride), -(-cols // stride)), stride, fit.window)
    near = cv2.dilate(wanted.astype(np.uint8), np.ones([2 * side + 1 for side in fit.window], dtype=np.uint8)) > 0
    places = samples.places(surface.known & near)
    largest, mean = np.zeros((2, *samples.shape, 4, 4))
    if len(places) == 0:
        return RelativeBias(*np.zeros((2, rows, cols, 4, 4)))
    found = surface.gradient(places, *fit)
    for bias, covariance in _all_estimates(surface, places, fit, found):
        excess = [
            _mean_excess(samples, places, bias, covariance, *limits)
            for limits in ((_STANDARD_ERRORS, _EVERYWHERE), (_STANDARD_ERRORS_NEAR, _NEAR))
        ]
        alone = samples.cells(places, _squares_beyond(_ALONE_SIGMAS, bias, _variances(covariance)))
        largest = _larger(largest, _smaller(*excess))
        mean = at_least(_larger(mean, _square_of_mean(samples, places, bias, covariance)), alone)
    return RelativeBias(*(samples.on_grid(moments, wanted.shape) for moments in (largest, at_least(largest, mean))))


def relative_bias_at_rims(
    surface: MeasuredSurface, fit: WindowFit, at: Index, found: SurfaceGradient
) -> tuple[Index, Array]:
    """Those of rows and columns (n, 2) whose windows have gaps, and moments (m, 4, 4) by their own changes alone.

    found : (row, col, …) — the gradients by the fit there
    """
    rims = np.ascontiguousarray(at[_with_gaps(surface, fit.window)[tuple(at.T)]])
    here = SurfaceGradient(*(field[tuple(rims.T)] for field in found))
    return rims, _of_single_points(surface, rims, fit, here)


def _all_estimates(
    surface: MeasuredSurface, places: Index, fit: WindowFit, found: SurfaceGradient
) -> Iterator[tuple[Array, Array]]:
    """Biases (n, 4) by each change and their covariances (n, 4, 4) at rows and columns (n, 2), n > 0.

    found : (n, …) — the gradients by the fit there
    """
    count = -(-len(places) // _CHUNK)
    chunks = zip(*(np.array_split(field, count) for field in (places, *found)), strict=True)
    estimates = over(
        surface.threads, lambda part: list(_estimates(surface, part[0], fit, SurfaceGradient(*part[1:]))), chunks
    )
    for parts in zip(*estimates, strict=True):
        bias, covariance = (np.concatenate(field) for field in zip(*parts, strict=True))
        yield bias, covariance


def _with_gaps(surface: MeasuredSurface, window: tuple[int, int]) -> Mask:
    """Points (row, col) in whose window one is missing or belongs to another part."""
    apart = beside_borders(surface.points.parts)
    whole = np.pad((surface.known & ~apart).astype(np.uint8), 1)
    return np.asarray(cv2.erode(whole, np.ones(window, dtype=np.uint8))[1:-1, 1:-1] == 0, dtype=np.bool_)


def _of_single_points(surface: MeasuredSurface, places: Index, fit: WindowFit, found: SurfaceGradient) -> Array:
    """Second moments (n, 4, 4) of the bias at rows and columns (n, 2), each by the changes of this point alone."""
    largest = np.zeros((len(places), 4, 4))
    for bias, covariance in _all_estimates(surface, places, fit, found) if len(places) else ():
        largest = at_least(largest, _squares_beyond(_MEAN_SIGMAS, bias, _variances(covariance)))
    return largest


def _squares_beyond(standard_errors: float, bias: Array, variance: Array) -> Array:
    """Products (n, 4, 4) of biases (n, 4) that exceed some standard errors, less what noise makes of them."""
    with np.errstate(invalid="ignore"):
        square = np.where(bias**2 > standard_errors**2 * variance, bias**2 - variance, 0.0)
    remaining = np.sign(np.nan_to_num(bias)) * np.sqrt(square)
    return np.asarray(remaining[:, :, None] * remaining[:, None])


def _variances(covariance: Array) -> Array:
    return np.asarray(np.diagonal(covariance, axis1=-2, axis2=-1))


def _larger(first: Array, second: Array) -> Array:
    """Of each two matrices (…, 4, 4) the one with the larger trace."""
    is_more = np.trace(second, axis1=-2, axis2=-1) > np.trace(first, axis1=-2, axis2=-1)
    return np.where(is_more[..., None, None], second, first)


def at_least(moments: Array, others: Array) -> Array:
    """Matrices (…, 4, 4) whose diagonals have at least the elements of those of both, most alike the larger ones."""
    larger = _larger(moments, others)
    most = np.maximum(_variances(moments), _variances(others))
    lacking = most - _variances(larger)
    return np.asarray(larger + lacking[..., None] * np.eye(4))


def _smaller(first: Array, second: Array) -> Array:
    """Of each two matrices (row, col, 4, 4) the one with the smaller trace."""
    is_less = np.trace(second, axis1=-2, axis2=-1) < np.trace(first, axis1=-2, axis2=-1)
    return np.where(is_less[..., None, None], second, first)


def _estimates(
    surface: MeasuredSurface, at: Index, fit: WindowFit, found: SurfaceGradient
) -> Iterator[tuple[Array, Array]]:
    """Biases (n, 4) of the gradient by each change, in units of the fit's σ, and their covariances (n, 4, 4)."""
    own = surface.points.slope_weights(at, *fit)
    sigma = np.sqrt(np.diagonal(found.covariance, axis1=-2, axis2=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        for weights, share in _changes(surface, at, fit, own):
            slopes = surface.points.sums(at, weights)
            scale = share[:, None] / sigma
            bias = np.einsum("nfai,nai->nf", found.response, slopes) * scale
            covariance = surface.covariance_by(at, weights, found.response)
            yield bias, covariance * (scale[:, :, None] * scale[:, None])


def _changes(surface: MeasuredSurface, at: Index, fit: WindowFit, own: Array) -> Iterator[tuple[Array, Array]]:
    """Weights (n, 2, high, wide) of changes of the slopes, and the shares (n,) of the bias in each.

    own : (n, 2, high, wide) — weights of the fit's slopes
    """
    points = surface.points
    for degree in range(fit.degree + 1, CUBIC + 1):
        errors = _errors_of_terms(own, fit.pilot, terms_of_degree(degree))
        yield points.functional_weights(at, fit.pilot, errors), np.ones(len(at))
    if fit.degree >= CUBIC:
        weights = points.slope_weights(at, fit.pilot, fit.degree) - widened(own, fit.pilot)
        yield weights, _share_of_bias(own, fit)


def _share_of_bias(own: Array, fit: WindowFit) -> Array:
    """Shares (n,) of the bias in the change from the fit to one of its degree in the pilot's window.

    The bias grows with the power d of the side, or, of odd degrees d in windows without gaps, with the power d + 1.

    own : (n, 2, high, wide) — weights of the fit's slopes, of which the centre's may be 0
    """
    ratio = np.sqrt(np.prod(fit.pilot) / np.prod(fit.window))
    whole = np.count_nonzero(own[:, 0].astype(bool) | own[:, 1].astype(bool), axis=(1, 2)) >= np.prod(fit.window) - 1
    return np.asarray(1.0 / (ratio ** (fit.degree + whole * (fit.degree % 2)) - 1.0))


def _errors_of_terms(own: Array, window: tuple[int, int], count: int) -> Array:
    """Errors (n, 2, terms) of slopes by weights (n, 2, high, wide) for each polynomial term of a wider window."""
    terms = polynomial_terms(window, count)
    high, wide = ((side - part) // 2 for side, part in zip(window, own.shape[2:], strict=True))
    inner = terms[:, high : window[0] - high, wide : window[1] - wide]
    found = own.reshape(len(own), 2, -1) @ inner.reshape(count, -1).T
    found[:, 0, 2] -= 2.0 / (window[1] + 1.0)
    found[:, 1, 1] -= 2.0 / (window[0] + 1.0)
    return np.asarray(found)


def _weighted(places: Index, bias: Array, covariance: Array) -> tuple[Index, Array, Array, Array]:
    """Samples that are measured: places, biases (n, 4), their variances (n, 4), and weights, the less the noisier."""
    measured = np.isfinite(bias).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    noise = np.diagonal(covariance[measured], axis1=-2, axis2=-1)
    return places[measured], bias[measured], noise, 1.0 / (1.0 + noise.mean(axis=-1, keepdims=True)) ** 2


def _mean_excess(
    samples: _Samples, places: Index, bias: Array, covariance: Array, standard_errors: float, furthest: float
) -> Array:
    """Mean of δF δFᵀ − Cov δF over neighbours, less some standard errors, positive semidefinite; (row, col, 4, 4).

    bias, covariance : (n, 4) and (n, 4, 4) — of samples
    """
    excess = (bias[:, :, None] * bias[:, None] - covariance).reshape(-1, 16)
    excess = excess[np.isfinite(excess).all(axis=1)]
    places, _, noise, weight = _weighted(places, bias, covariance)
    weights, products, variances = (
        samples.cells(places, values) for values in (weight, weight * excess, 2.0 * (weight * noise) ** 2)
    )
    share = samples.sums(weights, _REACH, furthest)
    near = share[..., 0] > 0.0
    moments = (samples.sums(products, _REACH, furthest)[near] / share[near]).reshape(-1, 4, 4)
    error = np.sqrt(np.maximum(samples.variances(variances, _REACH, furthest)[near], 0.0)) / share[near]
    moments[:, range(4), range(4)] -= standard_errors * error
    result = np.zeros((*samples.shape, 4, 4))
    result[near] = _positive(moments)
    return result


def _square_of_mean(samples: _Samples, places: Index, bias: Array, covariance: Array) -> Array:
    """Square of the mean of δF over several windows, less its variance, where it stands out; (row, col, 4, 4).

    What stands out alone is no part of it: it belongs to its neighbours. At first that is what exceeds noise, and then
    what exceeds noise about the mean of the others, without which a mean of several standard errors would lose the
    largest of its parts.
    """
    places, bias, noise, weight = _weighted(places, bias, covariance)
    mean = np.zeros((*samples.shape, bias.shape[1]))
    for _ in range(2):
        alone = (samples.at(places, mean) - bias) ** 2 > _ALONE_SIGMAS**2 * noise
        counts = np.where(alone.any(axis=1, keepdims=True), 0.0, weight)
        weights, products = (samples.cells(places, values) for values in (counts, counts * bias))
        share = samples.sums(weights, _FAR)
        mean = np.divide(samples.sums(products, _FAR), share, out=np.zeros_like(mean), where=share > 0.0)
    near = share[..., 0] > 0.0
    variance = samples.variances(samples.cells(places, counts**2 * noise), _FAR)[near]
    result = np.zeros((*samples.shape, 4, 4))
    result[near] = _squares_beyond(_MEAN_SIGMAS, mean[near], np.maximum(variance, 0.0) / share[near] ** 2)
    return result


def _positive(moments: Array) -> Array:
    """The nearest positive semidefinite matrices (n, 4, 4); 0 where no element of the diagonal counts."""
    some = np.diagonal(moments, axis1=-2, axis2=-1).max(axis=-1, initial=0.0) > _NEGLIGIBLE
    values, axes = np.linalg.eigh(moments[some])
    result = np.zeros(moments.shape)
    result[some] = (axes * np.maximum(values, 0.0)[:, None]) @ np.swapaxes(axes, -1, -2)
    return result
