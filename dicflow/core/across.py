"""Material points of the first left photograph found in a right one.

The template is that of the left camera. Points that the left camera lost sight of with the first photograph, and found
again through a reference in between, are looked for with the subsets of this reference; what its way there adds to
their errors is then common to both photographs and left to who knows both.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from dicflow.core.chain import congruent
from dicflow.core.interpolate import Spline
from dicflow.core.material import Anchor, Followed, Search, attempt, cropped, merged
from dicflow.core.noise import interpolated_noise
from dicflow.core.partners import started
from dicflow.core.seed import ACCEPTED, BLUR_PX, agreement
from dicflow.core.warp import TERMS

__all__ = ["Shares", "Step", "as_before", "borne_out", "contrast", "follow_across", "inverse", "noise_shares"]

Array = npt.NDArray[np.float64]
Grey = npt.NDArray[Any]

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


def _part(anchor: Anchor, wanted: npt.NDArray[np.bool_], search: Search) -> Anchor:
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


class Shares(NamedTuple):
    """What the noise of each photograph does to the places in the right one.

    own : (row, col, 3) — covariance by the right photograph's noise [px² there]
    template : (row, col, 3) — by the template's noise [px² of the first photograph]
    """

    own: Array
    template: Array


def noise_shares(found: Followed, strength: float, degree: int) -> Shares:
    """Share of both photographs' noise in places that were found with noise of one strength for both.

    strength : of the right photograph's noise relative to the left one's, each relative to its contrast
    degree : of the spline
    """
    alike = found.covariance / interpolated_noise(found.slope, degree)[..., None]
    return Shares(strength**2 * found.covariance, congruent(inverse(found.warp[..., 1:3]), alike))


def contrast(image: Grey, places: Array) -> float:
    """Standard deviation of the grey levels at places (..., 2) [px] in an image; 1 where there is none."""
    x, y = np.rint(places[np.isfinite(places).all(axis=-1)]).astype(int).T
    return float(np.std(image[y, x])) or 1.0 if len(x) > 1 else 1.0


def inverse(gradient: Array) -> Array:
    """Inverses of gradients (..., 2, 2); NaN where there is none."""
    (a, b), (c, d) = (np.moveaxis(gradient[..., axis, :], -1, 0) for axis in (0, 1))
    determinant = a * d - b * c
    determinant = np.where(determinant != 0.0, determinant, np.nan)
    rows = np.stack([np.stack([d, -b], axis=-1), np.stack([-c, a], axis=-1)], axis=-2)
    return np.asarray(rows / determinant[..., None, None])
