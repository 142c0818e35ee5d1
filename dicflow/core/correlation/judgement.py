"""The points that a search has found: which of them count, and with what covariance."""

from __future__ import annotations

from functools import partial
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Mask
from dicflow.core.correlation.chain import chained, uncancelled_noise
from dicflow.core.correlation.edges import find_edges, residual_variance, usual_residual
from dicflow.core.correlation.follow import Field
from dicflow.core.correlation.jumps import find_jumps
from dicflow.core.correlation.misfit import misfit_covariance, misfit_stride, sampled_misfit
from dicflow.core.correlation.points import DIRECT, VIA_REFERENCE_STEP, FoundPoints, ReferencePhotograph
from dicflow.core.correlation.search import CorrelatedField, Search, correlate_points
from dicflow.core.correlation.warp import gradient
from dicflow.core.parts import single_part
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.photographs.noise import interpolated_noise_ratio
from dicflow.core.status import Status
from dicflow.core.tensors import congruent, inverse
from dicflow.core.threads import at_once

__all__ = ["UNEXPLAINED", "find_points", "judge"]


UNEXPLAINED = (Status.UNTRACKED, Status.NOT_CONVERGED, Status.LOW_CORRELATION)
"""Codes of lost points for which the search knows no reason."""
_STRONG_BLUR_PX2 = 1.0
"""Variance of the blur of one photograph against the other from which it is the reason [px²]."""
_MOST_LEFT = 0.07
"""Variance of the residual beyond the noise, over that of the pattern, up to which a strong blur is a Gaussian: 0.03 at
most with lenses out of focus and motion during the exposure, and 0.15 or more where one of them reverses contrast."""


def find_points(
    reference: ReferencePhotograph,
    target: Spline,
    starts: Array,
    search: Search,
    route: int = DIRECT,
    usual: float = np.inf,
) -> FoundPoints:
    """Find the points of a reference photograph in the target.

    starts : (rows, cols, 2, 3) — from the first photograph to the target
    route, usual : as for :func:`judge`
    """
    return judge(reference, correlate_points(reference, target, starts, search), search, route, usual)


def judge(
    reference: ReferencePhotograph,
    correlation: CorrelatedField,
    search: Search,
    route: int = DIRECT,
    usual: float = np.inf,
) -> FoundPoints:
    """The points with their covariance, without those whose subset holds two motions or an edge of light.

    route : VIA_REFERENCE_STEP counts the noise of the reference photograph too
    usual : variance of the residual in a larger field of the same target; infinite if unknown [grey levels²]

    Points at edges are lost with the status that says why: MISFIT, UNEVEN_LIGHT or DISCONTINUITY.
    """
    with_residuals = partial(_by_residuals, reference, correlation, search, usual)
    with_noise = partial(_by_noise, reference, correlation, search, route)
    residuals, of_all = at_once(search.threads, with_residuals, with_noise)
    field = residuals.field
    lost = (field.status != Status.VALID) & (correlation.field.status == Status.VALID)
    noise = _Noise(*(_without(values, lost) for values in of_all))
    covariance, by_misfit = noise.covariance, 0.0 * noise.covariance
    if residuals.misfit is not None:
        by_misfit = congruent(noise.slope, misfit_covariance(residuals.misfit, residuals.stride, noise.unit))
        covariance = covariance + by_misfit
    if search.counts_misfit and residuals.edge_variance.any():
        covariance = covariance + congruent(noise.slope, residuals.edge_variance[..., None] * np.array([1.0, 0.0, 1.0]))
    return FoundPoints(
        noise.warp,
        field.znssd,
        field.iterations,
        field.status,
        covariance,
        np.where(field.status == Status.VALID, route, 0).astype(np.uint8),
        noise.template,
        noise.inherited,
        noise.slope,
        _without(residuals.residual, lost),
        by_misfit,
    )


class _Noise(NamedTuple):
    """What noise does to the points (rows, cols) of a field; NaN where there are none.

    warp : (…, 2, m) — from the first photograph
    slope : (…, 2, 2) — gradient of the motion from the reference photograph
    covariance : (…, 3) — of the places, without the noise of the first photograph [px²]
    inherited : (…, 3) — share of reference steps in it [px²]
    template : (…, 3) — of the places, by the noise of the template [px² of the first photograph]
    unit : (…, 3) — of the places, by white noise of one grey level in one photograph [px² of the template]
    """

    warp: Array
    slope: Array
    covariance: Array
    inherited: Array
    template: Array
    unit: Array


