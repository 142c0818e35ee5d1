"""Systematic error of a strain's polynomials, estimated from the points.

A polynomial of too low a degree for its window has a bias. It is estimated by a **pilot**, a polynomial in a window
1.5 times as wide. The fit, applied to a pilot of a higher degree, differs from the pilot by its bias: a change δF of
the gradient, which would be noise alone without it. From degree 3 the pilot has the degree of the fit; a bias grows
with the window's side by at least the power of the degree, so that it is a share of the change between both.

δF is a weighted sum of the points, so its covariance is known. The mean of δF δFᵀ − Cov δF over neighbouring points, in
units of the fit's own σ, less four times its standard error, estimates the second moments of the bias.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.strain.deformation_gradient import MeasuredSurface
from dicflow.core.strain.window_fits import places_of, polynomial_terms, terms_of_degree, widened

__all__ = ["CUBIC", "WindowFit", "relative_bias"]


CUBIC = 3
"""Degree of the pilot, and the highest that is chosen."""
_PILOT = 1.5
"""Side of the pilot's window in sides of the window."""
_STANDARD_ERRORS = 4.0
"""Standard errors by which the mean of changes must exceed that of noise."""
_REACH = 0.6
"""Standard deviation of the weights of neighbours [sides of the window]."""
_AREA = 0.8
"""Area over which the errors of changes are correlated, Σ ρ² over all distances [squares of the window's side]."""
_NEGLIGIBLE = 1e-3
"""Second moment of a bias below which it is taken as 0 [σ² of the fit]."""
_CHUNK = 2000
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

    def on_grid(self, cells: Array, shape: tuple[int, ...]) -> Array:
        """A field of the cells (row, col, …) on the whole grid: of each point that of its cell."""
        whole = cells.repeat(self.stride, axis=0).repeat(self.stride, axis=1)
        return np.asarray(whole[: shape[0], : shape[1]])

    def sums(self, values: Array) -> Array:
        """Weighted sums over the neighbours of each cell, of a field (row, col, k); the weights add up to 1."""
        return self._blurred(values, 1.0)

    def variances(self, variances: Array) -> Array:
        """Variances of such sums, from those (row, col, k) of values whose errors are correlated over an area."""
        down, across = (_REACH * side / self.stride for side in self.window)
        correlated = max(1.0, _AREA * self.window[0] * self.window[1] / self.stride**2)
        return correlated / (4.0 * np.pi * down * across) * self._blurred(variances, np.sqrt(0.5))

    def _blurred(self, values: Array, scale: float) -> Array:
        down, across = (scale * _REACH * side / self.stride for side in self.window)
        return np.asarray(
            cv2.GaussianBlur(values, (0, 0), across, sigmaY=down, borderType=cv2.BORDER_CONSTANT)
        ).reshape(values.shape)


