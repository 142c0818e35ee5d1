"""Material points of the first left photograph found in a right one.

The template is that of the left camera. Points that were found in the left photograph via a reference step are searched
for with the subsets of that step. The errors that the route to it adds are common to both photographs, so they are not
part of the covariance here.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Codes, Grey, Mask, all_finite
from dicflow.core.correlation.chain import uncancelled_noise
from dicflow.core.correlation.edges import usual_residual
from dicflow.core.correlation.judgement import UNEXPLAINED, find_points
from dicflow.core.correlation.partners import starting_warps
from dicflow.core.correlation.points import (
    VIA_REFERENCE_STEP,
    FoundPoints,
    ReferencePhotograph,
    carried_motion,
    cropped,
    merged,
    part_masks,
    with_terms,
)
from dicflow.core.correlation.search import Search
from dicflow.core.correlation.seed import ACCEPTED_CORRELATION, window_correlation, window_correlations
from dicflow.core.correlation.warp import TERMS
from dicflow.core.parts import Parts
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.photographs.noise import image_noise, interpolated_noise_ratio
from dicflow.core.photographs.texture import saturation_level
from dicflow.core.status import Status
from dicflow.core.tensors import congruent, inverse, product

__all__ = [
    "PointsInStep",
    "contrast",
    "follow_across",
    "grid_mask",
    "inherited_covariance",
    "noise_ratio",
    "overexposed_share",
    "starts_agree",
    "starts_from_previous_step",
    "why_lost",
]


_MIN_SHARE_WITH_START = 0.5
"""Share of the points that must have a starting warp."""


_SHOWN_CORRELATION = 0.3
"""Least correlation of windows that show the same, however badly they fit."""
_KNOWN_REASONS = (Status.LOW_CORRELATION, Status.BLURRED)
"""Codes that stay where the points around say no more; others become NO_MATCH."""


class PointsInStep(NamedTuple):
    """Places of the material points, on a grid (row, col), in the left or the right photograph of a step.

    xy : (..., 2) [px]; gradient : (..., 2, 2) — from the first left photograph
    """

    xy: Array
    gradient: Array


def follow_across(
    first: ReferencePhotograph,
    reference_step: ReferencePhotograph | None,
    route: Codes,
    target: Spline,
    starts: Array,
    search: Search,
) -> FoundPoints:
    """Find material points in a right photograph.

    first, reference_step : left photographs
    route : (row, col) — by which each point was found in the left photograph of the step
    starts : (row, col, 2, 3) — warps from the first left photograph; NaN where unknown
    Returns the points, with the covariance by the right photograph's noise alone. A point without a place in the
    reference step, because a later step has replaced the one it was found with, is searched for with the first
    photograph.
    """
    if reference_step is None:
        return find_points(_selected(first, np.ones_like(route, dtype=bool), search), target, starts, search)
    through = (route == VIA_REFERENCE_STEP) & all_finite(reference_step.points)
    found = find_points(_selected(first, ~through, search), target, starts, search)
    usual = usual_residual(found.residual)
    chained = find_points(_selected(reference_step, through, search), target, starts, search, usual=usual)
    routes = np.where(chained.valid, np.uint8(VIA_REFERENCE_STEP), chained.route)
    return merged(found, chained._replace(route=routes))


def inherited_covariance(matched: FoundPoints, search: Search, contrasts: tuple[float, float] = (1.0, 1.0)) -> Array:
    """Covariance (row, col, 3) that places found with subsets of the right photograph inherit from the match [px²].

    matched : result of :func:`follow_across` with the first left photograph and ``search``, on the grid (row, col)
    contrasts : of the left and of the right photograph [grey levels]

    The noise of the right photograph moved the matched point; with the point's own subset as the template it moves
    later places back, and little of it remains (:func:`dicflow.core.correlation.chain.uncancelled_noise`). The misfit
    between the two cameras remains.
    """
    slope = matched.slope
    ratio = search.target_noise_ratio * contrasts[0] / contrasts[1]
    noise = ratio**2 * congruent(slope, matched.template_covariance)
    remaining = uncancelled_noise(slope, matched.warp.shape[-1], search.degree)
    return np.asarray(
        matched.covariance + (remaining - interpolated_noise_ratio(slope, search.degree))[..., None] * noise
    )


def _selected(reference: ReferencePhotograph, selected: Mask, search: Search) -> ReferencePhotograph:
    """Selected points of a reference photograph, with exact places and warps of the search's shape."""
    shaped = with_terms(reference, TERMS[search.subset.shape_function])
    points = np.where(selected[..., None], reference.points, np.nan)
    exact = np.zeros(reference.inherited_covariance.shape)
    return cropped(shaped._replace(points=points, inherited_covariance=exact), search.subset.size)


