"""Points of the left photograph found again in the right one, to about a pixel: the start of stereo correlation.

Both photographs are rectified, made smaller where they are large. A partner then lies in the same row, whatever its
depth, and windows look alike, so that normalised cross-correlation along the row finds it wherever it is. What does not
stand out, or does not go with its neighbours, is dropped; the rest gives a smooth map from left to right.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from dicflow.core.arrays import Array, Image, Mask
from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.rectification import Rectification, raw_to_rectified, rectification, rectified_to_raw, rectify
from dicflow.core.matching.pairs import agreeing, local_motion

__all__ = ["FEWEST", "Partners", "find_partners", "right_of_left", "started"]


FEWEST = 12
"""Partners below which nothing is known of how the right photograph sees the surface."""

_LONGEST_PX = 1100.0
_BLUR_PX = 0.4
_SMALLEST_WINDOW = 15
_ROWS_APART = 2
_LEAST_CORRELATION = 0.45
_MARGIN = 0.15
_SQUEEZES = (1.0, 0.85, 1.18)
_ENOUGH = 0.6
_SCOUTS = 6


class Partners(NamedTuple):
    """Points in both photographs.

    left, right : (m, 2) — raw pixels
    """

    left: Array
    right: Array


class _View(NamedTuple):
    """The rectified photographs, (rows, cols) each, and where the left one reaches."""

    left: Image
    right: Image
    covered: Mask


def find_partners(
    rig: Rig, left: npt.NDArray[Any], right: npt.NDArray[Any], points: Array, window_px: float = 41.0
) -> Partners:
    """Partners of points of the left photograph.

    left, right : (rows, cols) — the photographs, grey
    points : (n, 2) — raw pixels of the left one; those with NaN are left out
    window_px : side of what is compared [px]

    Where few are found the windows are also compared squeezed and widened, as surfaces askew to the cameras look.
    Raises ValueError where the rig cannot be rectified.
    """
    points = points[np.isfinite(points).all(axis=1)]
    small, scale = _shrunk(rectification(rig))
    half = max(_SMALLEST_WINDOW, round(window_px * scale)) // 2
    places = raw_to_rectified(points, rig.left, small.rotation_left, small.matrix_left)
    strip, top = _cut(small, places[:, 1], half + _ROWS_APART)
    places[:, 1] -= top
    view = _seen(rig, strip, left, right, scale)
    found = np.full(points.shape, np.nan)
    for squeeze in _SQUEEZES:
        missing = np.isnan(found[:, 0])
        if missing.mean() <= 1.0 - _ENOUGH:
            break
        found[missing] = _searched(view, places[missing], half, squeeze)
    known = np.isfinite(found).all(axis=1)
    points = points[known]
    partners = rectified_to_raw(found[known], rig.right, strip.rotation_right, strip.matrix_right)
    kept = agreeing(points, partners)
    return Partners(points[kept], partners[kept])


def right_of_left(partners: Partners, places: Array) -> tuple[Array, Array]:
    """Where the right photograph shows what the left one shows at places (..., 2), from the partners around.

    Returns the places there (..., 2) [px] and their slopes ∂(right)/∂(left) (..., 2, 2); NaN where a place is, and
    everywhere with too few partners.
    """
    known = np.isfinite(places).all(axis=-1)
    position, slope = np.full(places.shape, np.nan), np.full((*places.shape, 2), np.nan)
    if len(partners.left) >= FEWEST and known.any():
        position[known], slope[known] = local_motion(partners.left, partners.right, places[known])
    return position, slope


def started(warp_left: Array, position: Array, slope: Array) -> Array:
    """Affine warps (..., 2, 3) from the reference into the right photograph: first into the left one, then across.

    warp_left : (..., 2, 3 or 6) — from the reference into the left photograph
    position, slope : (..., 2), (..., 2, 2) — of :func:`right_of_left` at the places of its centres
    """
    return np.concatenate([position[..., None], slope @ warp_left[..., 1:3]], axis=-1)


def _shrunk(full: Rectification) -> tuple[Rectification, float]:
    """Rectified cameras with images that are small enough, and their scale."""
    scale = min(1.0, _LONGEST_PX / max(full.size))
    width, height = full.size
    return _carried(full, np.diag([scale, scale, 1.0]), (round(scale * width), round(scale * height))), scale


def _cut(small: Rectification, y: Array, reach: int) -> tuple[Rectification, int]:
    """The same with only the rows that windows at heights y (n,) need, at least one; and the first of them."""
    width, height = small.size
    known = y[np.isfinite(y)]
    low, high = (known.min(), known.max()) if len(known) else (0.0, 0.0)
    first = int(np.clip(np.floor(low) - reach, 0, height - 1))
    last = int(np.clip(np.ceil(high) + reach + 1, first + 1, height))
    upward = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -first], [0.0, 0.0, 1.0]])
    return _carried(small, upward, (width, last - first)), first


def _carried(rectified: Rectification, change: Array, size: tuple[int, int]) -> Rectification:
    """Rectified cameras whose images are carried on by a change of pixels (3, 3)."""
    return rectified._replace(
        matrix_left=change @ rectified.matrix_left, matrix_right=change @ rectified.matrix_right, size=size
    )


def _seen(rig: Rig, strip: Rectification, left: npt.NDArray[Any], right: npt.NDArray[Any], scale: float) -> _View:
    """Both photographs rectified, without detail that is finer than the pixels there."""

    def smooth(image: npt.NDArray[Any]) -> npt.NDArray[Any]:
        grey = image.astype(np.float32)
        return np.asarray(cv2.GaussianBlur(grey, (0, 0), _BLUR_PX / scale) if scale < 1.0 else grey)

    views = (
        rectify(smooth(left), rig.left, strip.rotation_left, strip.matrix_left, strip.size),
        rectify(smooth(right), rig.right, strip.rotation_right, strip.matrix_right, strip.size),
    )
    whole = np.full(left.shape, 255, dtype=np.uint8)
    return _View(*views, rectify(whole, rig.left, strip.rotation_left, strip.matrix_left, strip.size) > 127)


def _searched(view: _View, places: Array, half: int, squeeze: float) -> Array:
    """Partners (n, 2) of places: of a few in the whole row, and of the others where these and what they span say."""
    found, width = np.full(places.shape, np.nan), view.left.shape[1]
    scouts = np.zeros(len(places), dtype=bool)
    scouts[::_SCOUTS] = True
    found[scouts] = [_partner(view, place, half, squeeze, (-width, width)) for place in places[scouts]]
    offsets = np.sort((found - places)[np.isfinite(found[:, 0]), 0])
    limits = (-width, width)
    if len(offsets) >= FEWEST:
        low, high = offsets[len(offsets) // 10], offsets[-1 - len(offsets) // 10]
        spare = 4.0 * half + high - low
        limits = int(low - spare), int(high + spare)
    found[~scouts] = [_partner(view, place, half, squeeze, limits) for place in places[~scouts]]
    return found


def _partner(view: _View, place: Array, half: int, squeeze: float, limits: tuple[int, int]) -> tuple[float, float]:
    """Where the right image fits best in the rows of a place of the left one; NaN where nothing stands out.

    limits : least and greatest x in the right image less x in the left one
    """
    nothing = (np.nan, np.nan)
    if not np.isfinite(place).all():
        return nothing
    x, y = np.rint(place).astype(int)
    wide, high = round(half / squeeze), half + _ROWS_APART
    rows, cols = view.left.shape
    if not (wide <= x < cols - wide and high <= y < rows - high):
        return nothing
    around = slice(y - half, y + half + 1), slice(x - wide, x + wide + 1)
    first, last = max(0, x + limits[0] - half), min(cols, x + limits[1] + half + 1)
    side = 2 * half + 1
    if not view.covered[around].all() or last - first < side:
        return nothing
    window = view.left[around]
    template = window if wide == half else cv2.resize(window, (side, side), interpolation=cv2.INTER_AREA)
    fit = cv2.matchTemplate(view.right[y - high : y + high + 1, first:last], template, cv2.TM_CCOEFF_NORMED)
    fit[~(np.abs(fit) <= 1.0)] = -1.0  # where the image shows nothing at all
    row, col = np.unravel_index(fit.argmax(), fit.shape)
    best = fit[row, col]
    fit[:, max(0, col - half) : col + half + 1] = -1.0
    if best < _LEAST_CORRELATION or best < fit.max() + _MARGIN:
        return nothing
    offset = place - (x, y)
    return float(first + col + half + offset[0]), float(row - _ROWS_APART + y + offset[1])
