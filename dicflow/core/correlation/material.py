"""Material points followed through a series of photographs.

Every point is searched for with its subset of the first photograph, so that errors do not add up. Where the pattern has
changed too much for that, it is searched for with a subset of a reference step, and the two motions are chained; the
chained warp is then the start of one more search with the first photograph.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array, Grey, Mask, all_finite
from dicflow.core.correlation.chain import chained
from dicflow.core.correlation.edges import AT_EDGES, usual_residual
from dicflow.core.correlation.judgement import find_points, judge
from dicflow.core.correlation.points import (
    MIN_POINTS_FOR_MOTION,
    VIA_REFERENCE_STEP,
    FoundPoints,
    ReferencePhotograph,
    carried_points,
    cropped,
    merged,
    part_masks,
    with_terms,
)
from dicflow.core.correlation.search import (
    CorrelatedField,
    Search,
    correlate_again,
    correlate_points,
    own_subsets,
    target_spline,
)
from dicflow.core.correlation.seed import Pairs, seed_warps
from dicflow.core.parts import Parts
from dicflow.core.photographs.exposure import Photograph
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.status import Status
from dicflow.core.threads import at_once

__all__ = ["DirectSearch", "Updating", "follow_step", "search_again", "search_directly"]


class Updating(NamedTuple):
    """When a reference step is taken, or replaced by a later one.

    enabled : False keeps to the first photograph
    max_lost_share : of the points, lost since the previous step; above it a reference step is taken
    max_znssd : median against the reference step; above it the previous step replaces it
    every_steps : steps after which the previous step replaces it in any case; 0 for never
    """

    enabled: bool = True
    max_lost_share: float = 0.002
    max_znssd: float = 0.1
    every_steps: int = 0


class DirectSearch(NamedTuple):
    """The next photograph, searched for the points with their subsets of the first one.

    previous : the photograph in which the motion begins
    target : the next photograph
    starts : (rows, cols, 2, 3) — warps from the first photograph that the search began with
    correlation : of the subsets of the first photograph
    """

    previous: ReferencePhotograph
    target: Spline
    starts: Array
    correlation: CorrelatedField


def search_directly(
    first: ReferencePhotograph,
    reference_step: ReferencePhotograph | None,
    previous: ReferencePhotograph,
    image: Photograph,
    search: Search,
    matches: Pairs | None = None,
) -> DirectSearch:
    """Search the next photograph for the points with their subsets of the first one; the noise has no part in it.

    reference_step : None while the first photograph does
    previous : the previous step; if no points were found there, the reference step or the first one takes its place
    matches : features matched from the previous step to this one
    """
    references = [photograph for photograph in (previous, reference_step, first) if photograph is not None]
    previous = next((photograph for photograph in references if _shows_motion(photograph)), previous)
    with_target = partial(target_spline, image, search)
    with_starts = partial(_starting_warps, references, image.grey, matches, search)
    starts, target, own = at_once(search.threads, with_starts, with_target, partial(own_subsets, first, search))
    return DirectSearch(previous, target, starts, correlate_points(first, target, starts, search, own))


def search_again(first: ReferencePhotograph, direct: DirectSearch, found: FoundPoints, search: Search) -> DirectSearch:
    """The same photograph, searched from where the points were found, with another shape function."""
    starts = np.where(np.isfinite(found.warp[..., :3]), found.warp[..., :3], direct.starts)
    return direct._replace(starts=starts, correlation=correlate_again(first, direct.correlation, starts, search))


def follow_step(
    first: ReferencePhotograph,
    reference_step: ReferencePhotograph | None,
    direct: DirectSearch,
    search: Search,
    updating: Updating,
    expected: Array | None = None,
) -> tuple[FoundPoints, ReferencePhotograph | None]:
    """The points in the next photograph.

    reference_step : None while the first photograph does
    direct : result of :func:`search_directly`
    expected : (rows, cols, 2) — where points should be by their last known places and motions [px]
    Returns the points, and the reference step for the photograph after the next.
    """
    previous = direct.previous
    classified = partial(_classify_lost, first=first, direct=direct, expected=expected, parts=search.parts)
    found = classified(judge(first, direct.correlation, search))
    if updating.enabled:
        reference_step = None if reference_step is None else reference_step._replace(age=reference_step.age + 1)
        if updating.every_steps and (reference_step is None or reference_step.age >= updating.every_steps):
            reference_step = previous
        if _too_many_lost(found, previous, updating):
            candidates = [step for step in (reference_step, previous) if step is not None]
            found, reference_step = _find_via_reference_step(first, candidates, direct, found, search, updating)
            found = classified(found)
        elif not updating.every_steps:
            reference_step = None
    return found, reference_step


def _starting_warps(
    references: Sequence[ReferencePhotograph], image: Grey, matches: Pairs | None, search: Search
) -> Array:
    """Affine warps (rows, cols, 2, 3) from the first photograph, by the first reference photograph that gives any.

    matches : features matched from the first of ``references``
    """
    starts = np.full((*references[0].points.shape, 3), np.nan)
    for number, reference in enumerate(references):
        if not _shows_motion(reference):
            continue
        in_crop = None if matches is None or number else Pairs(matches.source - reference.origin, matches.target)
        places = reference.points - reference.origin
        views, settings = (reference.image.grey, image), (search.parts, search.reach_px)
        motion = seed_warps(*views, places, in_crop, *settings, reference.origin, search.threads)
        starts = chained(reference.warp[..., :3], motion, reference.points).warp
        if np.isfinite(starts[..., 0, 0]).any():
            break
    return starts


def _shows_motion(photograph: ReferencePhotograph) -> bool:
    """Whether enough points were found in a photograph to follow the motion from there."""
    return bool(all_finite(photograph.points).sum() >= MIN_POINTS_FOR_MOTION)


def _lost_points(found: FoundPoints, previous: ReferencePhotograph) -> Mask:
    """Points that have a value at the previous step, and may be found at this one with another reference photograph."""
    known = all_finite(previous.points)
    return np.asarray(known & ~found.valid & ~np.isin(found.status, (Status.OUTSIDE, *AT_EDGES)), dtype=np.bool_)


def _too_many_lost(found: FoundPoints, previous: ReferencePhotograph, updating: Updating) -> bool:
    known = all_finite(previous.points).sum()
    return bool(_lost_points(found, previous).sum() > updating.max_lost_share * known)


def _find_via_reference_step(
    first: ReferencePhotograph,
    candidates: Sequence[ReferencePhotograph],
    direct: DirectSearch,
    found: FoundPoints,
    search: Search,
    updating: Updating,
) -> tuple[FoundPoints, ReferencePhotograph]:
    """Find lost points with the candidates in turn until enough are found and fit well.

    Returns all points, and the last candidate used.
    """
    for candidate in candidates:
        lost = ~found.valid
        found = _find_lost(first, candidate, direct, found, search)
        gained = lost & found.valid & (found.route == VIA_REFERENCE_STEP)
        fits = not gained.any() or float(np.median(found.znssd[gained])) <= updating.max_znssd
        if fits and not _too_many_lost(found, direct.previous, updating):
            break
    return found, candidate


def _find_lost(
    first: ReferencePhotograph,
    reference_step: ReferencePhotograph,
    direct: DirectSearch,
    found: FoundPoints,
    search: Search,
) -> FoundPoints:
    """Find points without a value with a reference step, then from there once more with the first photograph.

    Those with two motions in their subset stay lost: the errors of small steps would add up.
    """
    size, missing = search.subset.size, ~(found.valid | np.isin(found.status, AT_EDGES))[..., None]
    usual = usual_residual(found.residual)
    reference_step = with_terms(reference_step, found.warp.shape[-1])
    part = cropped(reference_step._replace(points=np.where(missing, reference_step.points, np.nan)), size)
    through = find_points(part, direct.target, direct.starts, search, VIA_REFERENCE_STEP, usual)
    again = cropped(first._replace(points=np.where(through.valid[..., None], first.points, np.nan)), size)
    once_more = find_points(again, direct.target, through.warp[..., :3], search, usual=usual)
    return merged(merged(found, through), once_more)


def _classify_lost(
    found: FoundPoints, first: ReferencePhotograph, direct: DirectSearch, expected: Array | None, parts: Parts | None
) -> FoundPoints:
    """The points, with the status OUTSIDE for lost ones that have left the frame.

    Their places follow from the points around them, or else are those ``expected``.
    """
    lost = ~found.valid & all_finite(first.points) & (found.status != Status.CUT_SUBSET)
    if not lost.any():
        return found
    place = np.full((int(lost.sum()), 2), np.nan)
    for part in part_masks(first.points, parts):
        here = part[lost]
        place[here] = carried_points(found, np.where(part[..., None], first.points, np.nan), first.points[lost & part])
    if expected is not None:
        place = np.where(np.isfinite(place), place, expected[lost])
    with np.errstate(invalid="ignore"):
        outside = ((place < 0.0) | (place > np.array(direct.target.image.shape[::-1]) - 1.0)).any(axis=-1)
    status = found.status.copy()
    status[lost] = np.where(outside, np.uint8(Status.OUTSIDE), status[lost])
    return found._replace(status=status)
