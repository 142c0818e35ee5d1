"""Material points followed through a series of photographs.

Every point is looked for with its subset of the first photograph, so that errors do not add up. Where the pattern has
changed too much for that, it is looked for with a subset of a photograph in between, the reference, and the two
motions are chained; the chained warp is then the start of one more attempt from the first photograph.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from dicflow.core.arrays import Array, Grey, Image, Mask
from dicflow.core.correlation.chain import chained, uncancelled_noise
from dicflow.core.correlation.follow import Field, correlate_field
from dicflow.core.correlation.misfit import misfit_covariance
from dicflow.core.correlation.seed import Pairs, seed_warps
from dicflow.core.correlation.subsets import Subset, Template, template
from dicflow.core.correlation.warp import gradient, identity, warp_from_gradient
from dicflow.core.matching.pairs import local_motion
from dicflow.core.photographs.footprint import blurred, missing_blurs
from dicflow.core.photographs.interpolate import Spline, spline
from dicflow.core.photographs.noise import interpolated_noise
from dicflow.core.status import Status
from dicflow.core.tensors import congruent, inverse

__all__ = [
    "Anchor",
    "Followed",
    "Search",
    "Updating",
    "at_rest",
    "attempt",
    "carried_by",
    "cropped",
    "first_anchor",
    "follow_step",
    "merged",
    "prepared",
]


MARGIN_PX = 24  # around what is used of a photograph: farther pixels do not change the spline any more
FEW = 3  # points below which nothing can be said about the others


class Search(NamedTuple):
    """How subsets are looked for.

    subset : of every attempt
    degree : of the splines, 3 or 5
    smoothing_px : standard deviation of a Gaussian that all photographs pass first; 0 for none
    max_znssd : what fits worse is no match
    noise : standard deviation of the noise of the templates' photographs [grey levels]
    strength : the target's noise over it, each relative to its contrast
    threads : how many share the points
    counts_misfit : what subsets differ by beyond the noise adds to the covariance
    """

    subset: Subset
    degree: int = 5
    smoothing_px: float = 0.0
    max_znssd: float = 0.3
    noise: float = 1.0
    strength: float = 1.0
    threads: int = 1
    counts_misfit: bool = False


class Updating(NamedTuple):
    """When a new reference is taken.

    enabled : False keeps to the first photograph
    lost : share of the points, lost since the step before, above which the first photograph does not do
    znssd : median against the reference above which it is given up for the step before
    every : steps after which it is given up in any case; 0 for never
    """

    enabled: bool = True
    lost: float = 0.002
    znssd: float = 0.1
    every: int = 0


class Anchor(NamedTuple):
    """A photograph in which the places of material points are known, to follow them from.

    image : (h, w) grey; part of the photograph
    origin : (x, y) of its first pixel [px]
    usable : (h, w) bool — the region there
    points : (rows, cols, 2) — places of the points in the photograph [px]; NaN where unknown
    warp : (rows, cols, 2, m) — from the first photograph
    passed : (rows, cols, 3) — covariance of the places by photographs before this one, except the first [px²]
    slope : (rows, cols, 2, 2) — gradient of the motion from the photograph in whose subsets the points were found here
    age : for how many steps it has been the reference
    """

    image: Grey
    origin: tuple[int, int]
    usable: Mask
    points: Array
    warp: Array
    passed: Array
    slope: Array
    age: int = 0


class Followed(NamedTuple):
    """Material points in one photograph, on the grid (rows, cols).

    warp : (..., 2, m) — from the first photograph; NaN where there is no value
    znssd, iterations, status : of the subset that found the point
    covariance : (..., 3) — of the places, without the first photograph's noise [px²]
    way : uint8 — 0 the first photograph itself, or no value; 1 directly from it; 2 through a reference
    template : (..., 3) — of the places by the noise of the template [px² of the first photograph]
    passed : (..., 3) — the share of references in ``covariance`` [px²]
    slope : (..., 2, 2) — gradient of the motion from the photograph whose subset found the point
    """

    warp: Array
    znssd: Array
    iterations: npt.NDArray[np.int16]
    status: npt.NDArray[np.uint8]
    covariance: Array
    way: npt.NDArray[np.uint8]
    template: Array
    passed: Array
    slope: Array

    @property
    def valid(self) -> Mask:
        """Which points have a value."""
        return np.asarray(self.status == Status.VALID, dtype=np.bool_)


def first_anchor(image: Grey, usable: Mask, grid: Array, search: Search) -> Anchor:
    """The first photograph.

    grid : (rows, cols, 2) — whole pixels; NaN outside the region
    """
    warp = identity(grid, search.subset.shape_function)  # type: ignore[arg-type]
    exact = np.zeros((*grid.shape[:2], 3))
    return cropped(Anchor(image, (0, 0), usable, grid, warp, exact, gradient(warp)), search.subset.size)


def cropped(anchor: Anchor, subset_size: int) -> Anchor:
    """The anchor with no more of its photograph than its subsets need."""
    known = anchor.points[np.isfinite(anchor.points).all(axis=-1)] - anchor.origin
    if len(known) == 0:
        return anchor
    reach = subset_size // 2 + 1 + MARGIN_PX
    x0, y0 = np.maximum(np.floor(known.min(axis=0)).astype(int) - reach, 0).tolist()
    x1, y1 = (np.ceil(known.max(axis=0)).astype(int) + reach + 1).tolist()
    part = slice(y0, y1), slice(x0, x1)
    origin = anchor.origin[0] + x0, anchor.origin[1] + y0
    return anchor._replace(image=anchor.image[part], usable=anchor.usable[part], origin=origin)


def at_rest(first: Anchor, search: Search) -> Followed:
    """The points in the first photograph itself.

    The covariance is that of its own noise there, which all later places have in common; NaN where there is no value.
    """
    itself = prepared(first.image, search)
    both = template(itself, first.usable), itself
    found = _from_anchor(first, both, first.warp[..., :3], search, first.origin)
    way = np.zeros(found.status.shape, dtype=np.uint8)
    warp = np.where((found.status == Status.VALID)[..., None, None], first.warp, np.nan)
    covariance = 0.5 * search.noise**2 * found.covariance
    facts = found.znssd, found.iterations, found.status
    return Followed(warp, *facts, covariance, way, covariance, 0.0 * covariance, warp[..., 1:3])


def follow_step(
    first: Anchor,
    reference: Anchor | None,
    before: Anchor,
    image: Grey,
    search: Search,
    updating: Updating,
    matches: Pairs | None = None,
    expected: Array | None = None,
) -> tuple[Followed, Anchor | None]:
    """Find the points in the next photograph.

    reference : a photograph in between that points were followed from; None where the first one did
    before : the step before
    matches : features of the step before and of this one
    expected : (rows, cols, 2) — where points should be by their last known places and motions [px]
    Returns the points, and the reference to go on with.
    """
    target = prepared(image, search)
    starts = _starts([anchor for anchor in (before, reference, first) if anchor is not None], image, matches)
    found = _told_apart(attempt(first, target, starts, search), first, image.shape, expected)
    if updating.enabled:
        reference = None if reference is None else reference._replace(age=reference.age + 1)
        if updating.every and (reference is None or reference.age >= updating.every):
            reference = before
        if _is_lost(found, before, updating):
            found, reference = _through_reference(first, reference, before, target, starts, found, search, updating)
        elif not updating.every:
            reference = None
    return _told_apart(found, first, image.shape, expected), reference


def carried_by(followed: Followed, grid: Array, points: Array) -> Array:
    """Where points (n, 2) of the first photograph are, by the motion of the material points around them [px].

    grid : (rows, cols, 2) — the material points there
    """
    valid = followed.valid
    if valid.sum() < FEW:
        return np.full(points.shape, np.nan)
    return local_motion(grid[valid], followed.warp[valid][..., 0], points).position


def prepared(image: Grey, search: Search) -> Spline:
    """A photograph, ready to be searched."""
    return spline(_smoothed(image, search), search.degree)


def _smoothed(image: Grey, search: Search) -> Image:
    grey = image.astype(np.float32)
    if search.smoothing_px > 0.0:
        grey = np.asarray(cv2.GaussianBlur(grey, (0, 0), search.smoothing_px), dtype=np.float32)
    return grey


def _starts(anchors: Sequence[Anchor], image: Grey, matches: Pairs | None) -> Array:
    """Affine warps (rows, cols, 2, 3) from the first photograph, by the first anchor that tells any."""
    starts = np.full((*anchors[0].points.shape, 3), np.nan)
    for number, anchor in enumerate(anchors):
        if np.isfinite(anchor.points).all(axis=-1).sum() < FEW:
            continue
        local = None if matches is None or number else Pairs(matches.source - anchor.origin, matches.target)
        motion = seed_warps(anchor.image, image, anchor.points - anchor.origin, local)
        starts = chained(anchor.warp[..., :3], motion, anchor.points)
        if np.isfinite(starts[..., 0, 0]).any():
            break
    return starts


def _alike(anchor: Anchor, target: Spline, starts: Array, search: Search) -> tuple[Template, Spline]:
    """The anchor's photograph and the target, with pixels that blur the material alike on the whole."""
    image, slopes = _smoothed(anchor.image, search), _from_there(anchor, starts)
    slopes = slopes[np.isfinite(slopes).all(axis=(-2, -1))]
    if len(slopes):
        blurs = missing_blurs(np.median(slopes, axis=0), search.smoothing_px)
        image = blurred(image, blurs.template)
        target = target if blurs.target is None else spline(blurred(target.image, blurs.target), search.degree)
    return template(spline(image, search.degree), anchor.usable), target