def _by_noise(reference: ReferencePhotograph, correlation: CorrelatedField, search: Search, route: int) -> _Noise:
    """What noise does to the points that were found, those at edges too."""
    field, centres, damping = correlation.field, correlation.centres, correlation.damping
    noise = 0.5 * search.noise**2 * field.covariance
    warp, slope = chained(reference.warp, field.warp, centres)
    inherits = reference.inherited_covariance.any()
    inherited = congruent(slope, reference.inherited_covariance) if inherits else 0.0 * noise
    if route == VIA_REFERENCE_STEP:
        remaining = uncancelled_noise(reference.slope, field.warp.shape[-1], search.degree)
        inherited = inherited + (damping.template * remaining)[..., None] * noise
    target = _target_noise(slope, correlation, search)
    covariance = inherited + (target + damping.excess)[..., None] * noise
    template = congruent(inverse(warp[..., 1:3]), damping.template * noise)
    return _Noise(warp, slope, covariance, inherited, template, 0.5 * congruent(inverse(slope), field.covariance))


def _target_noise(slope: Array, correlation: CorrelatedField, search: Search) -> Array:
    """Variance (...) of places by the noise of the target, over that by the template's where nothing blurs it.

    slope : (..., 2, 2) — gradient of the motion at the points
    """
    ratio = correlation.damping.target * correlation.gain * search.target_noise_ratio**2
    return ratio * interpolated_noise_ratio(slope, search.degree)


class _Residuals(NamedTuple):
    """What the residuals of a field tell.

    field : with the reasons of points at edges, and without their warps
    residual : (rows, cols) — variance of the residuals [grey levels²]
    edge_variance : (rows, cols) — further variance of the places near edges [px²]
    misfit, stride : for :func:`misfit_covariance`; None where it does not count
    """

    field: Field
    residual: Array
    edge_variance: Array
    misfit: Array | None = None
    stride: int = 1


def _by_residuals(
    reference: ReferencePhotograph, correlation: CorrelatedField, search: Search, usual: float
) -> _Residuals:
    """What residuals tell of the points that were found; those at edges tell nothing of the misfit."""
    residuals = _without_edges(reference, correlation, search, usual)
    if not search.counts_misfit:
        return residuals
    near_edge = residuals.edge_variance > 0.0
    stride = misfit_stride(np.isfinite(residuals.field.warp[..., 0, 0]) & ~near_edge)
    some = slice(None, None, stride), slice(None, None, stride)
    centres, points = correlation.centres[some], reference.points[some]
    warp = _without(residuals.field.warp[some], near_edge[some])
    target = _target_noise(gradient(warp, points - centres), correlation, search)
    noise = search.noise**2 * (correlation.damping.template + target)
    pair = correlation.template, correlation.target
    misfit = sampled_misfit(*pair, centres - reference.origin, warp, search.subset, noise, search.threads)
    return residuals._replace(misfit=misfit, stride=stride) if misfit.any() else residuals


def _without_edges(
    reference: ReferencePhotograph, correlation: CorrelatedField, search: Search, usual: float
) -> _Residuals:
    """The field without the points at edges, and the further variance of those near them."""
    field, pair = correlation.field, (correlation.template, correlation.target)
    places = correlation.centres - reference.origin
    noise_variance = search.noise**2 * (1.0 + correlation.gain * search.target_noise_ratio**2)
    residual = residual_variance(field)
    usual = min(usual, usual_residual(residual))
    usual = max(usual, noise_variance) if np.isfinite(usual) else noise_variance
    edges = find_edges(*pair, places, field, search.subset, residual, usual)
    parts = single_part(places) if search.parts is None else search.parts
    edges = find_jumps(edges, places, field, parts, search.subset, search.jumps)
    lost = edges.reason != Status.VALID
    status = np.where(lost, edges.reason, field.status)
    if correlation.damping.blur >= _STRONG_BLUR_PX2:
        no_gaussian = ~lost & (residual - noise_variance > _MOST_LEFT * field.texture[..., 0])
        status[np.isin(status, UNEXPLAINED) | no_gaussian] = Status.BLURRED
        lost |= no_gaussian
    return _Residuals(field._replace(status=status, warp=_without(field.warp, lost)), residual, edges.variance)


def _without(values: Array, lost: Mask) -> Array:
    """Values (rows, cols, …) of points, NaN for some (rows, cols)."""
    if not lost.any():
        return values
    return np.where(lost.reshape(lost.shape + (1,) * (values.ndim - 2)), np.nan, values)
