"""The subsets of a reference photograph searched for in a target."""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Grey, Image, Mask, all_finite
from dicflow.core.correlation.blur import Damping, equally_sharp
from dicflow.core.correlation.edges import residual_variance
from dicflow.core.correlation.follow import Field, correlate_field
from dicflow.core.correlation.points import FoundPoints, ReferencePhotograph, cropped
from dicflow.core.correlation.subsets import OwnSubsets, Subset, describe, with_sums
from dicflow.core.correlation.template import Template, template, with_usable
from dicflow.core.correlation.warp import gradient, identity, warp_from_gradient
from dicflow.core.parts import Parts
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.photographs.interpolate import Spline, spline
from dicflow.core.photographs.noise import interpolated_variance
from dicflow.core.status import Status
from dicflow.core.tensors import inverse, product

__all__ = [
    "CorrelatedField",
    "Search",
    "correlate_again",
    "correlate_points",
    "first_photograph",
    "noise_of_residual",
    "own_subsets",
    "points_in_first_photograph",
    "target_spline",
    "without_mixed_rim",
]


_MIN_POINTS_FOR_GAIN = 100
"""With fewer, the contrast of both photographs counts as equal."""
_MOST_POINTS_FOR_NOISE = 20_000
"""More do not make the noise more certain."""
_MIXED_SIGMAS = 0.7
"""Distance from a rim up to which pixels are left out [standard deviations of a blur]: those beyond mix by a quarter or
less, and a half subset keeps enough of its pixels."""


class Search(NamedTuple):
    """Settings of a search for subsets.

    subset : size, shape function and convergence
    degree : of the splines, 3 or 5
    smoothing_px : standard deviation of the Gaussian that smooths all photographs first; 0 for none
    max_znssd : a subset that fits worse is not found
    noise : standard deviation of the noise of the templates' photographs [grey levels]
    target_noise_ratio : noise of the target over that of the template [grey levels]
    threads : how many share the points
    counts_misfit : whether residuals beyond the noise add to the covariance
    parts : of the grid; None for a single one
    reach_px : longest motion from a step to the next; half the period of a pattern that repeats itself
    jumps : (rows, cols) bool — points at which the motion jumps in another photograph; None without any
    """

    subset: Subset
    degree: int = 5
    smoothing_px: float = 0.0
    max_znssd: float = 0.3
    noise: float = 1.0
    target_noise_ratio: float = 1.0
    threads: int = 1
    counts_misfit: bool = False
    parts: Parts | None = None
    reach_px: float = np.inf
    jumps: Mask | None = None


def first_photograph(image: Photograph, region: Mask, grid: Array, search: Search) -> ReferencePhotograph:
    """The first photograph as a reference photograph.

    region : (h, w) bool
    grid : (rows, cols, 2) — whole pixels; NaN outside the region
    """
    warp = identity(grid, search.subset.shape_function)  # type: ignore[arg-type]
    exact = np.zeros((*grid.shape[:2], 3))
    return cropped(ReferencePhotograph(image, (0, 0), region, grid, warp, exact, gradient(warp)), search.subset.size)


def points_in_first_photograph(first: ReferencePhotograph, search: Search) -> FoundPoints:
    """The points in the first photograph itself, where it can be searched for with its subsets.

    The covariance is that of the first photograph's noise, which all later places share; NaN where a point has no
    value.
    """
    itself, inside = target_spline(first.image, search), all_finite(first.points)
    own, centres = template(itself, first.region, search.threads), first.points - first.origin
    _, sums = _subsets(own, centres, search)
    found = describe(own, itself.measured, centres[inside], search.subset, search.threads, sums)
    status = np.full(inside.shape, Status.OUTSIDE, dtype=np.uint8)
    znssd, covariance = np.full(inside.shape, np.nan), np.full((*inside.shape, 3), np.nan)
    status[inside], znssd[inside] = found.status, found.znssd
    covariance[inside] = 0.5 * search.noise**2 * found.covariance
    warp = np.where((status == Status.VALID)[..., None, None], first.warp, np.nan)
    fit = znssd, np.zeros(inside.shape, dtype=np.int16), status
    route = np.zeros(inside.shape, dtype=np.uint8)
    none = 0.0 * covariance
    return FoundPoints(warp, *fit, covariance, route, covariance, none, warp[..., 1:3], 0.0 * znssd, none)


def target_spline(image: Photograph, search: Search) -> Spline:
    """The spline of a photograph, for a search in it."""
    return spline(_smoothed(image.grey, search), search.degree, image.measured)


class CorrelatedField(NamedTuple):
    """The subsets of a reference photograph correlated with a target; the noise has no part in it.

    template, target : the photographs, equally sharp
    centres : (rows, cols, 2) — of the subsets, whole pixels of the reference photograph
    field : with warps of the subsets from the reference photograph
    damping : of the noise of both, by a blur that made them equally sharp
    gain : variance of the template's grey levels over that of the target's
    """

    template: Template
    target: Spline
    centres: Array
    field: Field
    damping: Damping = Damping()
    gain: float = 1.0


