"""Texture of an image: where it shows a speckle pattern, and the pattern's contrast, exposure and speckle size."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Grey, Image, Mask
from dicflow.core.photographs.autocorrelation import autocorrelation, overlap

__all__ = [
    "MIN_TEXTURE",
    "Texture",
    "in_strips",
    "mean_intensity_gradient",
    "saturated_share",
    "saturation_level",
    "speckle_size",
    "speckled_points",
    "texture",
    "textured_box",
]

STRIDE_PX = 4  # between texture values: fine enough for a region's outline, 16 times cheaper than every pixel
_STRIP_PX = 32 * STRIDE_PX
"""Rows that are computed at once: fetching memory for a whole photograph takes longer than computing."""
_DERIVATIVE_REACH_PX = 5
"""Reach of the derivatives of the smoothed grey levels."""
MIN_TEXTURE_RATIO = 3.0  # least ratio of the median textures of pattern and background
_USUAL_REACH_PX = 64  # shifts that are enough for most speckles
_ENOUGH_PX = 960  # side of a window in which most speckles can be measured
MIN_TEXTURE = 1.5  # grey levels (of 255) per pixel: below this, sensor noise is as strong as the pattern


class Texture(NamedTuple):
    """Texture of an image on a coarse grid.

    strength : (rows, cols) float32 — least directional root mean square gradient [grey levels of 255 per px]
    stride_px : distance between grid points; grid point [i, j] stands at pixel (j, i) · stride_px
    window_px : side of the square over which it is averaged
    """

    strength: Image
    stride_px: int
    window_px: int


def mean_intensity_gradient(image: Grey, mask: Mask | None = None) -> float:
    """Mean length of the grey-level gradient over the mask [grey levels of 255 per px].

    The measure of a speckle pattern's quality by Pan, Lu and Xie (Optics and Lasers in Engineering 48, 2010), here of
    the image smoothed by 1 px to reduce the sensor's noise.
    """
    counts = np.ones(image.shape, dtype=np.uint8) if mask is None else mask.view(np.uint8)
    full_scale, total = _full_scale(image), 0.0
    for rows, lengths in in_strips(image, _DERIVATIVE_REACH_PX, lambda grey: _gradient_length(grey, full_scale)):
        total += cv2.mean(lengths, counts[rows])[0] * cv2.countNonZero(counts[rows])
    return total / max(cv2.countNonZero(counts), 1)


def in_strips(
    image: Grey, reach_px: int, compute: Callable[[Image], Array | Image]
) -> Iterator[tuple[slice, Array | Image]]:
    """Rows of an image, some at a time, and what is computed of them.

    reach_px : of what ``compute`` makes of grey levels (rows, cols): values (rows, cols), each of the pixels around it
    """
    for top in range(0, len(image), _STRIP_PX):
        first, end = max(0, top - reach_px), min(top + _STRIP_PX, len(image))
        values = compute(image[first : end + reach_px].astype(np.float32))
        yield slice(top, end), values[top - first : end - first]


def saturation_level(image: Grey) -> float:
    """The grey level above which a pixel is saturated."""
    return _full_scale(image) * (1.0 - 2.0**-8)


def saturated_share(image: Grey, mask: Mask) -> float:
    """Share of the mask's pixels that are saturated; NaN for an empty mask."""
    pixels = np.count_nonzero(mask)
    return float(np.count_nonzero(mask & (image > saturation_level(image))) / pixels) if pixels else float("nan")