def starts_from_previous_step(left: PointsInStep, left_before: PointsInStep, right_before: PointsInStep) -> Array:
    """Starting warps (row, col, 2, 3) for a right photograph, as if it saw the surface as at the previous step."""
    slope = product(right_before.gradient, inverse(left_before.gradient))
    moved = (slope @ (left.xy - left_before.xy)[..., None])[..., 0]
    return starting_warps(np.concatenate([left.xy[..., None], left.gradient], axis=-1), right_before.xy + moved, slope)


def starts_agree(left: Grey, right: Grey, centres: Array, starts: Array) -> bool:
    """Whether the grey levels of both photographs agree with starting warps (row, col, 2, 3) of points (row, col, 2).

    left, centres : the photograph that the warps start from, and the points in it [px]
    """
    in_grid = all_finite(centres)
    known = in_grid & all_finite(starts, 2)
    if known.sum() <= _MIN_SHARE_WITH_START * in_grid.sum():
        return False
    return window_correlation(left, right, centres[known], starts[known]) >= ACCEPTED_CORRELATION


def contrast(image: Grey, places: Array) -> float:
    """Standard deviation of the grey levels at places (..., 2) [px] in an image; 1 where it is 0 or unknown."""
    levels = _levels(image, places)
    return float(np.std(levels)) or 1.0 if len(levels) > 1 else 1.0


def overexposed_share(image: Grey, places: Array) -> float:
    """Share of places (..., 2) [px] at which an image is overexposed; NaN where all are outside the image."""
    levels = _levels(image, places)
    return float(np.mean(levels > saturation_level(image))) if len(levels) else float("nan")


def _levels(image: Grey, places: Array) -> Grey:
    """Grey levels (n,) at those of the places (..., 2) [px] that lie in an image."""
    height, width = image.shape
    x, y = np.rint(places[all_finite(places)]).astype(int).T
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return np.asarray(image[y[inside], x[inside]])


def noise_ratio(left: Grey, right: Grey, places: Array, places_right: Array) -> float:
    """Noise of the right photograph over that of the left one, in grey levels; 1 where it is unknown.

    places, places_right : (row, col, 2) — of the same points in both [px]; NaN where unknown

    The pattern adds to an estimate from a single photograph, but by much the same factor in both.
    """
    known = all_finite(places + places_right)
    views = (left, places), (right, places_right)
    levels = [image_noise(image, grid_mask(image.shape, np.where(known[..., None], at, np.nan))) for image, at in views]
    return float(np.clip(levels[1] / levels[0], 0.1, 10.0)) if min(levels) > 0.0 else 1.0


def why_lost(found: FoundPoints, points: Array, left: Grey, right: Grey, parts: Parts) -> Codes:
    """Status (row, col) of points: of lost ones, where the points around them say so, OUTSIDE or HIDDEN.

    points : (row, col, 2) — in the left photograph that the warps start from; NaN outside the region [px]
    Hidden are points in whose place the right photograph shows something else.
    """
    status, unexplained = found.status.copy(), np.isin(found.status, (*UNEXPLAINED, Status.BLURRED))
    if not unexplained.any():
        return status
    views = left.astype(np.float32), right.astype(np.float32)
    for part in part_masks(points, parts):
        lost = part & unexplained
        if not lost.any():
            continue
        motion = carried_motion(found, np.where(part[..., None], points, np.nan), points[lost])
        with np.errstate(invalid="ignore"):
            inside = ((motion[..., 0] >= 0.0) & (motion[..., 0] <= np.array(right.shape[::-1]) - 1.0)).all(axis=1)
        known = np.isfinite(motion[:, 0, 0])
        shown = np.nan_to_num(window_correlations(*views, points[lost], motion)) >= _SHOWN_CORRELATION
        why = np.where(np.isin(status[lost], _KNOWN_REASONS), status[lost], np.uint8(Status.NO_MATCH))
        why[known & ~shown] = Status.HIDDEN
        why[known & ~inside] = Status.OUTSIDE
        status[lost] = why
    return status


def grid_mask(shape: tuple[int, ...], places: Array) -> Mask:
    """Pixels of an image inside the cells of a grid of places (row, col, 2) [px]; NaN where a place is missing."""
    known = all_finite(places)
    inside = np.zeros(shape, dtype=np.uint8)
    whole = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    pixels = np.rint(np.nan_to_num(places)).astype(np.int32)
    corners = np.stack([pixels[:-1, :-1], pixels[:-1, 1:], pixels[1:, 1:], pixels[1:, :-1]], axis=2)[whole]
    for cell in corners:
        cv2.fillConvexPoly(inside, cell, 1)
    return inside > 0
