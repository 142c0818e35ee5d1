"""Deformation gradient of a measured surface from its reference state, and its uncertainty.

The surface in both states is fitted around every point by a polynomial over the window of the material grid (least
squares, each point weighted with 1 / σ² of its displacement). Its slopes give the gradient, and their errors those of
the gradient to first order (:mod:`dicflow.core.strain.gradient_response`).

Slopes of a fit are sums Σₙ wₙ Xₙ over the window, so their covariance is that of a point times Q = Σₙₘ wₙ ρₙₘ wₘ, where
ρ is the correlation of points whose subsets overlap. It depends on the shape function, so the shares in the covariance
are propagated one by one.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.parts import Parts, single_part
from dicflow.core.strain.gradient_response import gradient_and_response, gradient_covariance
from dicflow.core.strain.surface_strain import jacobian
from dicflow.core.strain.window_fits import WindowedPoints
from dicflow.core.threads import over
from dicflow.core.uncertainty.covariance import displacement_variances
from dicflow.core.uncertainty.overlap import Overlap, lag_products

__all__ = [
    "ErrorShare",
    "MeasuredSurface",
    "SurfaceGradient",
    "measured_surface",
    "pixel_size_mm",
]


_CHUNK = 2000
"""Windows that are fitted at once."""
_AROUND = (5, 5)
"""Points around one that share the directions of their errors."""
_UNSURE = 1.5
"""Standard deviation over the least one around, above which a point is much less certain; half a subset has √2."""
_ALIKE, _APART = 0.5, 1000.0
"""Difference of the logarithms of sums of squares of weights below which windows are much alike, and more than such
differences that there are."""


class ErrorShare(NamedTuple):
    """Share in the errors of points by subsets of one kind.

    covariance : (row, col, 6, 6) — of each point at the step and at the reference state, in this order
    rho : correlation of the errors of two points, by overlap of their subsets
    along : that of the errors along each of three axes, where it differs
    """

    covariance: Array
    rho: Overlap
    along: tuple[Overlap, ...] = ()

    def reaching(self, kinds: _WindowKinds) -> Array:
        """Factors (n, m, 6) for the errors along each axis in sums over windows, by their reach.

        Ratios of the standard deviations of these sums to those by overlap.
        """
        flat = kinds.products.reshape(*kinds.products.shape[:2], -1)
        window = kinds.products.shape[2:]
        by_overlap, *by_axis = (flat @ rho.in_window(window).ravel() for rho in (self.rho, *self.along))
        return np.tile(np.sqrt(np.stack(by_axis, axis=-1) / by_overlap[..., None]), 2)[kinds.kind]


class _WindowKinds(NamedTuple):
    """Windows whose weights are of much the same sizes, by one of each kind.

    products : (kind, m, high, wide) — of the weights, by distance; NaN where the windows have too few points
    kind : (n,) — of each window
    """

    products: Array
    kind: Index

    @classmethod
    def of(cls, weights: Array) -> _WindowKinds:
        """Those of sums with weights (n, m, high, wide)."""
        sizes = np.log(np.einsum("nmij,nmij->nm", weights, weights))
        both = np.rint(sizes / _ALIKE) @ _APART ** np.arange(sizes.shape[1])
        _, some, kind = np.unique(both, return_index=True, return_inverse=True)
        return cls(lag_products(weights[some]), np.asarray(kind.ravel()))


class SurfaceGradient(NamedTuple):
    """Deformation gradients on the grid; NaN where the point or too much of its window is missing.

    gradient : (row, col, 2, 2) — F [-]
    covariance : (row, col, 4, 4) — of F₁₁, F₁₂, F₂₁, F₂₂ [-]
    response : (row, col, 4, 2, 6) — derivatives of these by the slopes, per column and per row, of the point at the
        step and at the reference state [1/mm]
    """

    gradient: Array
    covariance: Array
    response: Array


class MeasuredSurface(NamedTuple):
    """A surface in two states, as windows of its points are fitted.

    points : values (row, col, 6) are the places at the step and in the reference state
    errors : independent shares that add up to the errors of the points
    threads : so many threads fit windows
    """

    points: WindowedPoints
    errors: Sequence[ErrorShare]
    threads: int = 1

    @property
    def known(self) -> Mask:
        """(row, col) — the points that count."""
        return np.asarray(self.points.weights > 0.0)

    def gradient(self, at: Index, window: tuple[int, int], degree: int) -> SurfaceGradient:
        """Deformation gradients (n, …) at rows and columns (n, 2), by polynomials in a window (high, wide) [points]."""
        chunks = np.array_split(at, max(1, -(-len(at) // _CHUNK)))
        found = over(
            self.threads, lambda part: self.gradient_by(part, self.points.slope_weights(part, window, degree)), chunks
        )
        return SurfaceGradient(*(np.concatenate(field) for field in zip(*found, strict=True)))

    def gradient_by(self, at: Index, weights: Array) -> SurfaceGradient:
        """The same by the weights (n, 2, high, wide) of the points in both slopes."""
        slopes = np.swapaxes(self.points.sums(at, weights), -1, -2)
        before, after = slopes[:, 3:], slopes[:, :3]
        gradient, response = gradient_and_response(before, after)
        return SurfaceGradient(gradient, self.covariance_by(at, weights, response), response)

    def covariance_by(self, at: Index, weights: Array, response: Array) -> Array:
        """Covariance (n, 4, 4) of the gradient, or of a change of it, by the weights in the slopes."""
        with np.errstate(invalid="ignore"):
            kinds = _WindowKinds.of(weights) if any(share.along for share in self.errors) and len(at) else None
            parts = [
                gradient_covariance(
                    response * share.reaching(kinds)[:, None] if kinds and share.along else response,
                    self.points.variances(at, weights, share.rho),
                    share.covariance[at[:, 0], at[:, 1]],
                )
                for share in self.errors
            ]
        return np.asarray(np.sum(parts, axis=0))


def measured_surface(
    reference: Array, deformed: Array, errors: Sequence[ErrorShare], parts: Parts | None = None, min_share: float = 0.25
) -> MeasuredSurface:
    """A surface from its points in both states.

    reference, deformed : (row, col, 3) — the points of a regular material grid [mm]; of a plane in the image
        the third coordinate is 0 [px]
    errors : a point without covariance does not count
    parts : of the grid, each of which moves on its own; None for a single one
    min_share : share of a window's points that must have a value
    """
    whole = np.sum([share.covariance for share in errors], axis=0)
    sigma = np.sqrt(displacement_variances(whole).sum(axis=-1))
    known = np.asarray(np.isfinite(reference + deformed).all(axis=-1) & np.isfinite(sigma))
    sigma = np.where(known, np.maximum(sigma, 1e-12), 0.0)
    weights = np.where(known, 1.0 / np.where(known, sigma, 1.0) ** 2, 0.0)
    weights /= max(float(weights.max(initial=0.0)), 1e-300)
    both = np.concatenate([deformed, reference], axis=-1)
    centre = both[known].mean(axis=0) if known.any() else 0.0
    values = np.where(known[..., None], both - centre, 0.0)
    parts = single_part(reference[..., :2]) if parts is None else parts
    typical = [share._replace(covariance=_as_around(share.covariance, sigma)) for share in errors]
    return MeasuredSurface(WindowedPoints(values, weights, sigma, parts, min_share), typical)


def _as_around(covariance: Array, sigma: Array) -> Array:
    """Covariances (row, col, 6, 6), those of much less certain points with the directions of the points around.

    A window's fit has those of all its points, more of the more certain ones, from which a point beside a jump differs.
    sigma : (row, col) — standard deviations of the points; 0 where unknown
    """
    known = sigma > 0.0
    least = cv2.erode(np.where(known, sigma, np.inf), np.ones(_AROUND, dtype=np.uint8))
    unsure = known & (sigma / _UNSURE > least)
    if not unsure.any():
        return covariance
    share = np.divide(1.0, sigma**4, out=np.zeros_like(sigma), where=known)
    scale = sigma**2 / np.maximum(cv2.boxFilter(share * sigma**2, -1, _AROUND, normalize=False), 1e-300)
    found = covariance.copy()
    for i, j in zip(*np.triu_indices(covariance.shape[-1]), strict=True):
        part = np.where(known, share * covariance[..., i, j], 0.0)
        around = cv2.boxFilter(part, -1, _AROUND, normalize=False)[unsure] * scale[unsure]
        found[unsure, i, j] = found[unsure, j, i] = around
    return np.asarray(found)


def pixel_size_mm(reference: Array, step_size: float) -> Array:
    """Side of a pixel of the photograph on the surface (row, col), the root of its area [mm/px].

    reference : (row, col, 3) — the points in the reference state [mm]
    step_size : distance of the grid's points [px]
    """
    across = jacobian(reference, (3, 3), 1)
    area = np.linalg.norm(np.cross(across[..., 0], across[..., 1]), axis=-1)
    return np.asarray(np.sqrt(area) / step_size)