def relative_bias(surface: MeasuredSurface, fit: WindowFit, wanted: Mask) -> Array:
    """Second moments (row, col, 4, 4) of the bias of a fit in F₁₁, F₁₂, F₂₁, F₂₂, in units of σ of each.

    wanted : (row, col) — points around which they are estimated; 0 far from them
    """
    rows, cols = wanted.shape
    stride = max(1, min(*fit.window, 2 * rows, 2 * cols) // 2)
    samples = _Samples((-(-rows // stride), -(-cols // stride)), stride, fit.window)
    near = cv2.dilate(wanted.astype(np.uint8), np.ones([2 * side + 1 for side in fit.window], dtype=np.uint8)) > 0
    places = samples.places(surface.known & near)
    largest = np.zeros((*samples.shape, 4, 4))
    if len(places) == 0:
        return np.zeros((rows, cols, 4, 4))
    chunks = np.array_split(places, -(-len(places) // _CHUNK))
    for parts in zip(*(list(_estimates(surface, part, fit)) for part in chunks), strict=True):
        bias, covariance = (np.concatenate(field) for field in zip(*parts, strict=True))
        moments = _mean_excess(samples, places, bias, covariance)
        larger = np.trace(moments, axis1=-2, axis2=-1) > np.trace(largest, axis1=-2, axis2=-1)
        largest[larger] = moments[larger]
    return samples.on_grid(largest, wanted.shape)


def _estimates(surface: MeasuredSurface, at: Index, fit: WindowFit) -> Iterator[tuple[Array, Array]]:
    """Biases (n, 4) of the gradient by each change, in units of the fit's σ, and their covariances (n, 4, 4)."""
    own = surface.points.slope_weights(at, *fit)
    found = surface.gradient_by(at, own)
    sigma = np.sqrt(np.diagonal(found.covariance, axis1=-2, axis2=-1))
    with np.errstate(invalid="ignore", divide="ignore"):
        for weights, share in _changes(surface, at, fit, own):
            slopes = surface.points.sums(at, weights)
            bias = np.einsum("nfai,nai->nf", found.response, slopes) * share / sigma
            covariance = surface.covariance_by(at, weights, found.response)
            yield bias, covariance * share**2 / (sigma[:, :, None] * sigma[:, None])


def _changes(surface: MeasuredSurface, at: Index, fit: WindowFit, own: Array) -> Iterator[tuple[Array, float]]:
    """Weights (n, 2, high, wide) of changes of the slopes, and the share of the bias in each.

    own : (n, 2, high, wide) — weights of the fit's slopes
    """
    points = surface.points
    for degree in range(fit.degree + 1, CUBIC + 1):
        errors = _errors_of_terms(own, fit.pilot, terms_of_degree(degree))
        yield points.functional_weights(at, fit.pilot, errors), 1.0
    if fit.degree >= CUBIC:
        ratio = np.sqrt(np.prod(fit.pilot) / np.prod(fit.window))
        weights = points.slope_weights(at, fit.pilot, fit.degree) - widened(own, fit.pilot)
        yield weights, float(1.0 / (ratio**fit.degree - 1.0))


def _errors_of_terms(own: Array, window: tuple[int, int], count: int) -> Array:
    """Errors (n, 2, terms) of slopes by weights (n, 2, high, wide) for each polynomial term of a wider window."""
    terms = polynomial_terms(window, count)
    high, wide = ((side - part) // 2 for side, part in zip(window, own.shape[2:], strict=True))
    inner = terms[:, high : window[0] - high, wide : window[1] - wide]
    found = own.reshape(len(own), 2, -1) @ inner.reshape(count, -1).T
    found[:, 0, 2] -= 2.0 / (window[1] + 1.0)
    found[:, 1, 1] -= 2.0 / (window[0] + 1.0)
    return np.asarray(found)


def _mean_excess(samples: _Samples, places: Index, bias: Array, covariance: Array) -> Array:
    """Mean of δF δFᵀ − Cov δF over neighbours, less some standard errors, positive semidefinite; (row, col, 4, 4).

    bias, covariance : (n, 4) and (n, 4, 4) — of samples; one counts the less the larger its noise is
    """
    measured = np.isfinite(bias).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    places, bias, covariance = places[measured], bias[measured], covariance[measured]
    noise = np.diagonal(covariance, axis1=-2, axis2=-1)
    weight = 1.0 / (1.0 + noise.mean(axis=-1, keepdims=True)) ** 2
    excess = (bias[:, :, None] * bias[:, None] - covariance).reshape(-1, 16)
    weights, products, variances = (
        samples.cells(places, values) for values in (weight, weight * excess, 2.0 * (weight * noise) ** 2)
    )
    share = samples.sums(weights)
    near = share[..., 0] > 0.0
    moments = (samples.sums(products)[near] / share[near]).reshape(-1, 4, 4)
    error = np.sqrt(np.maximum(samples.variances(variances)[near], 0.0)) / share[near]
    moments[:, range(4), range(4)] -= _STANDARD_ERRORS * error
    result = np.zeros((*samples.shape, 4, 4))
    result[near] = _positive(moments)
    return result


def _positive(moments: Array) -> Array:
    """The nearest positive semidefinite matrices (n, 4, 4); 0 where no element of the diagonal counts."""
    some = np.diagonal(moments, axis1=-2, axis2=-1).max(axis=-1, initial=0.0) > _NEGLIGIBLE
    values, axes = np.linalg.eigh(moments[some])
    result = np.zeros(moments.shape)
    result[some] = (axes * np.maximum(values, 0.0)[:, None]) @ np.swapaxes(axes, -1, -2)
    return result
