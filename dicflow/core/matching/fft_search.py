"""Motion of windows by cross-correlation in the frequency domain, without a prediction.

The zero-mean normalised cross-correlation of a window with every position in a larger image is computed by Fourier
transforms (Lewis, Vision Interface 1995; with masks, Padfield, IEEE Trans. Image Processing 21, 2012). One window as
large as the region gives its mean motion, at reduced resolution. Where the region deforms too much for that, smaller
windows are searched for separately in the whole image, and those that agree are kept. From there the motion grows:
guided windows, deformed by the motion of those found so far, are searched for near their predicted positions, until no
further ones are found.
"""

from __future__ import annotations

from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Bytes, Grey, Image, Index, Mask
from dicflow.core.matching.pairs import agreeing_matches, local_motion
from dicflow.core.threads import over

__all__ = ["Peak", "correlation_peak", "fft_matches"]


WHOLE_REGION_PX = 256  # longer side of the region in the reduced images in which it is searched for as a whole
SEPARATE_WINDOWS, GUIDED_WINDOWS = 25, 128  # about how many windows, in the whole image and in a guided search
WINDOW_PX = 48  # side of these windows: larger ones do not match where the motion turns or stretches by a tenth
SEARCHED_PX = 1024  # longer side of the image in which separate windows are searched for
GROWTH, MAX_SEARCHES = 1.05, 8  # ratio of windows found to those before at which the motion still grows, and searches
SEARCH_RADIUS_PX, LAST_RADIUS_PX = 24, 8  # of guided searches, and of the last one
MIN_CORRELATION = 0.3
MIN_OVERLAP = 0.5  # least share of a window that must lie in the image
MIN_VARIANCE_SHARE = 1e-3  # least variance of a position, as a share of the image's, for a correlation to be computed


class Peak(NamedTuple):
    """The position in an image at which a window correlates best.

    shift : (2,) float64 — (x, y) of the window's first pixel in the image [px]
    correlation : zero-mean normalised cross-correlation there
    """

    shift: Array
    correlation: float