def _from_there(anchor: Anchor, starts: Array) -> Array:
    """Gradients (rows, cols, 2, 2) of the motion from an anchor."""
    return starts[..., 1:3] @ np.linalg.inv(np.where(np.isnan(anchor.warp[..., 1:3]), np.eye(2), anchor.warp[..., 1:3]))


def _from_anchor(
    anchor: Anchor, both: tuple[Template, Spline], starts: Array, search: Search, shift: Sequence[int] = (0, 0)
) -> Field:
    """Correlate the subsets of an anchor.

    both : its photograph as a template, and the target
    starts : (rows, cols, 2, 3) — from the first photograph to the target
    shift : (x, y) of the target's first pixel in the coordinates of ``starts`` [px]
    The field's warps are those of the anchor's subsets, around the whole pixels next to its points.
    """
    slope = _from_there(anchor, starts)
    centres = np.rint(anchor.points)
    place = starts[..., 0] + np.einsum("...ij,...j->...i", slope, centres - anchor.points) - shift
    return correlate_field(
        *both,
        centres - anchor.origin,
        warp_from_gradient(place, slope),
        search.subset,
        max_znssd=search.max_znssd,
        threads=search.threads,
    )


def attempt(anchor: Anchor, target: Spline, starts: Array, search: Search, way: int = 1) -> Followed:
    """Find the points of an anchor in the target; ``way`` 2 counts the noise of the anchor's photograph too."""
    both, centres = _alike(anchor, target, starts, search), np.rint(anchor.points)
    field = _from_anchor(anchor, both, starts, search)
    noise = 0.5 * search.noise**2 * field.covariance
    slope = gradient(field.warp, anchor.points - centres)
    passed = congruent(slope, anchor.passed)
    if way > 1:
        left = uncancelled_noise(anchor.slope, field.warp.shape[-1], search.degree)
        passed = passed + left[..., None] * noise
    strength = search.strength**2 * interpolated_noise(slope, search.degree)
    covariance = passed + strength[..., None] * noise
    if search.counts_misfit:
        unit, level = 0.5 * congruent(inverse(slope), field.covariance), search.noise**2 * (1.0 + strength)
        more = misfit_covariance(*both, centres - anchor.origin, field.warp, search.subset, unit, level)
        covariance = covariance + congruent(slope, more)
    warp = chained(anchor.warp, field.warp, centres)
    ways = np.where(field.status == Status.VALID, way, 0).astype(np.uint8)
    share = congruent(inverse(warp[..., 1:3]), noise)
    return Followed(warp, field.znssd, field.iterations, field.status, covariance, ways, share, passed, slope)