def noise_of_residual(correlation: CorrelatedField, degree: int, side: int) -> tuple[Array, Array, Array]:
    """Points found (n, 2), their places in the target (n, 2) [px], and the variance of the noise of one photograph as
    the residual of their subsets has it (n,) [grey levels²]; of many points, evenly chosen ones.

    degree : of the spline; side : of the subsets [px]
    """
    field, damping = correlation.field, correlation.damping
    valid = np.flatnonzero(field.status == Status.VALID)
    chosen = np.unravel_index(valid[:: 1 + len(valid) // _MOST_POINTS_FOR_NOISE], field.status.shape)
    warp = field.warp[chosen]
    of_target = correlation.gain * damping.target_grey * interpolated_variance(degree, warp, side)
    variance = residual_variance(field)[chosen] / (damping.template_grey + of_target)
    return correlation.centres[chosen], warp[..., 0], variance


def own_subsets(reference: ReferencePhotograph, search: Search) -> OwnSubsets:
    """The subsets of a reference photograph as sharp as it is."""
    own = _template(reference, _smoothed(reference.image.grey, search), search)
    return _subsets(own, np.rint(reference.points) - reference.origin, search)


def correlate_points(
    reference: ReferencePhotograph, target: Spline, starts: Array, search: Search, own: OwnSubsets | None = None
) -> CorrelatedField:
    """Correlate the subsets around the whole pixels next to the points of a reference photograph.

    starts : (rows, cols, 2, 3) — from the first photograph to the target
    own : the subsets of the reference photograph; None if they are not made yet
    """
    own = own_subsets(reference, search) if own is None else own
    centres, places, warps = _centres_and_warps(reference, starts)
    known = all_finite(warps, 2) & all_finite(places)
    image, target, damping = equally_sharp(
        own.template.grey, reference.region, target, places[known], warps[known], search.smoothing_px
    )
    if image is not own.template.grey:
        own = _subsets(_template(reference, image, search), places, search)
    own = own._replace(template=without_mixed_rim(own.template, damping.mixing))
    field = _correlated(own, target, places, warps, search)
    sharp = own.template
    return CorrelatedField(sharp, target, centres, field, damping, _gain(sharp, target, places, field))


def correlate_again(
    reference: ReferencePhotograph, before: CorrelatedField, starts: Array, search: Search
) -> CorrelatedField:
    """The same photographs, as sharp as before, correlated with another shape function or other starts."""
    centres, places, warps = _centres_and_warps(reference, starts)
    field = _correlated(_subsets(before.template, places, search), before.target, places, warps, search)
    return before._replace(centres=centres, field=field)


def _subsets(own: Template, places: Array, search: Search) -> OwnSubsets:
    """The subsets of a template around whole pixels (rows, cols, 2)."""
    return with_sums(own, places, search.subset, search.threads)


def _template(reference: ReferencePhotograph, image: Image, search: Search) -> Template:
    """The template of a reference photograph with other grey levels."""
    return template(spline(image, search.degree, reference.image.measured), reference.region, search.threads)


def without_mixed_rim(own: Template, mixing: float) -> Template:
    """A template without the pixels at rims of the region where a blur mixes the material with what lies beyond.

    mixing : standard deviation of the blur [px]
    """
    width = round(_MIXED_SIGMAS * mixing)
    if width == 0:
        return own
    inner = cv2.erode(own.region.astype(np.uint8), np.ones((2 * width + 1,) * 2, dtype=np.uint8)) > 0
    return with_usable(own, own.usable & inner)


def _centres_and_warps(reference: ReferencePhotograph, starts: Array) -> tuple[Array, Array, Array]:
    """Whole pixels next to the points, in the first photograph and in the reference's crop, and the warps there."""
    slope, centres = _motion_gradients(reference, starts), np.rint(reference.points)
    place = starts[..., 0] + np.einsum("...ij,...j->...i", slope, centres - reference.points)
    return centres, centres - reference.origin, warp_from_gradient(place, slope)


def _gain(own: Template, target: Spline, places: Array, field: Field) -> float:
    """Variance of the grey levels of a template over that of a target, at the points found; 1 where it is unknown."""
    valid = field.status == Status.VALID
    if valid.sum() < _MIN_POINTS_FOR_GAIN:
        return 1.0
    views = (own.grey, places[valid]), (target.image, field.warp[..., 0][valid])
    here, there = (np.var(image[tuple(np.rint(at).astype(int).T[::-1])]) for image, at in views)
    return float(here / there) if here > 0.0 and there > 0.0 else 1.0


def _correlated(own: OwnSubsets, target: Spline, places: Array, warps: Array, search: Search) -> Field:
    return correlate_field(
        own,
        target,
        places,
        warps,
        search.subset,
        max_znssd=search.max_znssd,
        threads=search.threads,
        parts=search.parts,
    )


def _smoothed(image: Grey, search: Search) -> Image:
    grey = image.astype(np.float32)
    if search.smoothing_px > 0.0:
        grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), search.smoothing_px), dtype=np.float32)
    return grey


def _motion_gradients(reference: ReferencePhotograph, starts: Array) -> Array:
    """Gradients (rows, cols, 2, 2) of the motion from a reference photograph to where ``starts`` lead."""
    known = np.where(np.isnan(reference.warp[..., 1:3]), np.eye(2), reference.warp[..., 1:3])
    return product(starts[..., 1:3], inverse(known))
