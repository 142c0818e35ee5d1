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
from dicflow.core.correlation.misfit import misfit_covariance, misfit_samples, misfit_share
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
    residuals = partial(_by_residuals, reference, correlation, search, usual)
    places = partial(_by_noise, reference, correlation, search, route)
    (field, edge_variance, misfit), noise = at_once(search.threads, residuals, places)
    lost = (field.status != Status.VALID) & (correlation.field.status == Status.VALID)
    noise = _Noise(*(_without(values, lost) for values in noise))
    covariance, by_misfit = noise.covariance, 0.0 * noise.covariance
    if misfit is not None:
        share, samples = misfit
        by_misfit = congruent(noise.slope, misfit_covariance(share, samples, noise.unit))
        covariance = covariance + by_misfit
    if search.counts_misfit and edge_variance.any():
        covariance = covariance + congruent(noise.slope, edge_variance[..., None] * np.array([1.0, 0.0, 1.0]))
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
        residual_variance(field),
        by_misfit,
    )


class _Noise(NamedTuple):
    """What noise does to the points (rows, cols) of a field, those at edges too.

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
    """What noise does to the points that were found."""
    field, centres, damping = correlation.field, correlation.centres, correlation.damping
    noise = 0.5 * search.noise**2 * field.covariance
    slope = gradient(field.warp, reference.points - centres)
    inherited = reference.inherited_covariance
    if inherited.any():
        inherited = congruent(slope, inherited)
    if route == VIA_REFERENCE_STEP:
        remaining = uncancelled_noise(reference.slope, field.warp.shape[-1], search.degree)
        inherited = inherited + (damping.template * remaining)[..., None] * noise
    target = _target_noise(slope, correlation, search)
    covariance = inherited + (target + damping.excess)[..., None] * noise
    warp = chained(reference.warp, field.warp, centres)
    template = congruent(inverse(warp[..., 1:3]), damping.template * noise)
    return _Noise(warp, slope, covariance, inherited, template, 0.5 * congruent(inverse(slope), field.covariance))


def _target_noise(slope: Array, correlation: CorrelatedField, search: Search) -> Array:
    """Variance (...) of places by the noise of the target, over that by the template's where nothing blurs it.

    slope : (..., 2, 2) — gradient of the motion at the points
    """
    ratio = correlation.damping.target * correlation.gain * search.target_noise_ratio**2
    return ratio * interpolated_noise_ratio(slope, search.degree)


def _by_residuals(
    reference: ReferencePhotograph, correlation: CorrelatedField, search: Search, usual: float
) -> tuple[Field, Array, tuple[Array, tuple[slice, slice]] | None]:
    """What residuals tell: the field without points at edges, the further variance (rows, cols) of those near them
    [px²], and the misfit as :func:`_misfit` has it.
    """
    field, edge_variance = _without_edges(reference, correlation, search, usual)
    return field, edge_variance, _misfit(reference, correlation, field, edge_variance, search)


def _misfit(
    reference: ReferencePhotograph, correlation: CorrelatedField, field: Field, edge_variance: Array, search: Search
) -> tuple[Array, tuple[slice, slice]] | None:
    """Share of the misfit and the points that tell it, for :func:`misfit_covariance`; None where it does not count.

    field : without the subsets at edges; edge_variance : (rows, cols) — of those near them [px²]
    """
    if not search.counts_misfit:
        return None
    some = misfit_samples((edge_variance == 0.0) & np.isfinite(field.warp[..., 0, 0]))
    centres, points, warp = correlation.centres[some], reference.points[some], field.warp[some]
    warp = np.where((edge_variance[some] > 0.0)[..., None, None], np.nan, warp)
    target = _target_noise(gradient(warp, points - centres), correlation, search)
    noise = search.noise**2 * (correlation.damping.template + target)
    pair = correlation.template, correlation.target
    share = misfit_share(*pair, centres - reference.origin, warp, search.subset, noise, search.threads)
    return (share, some) if share.any() else None


def _without_edges(
    reference: ReferencePhotograph, correlation: CorrelatedField, search: Search, usual: float
) -> tuple[Field, Array]:
    """The field without subsets at edges, and the further variance (rows, cols) of those near them [px²]."""
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
    warp, covariance = _without(field.warp, lost), _without(field.covariance, lost)
    return field._replace(status=status, warp=warp, covariance=covariance), edges.variance


def _without(values: Array, lost: Mask) -> Array:
    """Values (rows, cols, …) of points, NaN for some (rows, cols)."""
    if not lost.any():
        return values
    return np.where(lost.reshape(lost.shape + (1,) * (values.ndim - 2)), np.nan, values)