def correlation_peak(window: Grey, image: Grey, usable: Mask | None = None) -> Peak:
    """The position in an image at which a window correlates best.

    window : (rows, cols) grey
    image : (rows, cols) grey, of any size
    usable : (rows, cols) bool — pixels of the window to correlate; all if absent

    Up to half of the window's usable pixels may lie outside the image. The position is refined by a parabola through
    the highest value and its neighbours.
    """
    counts = np.ones(window.shape) if usable is None else usable.astype(np.float64)
    window_zero_mean = np.where(counts > 0, window - np.average(window, weights=counts), 0.0)
    image_zero_mean = image - float(image.mean())
    shape = [cv2.getOptimalDFTSize(a + b - 1) for a, b in zip(window.shape, image.shape, strict=True)]
    from_f, from_counts, from_g, from_square, from_frame = (
        np.fft.rfft2(part, shape)
        for part in (window_zero_mean, counts, image_zero_mean, image_zero_mean * image_zero_mean, np.ones(image.shape))
    )

    def against(of_window: Any, of_image: Any) -> Array:
        return np.asarray(np.fft.irfft2(np.conj(of_window) * of_image, shape))

    number = np.maximum(against(from_counts, from_frame), 1.0)
    sum_f, sum_g = against(from_f, from_frame), against(from_counts, from_g)
    of_f = against(np.fft.rfft2(window_zero_mean * window_zero_mean, shape), from_frame) - sum_f**2 / number
    of_g = against(from_counts, from_square) - sum_g**2 / number
    enough = number >= MIN_OVERLAP * counts.sum()
    known = (
        enough
        & (of_g > MIN_VARIANCE_SHARE * number * float((image_zero_mean * image_zero_mean).mean()))
        & (of_f > MIN_VARIANCE_SHARE * float((window_zero_mean * window_zero_mean).sum()))
    )
    product = np.where(known, of_f * of_g, 1.0)
    surface = np.where(known, (against(from_f, from_g) - sum_f * sum_g / number) / np.sqrt(product), -1.0)
    peak = _surface_peak(surface)
    period = np.array(surface.shape[::-1])
    return peak._replace(shift=np.where(peak.shift > period // 2 + 0.5, peak.shift - period, peak.shift))


def _surface_peak(surface: Array) -> Peak:
    """The peak of a correlation surface (rows, cols), by its place there; beyond its border it repeats itself."""
    at = np.array(np.unravel_index(int(surface.argmax()), surface.shape))
    place = at.astype(np.float64)
    for axis in range(2):
        step = np.eye(2, dtype=int)[axis]
        low, high = (float(surface[tuple((at + sign * step) % surface.shape)]) for sign in (-1, 1))
        bend = low - 2.0 * float(surface[tuple(at)]) + high
        place[axis] += float(np.clip(0.5 * (low - high) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0
    return Peak(place[::-1], float(surface.max()))


def fft_matches(
    reference: Grey, target: Grey, usable: Mask, *, separate_windows: bool = False, threads: int = 1
) -> tuple[Array, Array]:
    """Points in a reference image and their matches in a target image by cross-correlation, (n, 2) each [px].

    reference, target : (rows, cols) grey; they may differ in size
    usable : (rows, cols) bool — one connected part of the reference with continuous motion
    separate_windows : search first for windows separately instead of the region as a whole: slower, for larger
        deformations
    threads : how many share the windows
    """
    from_image, to_image = (np.asarray(image, dtype=np.float32) for image in (reference, target))
    pairs = (_separate_window_matches if separate_windows else _whole_region_match)(from_image, to_image, usable)
    centres, found_before = _window_centres(usable, WINDOW_PX, GUIDED_WINDOWS), 0
    guided = partial(_guided_window_matches, (from_image, to_image, usable), centres, threads)
    for _ in range(MAX_SEARCHES):
        pairs = guided(pairs, SEARCH_RADIUS_PX)
        if len(pairs[0]) <= GROWTH * found_before or GROWTH * len(pairs[0]) >= len(centres):
            break
        found_before = len(pairs[0])
    return guided(pairs, LAST_RADIUS_PX)


def _whole_region_match(reference: Image, target: Image, usable: Mask) -> tuple[Array, Array]:
    """The region's centre and its match, from one correlation at reduced resolution: (1, 2) each."""
    x, y, width, height = cv2.boundingRect(usable.astype(np.uint8))
    scale = min(1.0, WHOLE_REGION_PX / max(width, height))
    part = slice(y, y + height), slice(x, x + width)
    window, image = _reduced(reference[part], scale), _reduced(target, scale)
    counts = _reduced(usable[part].astype(np.float32), scale) > 0.5
    centre = np.array([[x + 0.5 * (width - 1), y + 0.5 * (height - 1)]])
    shift = correlation_peak(window, image, counts).shift / scale - (x, y) if counts.any() else np.zeros(2)
    return centre, centre + shift


def _reduced(image: Image, scale: float) -> Image:
    if scale == 1.0:
        return image
    size = [max(1, round(side * scale)) for side in image.shape[::-1]]
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _separate_window_matches(reference: Image, target: Image, usable: Mask) -> tuple[Array, Array]:
    """Matches of windows that are searched for separately in the whole target."""
    centres = _window_centres(usable, WINDOW_PX, SEPARATE_WINDOWS)
    half, scale = WINDOW_PX // 2, min(1.0, SEARCHED_PX / max(target.shape))
    image, places, found = _reduced(target, scale), [], []
    for centre in centres.astype(int):
        window, counts = _clipped_window(reference, centre, half), _clipped_window(usable, centre, half)
        filled = np.where(counts, window, window[counts].mean()) if counts.any() else window
        peak = _template_peak(image, _reduced(filled, scale))
        if peak.correlation >= MIN_CORRELATION:
            corner = np.maximum(centre - half, 0)
            places.append(centre)
            found.append(peak.shift / scale + centre - corner)
    return _agreeing_pairs(places, found)


def _guided_window_matches(
    views: tuple[Image, Image, Mask], centres: Array, threads: int, pairs: tuple[Array, Array], reach: int
) -> tuple[Array, Array]:
    """Matches of windows around centres (n, 2), searched for near the positions that the pairs predict.

    views : the reference, the target, and the usable pixels of the reference
    reach : radius of the search [px]
    """
    if len(pairs[0]) == 0:
        return pairs
    found = over(
        threads, partial(_guided_match, views, reach), zip(centres, *local_motion(*pairs, centres), strict=True)
    )
    known = [at is not None for at in found]
    return _agreeing_pairs(list(centres[known]), [at for at in found if at is not None])


def _guided_match(views: tuple[Image, Image, Mask], reach: int, motion: tuple[Array, Array, Array]) -> Array | None:
    """Where a window matches, near its predicted place; None where it does not.

    The target is resampled by the predicted motion, so that it matches the undeformed window.

    reach : radius of the search [px]
    motion : the window's centre (2,), the place predicted for it (2,), and the gradient of the motion there (2, 2)
    """
    (reference, target, usable), (centre, place, slope), half = views, motion, WINDOW_PX // 2
    at, side = centre.astype(int), 2 * (half + reach) + 1
    to_target = np.column_stack([slope, place - slope.sum(axis=1) * (half + reach)])
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    image = np.asarray(cv2.warpAffine(target, to_target, (side, side), flags=flags, borderMode=cv2.BORDER_REPLICATE))
    peak = _template_peak(image, _clipped_window(reference, at, half), _clipped_window(usable, at, half))
    shift = peak.shift - (half + reach) + at - np.maximum(at - half, 0)
    is_found = peak.correlation >= MIN_CORRELATION and np.abs(shift).max() < reach
    return np.asarray(place + slope @ shift) if is_found else None


def _template_peak(image: Image, window: Image, usable: Mask | None = None) -> Peak:
    """The position of a window, wholly inside a small image, at which it correlates best."""
    mask = None if usable is None or usable.all() else usable.astype(np.float32)
    surface = cv2.matchTemplate(image, window, cv2.TM_CCOEFF_NORMED, mask=mask)
    surface[~(np.abs(surface) <= 1.0)] = -1.0  # NaN or overflow where the image is uniform
    return _surface_peak(surface)


def _agreeing_pairs(places: list[Any], found: list[Any]) -> tuple[Array, Array]:
    """The pairs that agree with each other."""
    source, target = np.array(places, dtype=np.float64).reshape(-1, 2), np.array(found).reshape(-1, 2)
    keep = agreeing_matches(source, target)
    return source[keep], target[keep]


def _clipped_window(image: Grey, centre: Index, half: int) -> Grey:
    """The square around a pixel, clipped to the image."""
    x, y = centre
    return image[max(0, y - half) : y + half + 1, max(0, x - half) : x + half + 1]


def _window_centres(usable: Mask, side: int, count: int) -> Array:
    """Centres (n, 2) of windows of which at least half is usable, at most half overlapping.

    count : about how many, at most
    Where not even half of any window is usable, the centre of the one with most usable pixels.
    """
    left, top, width, height = cv2.boundingRect(usable.view(np.uint8))
    part = usable[top : top + height, left : left + width].astype(np.uint8)
    step = max(side // 2, int(np.sqrt(part.sum() / count)))
    share = _window_shares(part, side, step)
    rows, cols = np.nonzero(share >= 0.5)
    if len(rows) == 0:
        share = cv2.blur(part.astype(np.float32), (side, side), borderType=cv2.BORDER_CONSTANT)
        y, x = np.unravel_index(int(share.argmax()), share.shape)
        return np.array([[left + x, top + y]], dtype=np.float64)
    return np.asarray(np.stack([cols, rows], axis=-1).astype(np.float64) * step + step // 2 + (left, top))


def _window_shares(usable: Bytes, side: int, step: int) -> Array:
    """Usable share of the windows around the middles of squares of ``step`` px."""
    sums = cv2.integral(usable)
    edges = [
        [np.clip(np.arange(step // 2, length, step) + offset, 0, length) for offset in (-(side // 2), side - side // 2)]
        for length in usable.shape
    ]
    (top, bottom), (left, right) = edges
    inside = sums[np.ix_(bottom, right)] - sums[np.ix_(top, right)] - sums[np.ix_(bottom, left)]
    return np.asarray((inside + sums[np.ix_(top, left)]) / side**2)
