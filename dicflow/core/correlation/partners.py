"""Points of the left photograph found in the right one, to about a pixel: the start of stereo correlation.

Both photographs are rectified, and reduced where they are large. A partner then lies in the same row at any depth, and
windows look alike, so that normalised cross-correlation along the row finds it. Ambiguous partners, and those that
disagree with their neighbours, are dropped; the rest gives a smooth map from left to right.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Grey, Image, Mask, all_finite
from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.rectification import (
    Rectification,
    covered,
    raw_to_rectified,
    rectification,
    rectified_to_raw,
    rectify,
)
from dicflow.core.matching.pairs import agreeing_matches, local_motion
from dicflow.core.tensors import product

__all__ = ["MIN_PARTNERS", "Partners", "find_partners", "right_of_left", "starting_warps"]


MIN_PARTNERS = 12
"""With fewer partners, the map from left to right is unknown."""

_MAX_IMAGE_SIDE_PX = 1100.0
"""Larger photographs are reduced."""
_REDUCTION_BLUR_PX = 0.4
"""Standard deviation of the smoothing before a reduction [px of the reduced image]."""
_MIN_WINDOW_PX = 15
_MAX_ROW_DIFFERENCE = 2
"""Rows by which a partner may lie above or below its epipolar line [px]."""
_MIN_CORRELATION = 0.45
_MIN_CORRELATION_LEAD = 0.15
"""Lead of a partner's correlation over that of the next best place; with less it is ambiguous."""
_SUFFICIENT_SHARE = 0.6
"""Share of points with a partner at which no further look is tried."""
_SCOUT_STRIDE = 6
"""Every so many points are searched for in the whole row, the others at depths between theirs."""


class _Look(NamedTuple):
    """How a window of the left image looks in the right one.

    width : over that in the left image, of surfaces turned about the vertical
    shear : columns per row, of surfaces turned about the horizontal
    """

    width: float = 1.0
    shear: float = 0.0


_LOOKS = (*(_Look(width) for width in (1.0, 0.85, 1.18)), *(_Look(shear=shear) for shear in (0.25, -0.25, 0.5, -0.5)))
_LOOKS += (_Look(0.7), _Look(1.4))
"""Looks that are tried in turn while too few points have a partner."""


class Partners(NamedTuple):
    """Places of the same points in both photographs.

    left, right : (m, 2) — raw pixels
    """

    left: Array
    right: Array


class _View(NamedTuple):
    """The rectified photographs, (rows, cols) each, and which pixels the left one covers."""

    left: Image
    right: Image
    covered: Mask


def find_partners(rig: Rig, left: Grey, right: Grey, points: Array, window_px: float = 41.0) -> Partners:
    """Partners of points of the left photograph.

    left, right : (rows, cols) — the photographs
    points : (n, 2) — raw pixels of the left one; those with NaN are left out
    window_px : side of the windows that are compared [px]

    Where few are found, windows of other looks are compared too, as of surfaces askew to the cameras.
    Raises ValueError where the rig cannot be rectified.
    """
    points = points[all_finite(points)]
    small, scale = _reduced(rectification(rig))
    half = max(_MIN_WINDOW_PX, round(window_px * scale)) // 2
    places = raw_to_rectified(points, rig.left, small.rotation_left, small.matrix_left)
    strip, top = _cropped_rows(small, places[:, 1], half + _MAX_ROW_DIFFERENCE)
    places[:, 1] -= top
    view = _rectified_view(rig, strip, left, right, scale)
    found = np.full(points.shape, np.nan)
    for look in _LOOKS:
        missing = np.isnan(found[:, 0])
        if missing.mean() <= 1.0 - _SUFFICIENT_SHARE:
            break
        found[missing] = _matched_places(view, places[missing], half, look)
    known = all_finite(found)
    points = points[known]
    partners = rectified_to_raw(found[known], rig.right, strip.rotation_right, strip.matrix_right)
    kept = agreeing_matches(points, partners)
    return Partners(points[kept], partners[kept])


def right_of_left(partners: Partners, places: Array) -> tuple[Array, Array]:
    """Places in the right photograph of what the left one shows at places (..., 2), from the partners around.

    Returns the places (..., 2) [px] and their slopes ∂(right)/∂(left) (..., 2, 2); NaN where a place is NaN, and
    everywhere with too few partners.
    """
    known = all_finite(places)
    position, slope = np.full(places.shape, np.nan), np.full((*places.shape, 2), np.nan)
    if len(partners.left) >= MIN_PARTNERS and known.any():
        position[known], slope[known] = local_motion(partners.left, partners.right, places[known])
    return position, slope


def starting_warps(warp_left: Array, position: Array, slope: Array) -> Array:
    """Affine warps (..., 2, 3) from the first left photograph to the right one of a step.

    warp_left : (..., 2, 3 or 6) — from the first left photograph to the left one of the step
    position, slope : (..., 2), (..., 2, 2) — of :func:`right_of_left` at the places of its centres
    """
    return np.concatenate([position[..., None], product(slope, warp_left[..., 1:3])], axis=-1)