def speckle_size(image: Grey, mask: Mask) -> float:
    """Diameter of the speckles in a mask [px], at most about an eighth of its size; NaN without contrast.

    Of a large mask, the window with most of its pixels tells. The autocorrelation of discs of diameter D falls to one
    half at a shift of 0.404 D, where they overlap by half. Slow changes of the light are subtracted first.
    """
    part = _fullest_window(mask)
    inside, grey = mask[part].astype(np.float32), image[part].astype(np.float32)
    side = max(3, min(grey.shape) // 4)
    mean = cv2.blur(grey * inside, (side, side)) / np.maximum(cv2.blur(inside, (side, side)), np.float32(1e-6))
    pattern = (grey - mean) * inside
    for reach in sorted({min(side, _USUAL_REACH_PX), side}):
        profile = _autocorrelation_profile(pattern, inside, reach)
        below = np.flatnonzero(profile < 0.5 * profile[0])
        if profile[0] > 0.0 and len(below):
            last = int(below[0]) - 1
            at_half = last + (profile[last] - 0.5 * profile[0]) / (profile[last] - profile[last + 1])
            return float(at_half / 0.404)
    return float("nan")


def _fullest_window(mask: Mask) -> tuple[slice, slice]:
    """The window of a mask, at most as large as is enough, with most of its pixels: rows and columns."""
    x, y, width, height = cv2.boundingRect(mask.view(np.uint8))
    rows, cols = min(height, _ENOUGH_PX), min(width, _ENOUGH_PX)
    total = cv2.integral(mask[y : y + height, x : x + width].view(np.uint8))
    counts = total[rows:, cols:] - total[:-rows, cols:] - total[rows:, :-cols] + total[:-rows, :-cols]
    top, left = np.unravel_index(int(counts.argmax()), counts.shape)
    return slice(y + int(top), y + int(top) + rows), slice(x + int(left), x + int(left) + cols)


def _autocorrelation_profile(pattern: Image, inside: Image, reach: int) -> Array:
    """Mean autocorrelation of a pattern inside a mask, both (rows, cols), at shifts of 0 … reach − 1 px."""
    shifts = reach - 1, reach - 1
    correlation = autocorrelation(pattern, shifts) / np.maximum(overlap(inside, shifts), 1.0)
    shift = np.rint(np.hypot(*np.meshgrid(np.arange(reach), np.arange(reach)))).astype(int).ravel()
    total, count = np.bincount(shift, correlation[-reach:, -reach:].ravel()), np.bincount(shift)
    return np.asarray((total / count)[:reach])


def texture(image: Grey, window_px: int = 32) -> Texture:
    """Strength of the pattern around each point: √ of the smaller eigenvalue of the mean structure tensor.

    image : (rows, cols) uint8 or uint16 grey
    window_px : side of the averaging window; several speckles should fit in it

    A straight edge has gradients in one direction only, so it does not contribute to the smaller eigenvalue (Shi and
    Tomasi, CVPR 1994).
    """
    halo = STRIDE_PX * -(-(window_px // 2 + _DERIVATIVE_REACH_PX) // STRIDE_PX)
    full_scale, parts = _full_scale(image), []
    for top in range(0, len(image), _STRIP_PX):
        first = max(0, top - halo)
        strength = _strength(image[first : top + _STRIP_PX + halo], window_px, full_scale)
        parts.append(strength[(top - first) // STRIDE_PX :][: _STRIP_PX // STRIDE_PX])
    return Texture(np.concatenate(parts), STRIDE_PX, window_px)


def _strength(image: Grey, window_px: int, full_scale: float) -> Image:
    """The strength of the texture of a strip of an image."""
    gx, gy = _gradient(_smoothed(image, full_scale))
    xx, yy, xy = (_window_mean(product, window_px) for product in (gx * gx, gy * gy, gx * gy))
    smaller = (xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
    return np.asarray(np.sqrt(np.maximum(smaller, 0)))


def speckled_points(texture: Texture) -> Mask:
    """Grid points that show the pattern, (rows, cols) bool; all False where the texture is too weak everywhere.

    The threshold between pattern and background is Otsu's on the logarithm of the strength. It is used only where the
    two sides differ clearly; otherwise the whole image is pattern or background.
    """
    strength = texture.strength
    logarithm = np.log(np.maximum(strength, 0.05))
    span = float(np.ptp(logarithm))
    bound = 0.0
    if span > 0:
        scaled = ((logarithm - logarithm.min()) * (255 / span)).astype(np.uint8)
        level, _ = cv2.threshold(scaled, 0, 255, cv2.THRESH_OTSU)
        upper = scaled > level
        if upper.any() and np.median(logarithm[upper]) - np.median(logarithm[~upper]) > np.log(MIN_TEXTURE_RATIO):
            bound = float(np.exp(logarithm.min() + (level + 1) * span / 255))
    mask: Mask = strength >= max(bound, MIN_TEXTURE)
    return mask


def textured_box(image: Grey, window_px: int = 32) -> tuple[int, int, int, int] | None:
    """Bounding box (x0, y0, x1, y1) [px], ends excluded, of the pattern in an image; None without a pattern.

    Islands smaller than two windows are left out.
    """
    found = texture(image, window_px)
    mask = speckled_points(found).astype(np.uint8)
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask, connectivity=4)
    large = stats[1:][stats[1:, cv2.CC_STAT_AREA] >= 2 * (window_px / STRIDE_PX) ** 2]
    if len(large) == 0:
        return None
    height, width = image.shape
    x0, y0 = (large[:, :2].min(axis=0) * STRIDE_PX).tolist()
    x1, y1 = ((large[:, :2] + large[:, 2:4]).max(axis=0) * STRIDE_PX).tolist()
    return x0, y0, min(x1, width), min(y1, height)


def _full_scale(image: Grey) -> float:
    """The greatest grey level of the image's depth: the least of 8, 10, 12, 14 or 16 bits that holds its values."""
    bits = max(8, 2 * ((int(image.max()).bit_length() + 1) // 2))
    return float(2**bits - 1)


def _smoothed(image: Grey | Image, full_scale: float) -> Image:
    """Grey levels 0 … 255, smoothed by 1 px. full_scale : the level that becomes 255"""
    grey = image.astype(np.float32) * np.float32(255.0 / full_scale)
    return np.asarray(cv2.GaussianBlur(grey, (0, 0), 1.0), dtype=np.float32)


def _gradient_length(image: Image, full_scale: float) -> Array:
    """Length of the gradient of the smoothed grey levels [grey levels of 255 per px]."""
    return np.asarray(cv2.magnitude(*_gradient(_smoothed(image, full_scale))))


def _gradient(image: Image) -> tuple[Image, Image]:
    """Central differences along x and y [grey levels per px]."""
    gx = cv2.Sobel(image, cv2.CV_32F, 1, 0, ksize=1, scale=0.5)
    gy = cv2.Sobel(image, cv2.CV_32F, 0, 1, ksize=1, scale=0.5)
    return np.asarray(gx, dtype=np.float32), np.asarray(gy, dtype=np.float32)


def _window_mean(values: Image, window_px: int) -> Image:
    """Mean over the window around every pixel of the coarse grid."""
    side = window_px | 1
    return np.asarray(cv2.blur(values, (side, side))[::STRIDE_PX, ::STRIDE_PX], dtype=np.float32)
