"""Material points of the first left photograph found in a right one.

The template is that of the left camera. Points that the left camera lost sight of with the first photograph, and found
again through a reference in between, are looked for with the subsets of this reference; what its way there adds to
their errors is then common to both photographs and left to who knows both.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from dicflow.core.arrays import Array, Grey, Mask
from dicflow.core.correlation.chain import uncancelled_noise
from dicflow.core.correlation.material import Anchor, Followed, Search, attempt, cropped, merged
from dicflow.core.correlation.partners import started
from dicflow.core.correlation.seed import ACCEPTED, BLUR_PX, agreement
from dicflow.core.correlation.warp import TERMS
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.photographs.noise import image_noise, interpolated_noise
from dicflow.core.photographs.texture import saturation
from dicflow.core.tensors import congruent, inverse

__all__ = [
    "Step",
    "as_before",
    "borne_out",
    "contrast",
    "enclosed",
    "follow_across",
    "noise_ratio",
    "overexposed",
    "passed_on",
]


_SOME = 0.5
"""Share of the points that must have a start."""
THROUGH = 2
"""Way of a point that was found through a reference in between."""


class Step(NamedTuple):
    """What the left photograph of a step, and perhaps the right one, say of the material points on a grid (row, col).

    xy : (..., 2) [px]; gradient : (..., 2, 2) — from the first left photograph
    """

    xy: Array
    gradient: Array


def follow_across(
    first: Anchor, reference: Anchor | None, way: npt.NDArray[np.uint8], target: Spline, starts: Array, search: Search
) -> Followed:
    """Find material points in a right photograph.

    first, reference : the left photographs that points are found from
    way : (row, col) — by which each point was found in the left photograph of the step
    starts : (row, col, 2, 3) — warps from the first left photograph; NaN where nothing is known
    Returns the points; their covariance is that of the right photograph's noise alone. A point whose reference is no
    longer known, since a later one has been taken, is looked for with the first photograph.
    """
    if reference is None:
        return attempt(_part(first, np.ones_like(way, dtype=bool), search), target, starts, search)
    through = (way == THROUGH) & np.isfinite(reference.points).all(axis=-1)
    found = attempt(_part(first, ~through, search), target, starts, search)
    chained = attempt(_part(reference, through, search), target, starts, search)
    return merged(found, chained._replace(way=np.where(chained.valid, np.uint8(THROUGH), chained.way)))


def passed_on(matched: Followed, search: Search) -> Array:
    """Covariance (row, col, 3) that matched points pass on to places found with subsets of the right photograph [px²].

    matched, search : of :func:`follow_across` from the first left photograph, on the grid (row, col)

    The noise of the right photograph, which led to a point, leads away from it again with the point's own subset, and
    little of it remains (:func:`dicflow.core.correlation.chain.uncancelled_noise`). What the two cameras see
    differently remains.
    """
    slope = matched.slope
    noise = search.strength**2 * congruent(slope, matched.template)
    remains = uncancelled_noise(slope, matched.warp.shape[-1], search.degree)
    return np.asarray(matched.covariance + (remains - interpolated_noise(slope, search.degree))[..., None] * noise)


def _part(anchor: Anchor, wanted: Mask, search: Search) -> Anchor:
    """The wanted points of an anchor, as if their places in it were exact, with warps as the search has them."""
    terms = TERMS[search.subset.shape_function]
    warp = np.zeros((*anchor.warp.shape[:-1], terms))
    shared = min(terms, anchor.warp.shape[-1])
    warp[..., :shared] = anchor.warp[..., :shared]
    points = np.where(wanted[..., None], anchor.points, np.nan)
    exact = np.zeros(anchor.passed.shape)
    return cropped(anchor._replace(points=points, warp=warp, passed=exact), search.subset.size)


def as_before(left: Step, left_before: Step, right_before: Step) -> Array:
    """Starting warps (row, col, 2, 3) for a right photograph that sees the surface as it did at the step before."""
    slope = right_before.gradient @ inverse(left_before.gradient)
    moved = (slope @ (left.xy - left_before.xy)[..., None])[..., 0]
    return started(np.concatenate([left.xy[..., None], left.gradient], axis=-1), right_before.xy + moved, slope)


def borne_out(left: Grey, right: Grey, centres: Array, starts: Array) -> bool:
    """Whether the photographs look alike where starting warps (row, col, 2, 3) put points (row, col, 2) [px]."""
    wanted = np.isfinite(centres).all(axis=-1)
    known = wanted & np.isfinite(starts).all(axis=(-2, -1))
    smooth, other = (cv2.GaussianBlur(image.astype(np.float32), (0, 0), BLUR_PX) for image in (left, right))
    some = known.sum() > _SOME * wanted.sum()
    return bool(some and agreement(smooth, other, centres[known], starts[known]) >= ACCEPTED)


def contrast(image: Grey, places: Array) -> float:
    """Standard deviation of the grey levels at places (..., 2) [px] in an image; 1 where there is none."""
    levels = _levels(image, places)
    return float(np.std(levels)) or 1.0 if len(levels) > 1 else 1.0


def overexposed(image: Grey, places: Array) -> float:
    """Share of places (..., 2) [px] at which an image is as bright as it can be; NaN where it shows none of them."""
    levels = _levels(image, places)
    return float(np.mean(levels > saturation(image))) if len(levels) else float("nan")


def _levels(image: Grey, places: Array) -> Grey:
    """Grey levels (n,) at the places (..., 2) that lie in an image [px]."""
    height, width = image.shape
    x, y = np.rint(places[np.isfinite(places).all(axis=-1)]).astype(int).T
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return np.asarray(image[y[inside], x[inside]])


def noise_ratio(left: Grey, right: Grey, places: Array, places_right: Array) -> float:
    """Noise of the right photograph over that of the left one, in grey levels; 1 where it cannot be told.

    places, places_right : (row, col, 2) — of the same points in both [px]; NaN where unknown

    What the pattern adds to an estimate from one photograph is much the same in both.
    """
    known = np.asarray(np.isfinite(places + places_right).all(axis=-1))
    views = (left, places), (right, places_right)
    levels = [image_noise(image, enclosed(image.shape, np.where(known[..., None], at, np.nan))) for image, at in views]
    return float(np.clip(levels[1] / levels[0], 0.1, 10.0)) if min(levels) > 0.0 else 1.0


def enclosed(shape: tuple[int, ...], places: Array) -> Mask:
    """The part of an image that neighbouring points of a grid (row, col, 2) enclose [px]; NaN where there is none."""
    known = np.asarray(np.isfinite(places).all(axis=-1))
    inside = np.zeros(shape, dtype=np.uint8)
    whole = known[:-1, :-1] & known[1:, :-1] & known[:-1, 1:] & known[1:, 1:]
    pixels = np.rint(np.nan_to_num(places)).astype(np.int32)
    corners = np.stack([pixels[:-1, :-1], pixels[:-1, 1:], pixels[1:, 1:], pixels[1:, :-1]], axis=2)[whole]
    for cell in corners:
        cv2.fillConvexPoly(inside, cell, 1)
    return inside > 0