def _reduced(full: Rectification) -> tuple[Rectification, float]:
    """Rectified cameras with images of at most _MAX_IMAGE_SIDE_PX, and their scale."""
    scale = min(1.0, _MAX_IMAGE_SIDE_PX / max(full.size))
    width, height = full.size
    return _transformed(full, np.diag([scale, scale, 1.0]), (round(scale * width), round(scale * height))), scale


def _cropped_rows(small: Rectification, y: Array, reach: int) -> tuple[Rectification, int]:
    """Rectified cameras with only the rows that windows at y (n,) need, at least one; and the first of these rows."""
    width, height = small.size
    known = y[np.isfinite(y)]
    low, high = (known.min(), known.max()) if len(known) else (0.0, 0.0)
    first = int(np.clip(np.floor(low) - reach, 0, height - 1))
    last = int(np.clip(np.ceil(high) + reach + 1, first + 1, height))
    shift_up = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, -first], [0.0, 0.0, 1.0]])
    return _transformed(small, shift_up, (width, last - first)), first


def _transformed(rectified: Rectification, transform: Array, size: tuple[int, int]) -> Rectification:
    """Rectified cameras after a transform of their pixels (3, 3); size : (width, height) of the images."""
    return rectified._replace(
        matrix_left=transform @ rectified.matrix_left, matrix_right=transform @ rectified.matrix_right, size=size
    )


def _rectified_view(rig: Rig, strip: Rectification, left: Grey, right: Grey, scale: float) -> _View:
    """Both photographs rectified, smoothed before by as much as they are reduced."""

    def smooth(image: Grey) -> Grey:
        grey = image.astype(np.float32)
        return np.asarray(cv2.GaussianBlur(grey, (0, 0), _REDUCTION_BLUR_PX / scale) if scale < 1.0 else grey)

    views = (
        rectify(smooth(left), rig.left, strip.rotation_left, strip.matrix_left, strip.size, is_rough=True),
        rectify(smooth(right), rig.right, strip.rotation_right, strip.matrix_right, strip.size, is_rough=True),
    )
    return _View(*views, covered(rig.left, strip.rotation_left, strip.matrix_left, strip.size))


def _matched_places(view: _View, places: Array, half: int, look: _Look) -> Array:
    """Partners (n, 2) of places: of scouts in the whole row, and of the others at offsets about those of the scouts."""
    found, width = np.full(places.shape, np.nan), view.left.shape[1]
    scouts = np.zeros(len(places), dtype=bool)
    scouts[::_SCOUT_STRIDE] = True
    found[scouts] = [_partner(view, place, half, look, (-width, width)) for place in places[scouts]]
    offsets = np.sort((found - places)[np.isfinite(found[:, 0]), 0])
    limits = (-width, width)
    if len(offsets) >= MIN_PARTNERS:
        low, high = offsets[len(offsets) // 10], offsets[-1 - len(offsets) // 10]
        spare = 4.0 * half + high - low
        limits = int(low - spare), int(high + spare)
    found[~scouts] = [_partner(view, place, half, look, limits) for place in places[~scouts]]
    return found


def _partner(view: _View, place: Array, half: int, look: _Look, limits: tuple[int, int]) -> tuple[float, float]:
    """The place of the right image that fits a place of the left one best; NaN where no place clearly does.

    limits : smallest and largest x in the right image minus x in the left one
    """
    unknown = (np.nan, np.nan)
    if not np.isfinite(place).all():
        return unknown
    x, y = np.rint(place).astype(int)
    wide, high = int(np.ceil(half * (1.0 / look.width + abs(look.shear)))), half + _MAX_ROW_DIFFERENCE
    rows, cols = view.left.shape
    if not (wide <= x < cols - wide and high <= y < rows - high):
        return unknown
    around = slice(y - half, y + half + 1), slice(x - wide, x + wide + 1)
    first, last = max(0, x + limits[0] - half), min(cols, x + limits[1] + half + 1)
    if not view.covered[around].all() or last - first < 2 * half + 1:
        return unknown
    template = _as_seen_right(view.left[around], half, look)
    fit = cv2.matchTemplate(view.right[y - high : y + high + 1, first:last], template, cv2.TM_CCOEFF_NORMED)
    fit[~(np.abs(fit) <= 1.0)] = -1.0  # where the image has no contrast
    row, col = np.unravel_index(fit.argmax(), fit.shape)
    best = fit[row, col]
    fit[:, max(0, col - half) : col + half + 1] = -1.0
    if best < _MIN_CORRELATION or best < fit.max() + _MIN_CORRELATION_LEAD:
        return unknown
    offset = place - (x, y)
    return float(first + col + half + offset[0]), float(row - _MAX_ROW_DIFFERENCE + y + offset[1])


def _as_seen_right(window: Image, half: int, look: _Look) -> Image:
    """The middle of a window (2 half + 1, ≥ 2 half + 1) of the left image as it looks in the right one, a square."""
    side, wide = 2 * half + 1, window.shape[1] // 2
    scale, shear = 1.0 / look.width, -look.shear
    to_window = np.array([[scale, shear, wide - (scale + shear) * half], [0.0, 1.0, 0.0]])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    return np.asarray(cv2.warpAffine(window, to_window, (side, side), flags=flags, borderMode=cv2.BORDER_REPLICATE))