def _lost(found: Followed, before: Anchor) -> Mask:
    """Points that the step before had and this one has not, though they are in the frame."""
    known = np.isfinite(before.points).all(axis=-1)
    return np.asarray(known & ~found.valid & (found.status != Status.OUTSIDE), dtype=np.bool_)


def _is_lost(found: Followed, before: Anchor, updating: Updating) -> bool:
    """Whether too many points are."""
    known = np.isfinite(before.points).all(axis=-1).sum()
    return bool(_lost(found, before).sum() > updating.lost * known)


def _through_reference(
    first: Anchor,
    reference: Anchor | None,
    before: Anchor,
    target: Spline,
    starts: Array,
    found: Followed,
    search: Search,
    updating: Updating,
) -> tuple[Followed, Anchor | None]:
    """Find lost points through the reference, or through the step before, which then is the next reference."""
    for anchor in (reference, before):
        if anchor is None:
            continue
        lost = ~found.valid
        found = _chained(first, anchor, target, starts, found, search)
        reference = anchor
        gained = lost & found.valid & (found.way == 2)
        fits = not gained.any() or float(np.median(found.znssd[gained])) <= updating.znssd
        if fits and not _is_lost(found, before, updating):
            break
    return found, reference


def _chained(first: Anchor, anchor: Anchor, target: Spline, starts: Array, found: Followed, search: Search) -> Followed:
    """Find points without value through an anchor, then once more directly from the first photograph."""
    missing = ~found.valid[..., None]
    part = cropped(anchor._replace(points=np.where(missing, anchor.points, np.nan)), search.subset.size)
    through = attempt(part, target, starts, search, way=2)
    again = cropped(first._replace(points=np.where(through.valid[..., None], first.points, np.nan)), search.subset.size)
    direct = attempt(again, target, through.warp[..., :3], search)
    return merged(merged(found, through), direct)


def merged(found: Followed, better: Followed) -> Followed:
    """The points of one attempt, and where another has a value, that one."""
    pairs: Iterable[tuple[Any, Any]] = zip(found, better, strict=True)
    return Followed._make(np.where(_over(better.valid, new), new, old) for old, new in pairs)


def _over(mask: Mask, values: npt.NDArray[Any]) -> Mask:
    """The mask with as many axes as the values."""
    return mask.reshape(mask.shape + (1,) * (values.ndim - mask.ndim))


def _told_apart(found: Followed, first: Anchor, shape: tuple[int, ...], expected: Array | None) -> Followed:
    """Lost points outside the frame are told from those that do not fit: by their neighbours, or as expected."""
    lost = ~found.valid & np.isfinite(first.points).all(axis=-1) & (found.status != Status.CUT_SUBSET)
    place = carried_by(found, first.points, first.points[lost])
    if expected is not None:
        place = np.where(np.isfinite(place), place, expected[lost])
    with np.errstate(invalid="ignore"):
        outside = ((place < 0.0) | (place > np.array(shape[::-1]) - 1.0)).any(axis=-1)
    status = found.status.copy()
    status[lost] = np.where(outside, np.uint8(Status.OUTSIDE), status[lost])
    return found._replace(status=status)
