"""Motion of windows by cross-correlation in the frequency domain, where nothing is known of it beforehand.

The zero-mean normalised cross-correlation of a window with every place of a larger image takes four Fourier
transforms (Lewis, Vision Interface 1995; with masks, Padfield, IEEE Trans. Image Processing 21, 2012). One window as
large as the region finds the motion as a whole, at reduced resolution; where the region deforms too much for
that, many smaller windows look for themselves, and those that agree tell the motion. Then windows of half that
size, bent by the motion known so far, look near where it puts them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.fft import irfft2, next_fast_len, rfft2

from dicflow.core.arrays import Array, Image, Index, Mask
from dicflow.core.matching.pairs import agreeing, local_motion

__all__ = ["Peak", "fft_matches", "search"]


WHOLE_PX = 256  # the longer side of the region where it is looked for as a whole; finer detail is averaged away
FAR_WINDOWS, NEAR_WINDOWS = 64, (32, 128)  # about how many windows look in the whole image, and near a predicted place
FAR_PX, NEAR_PX = 96, 48  # their side, and that of the windows that look near a predicted place [px]
REACH_PX = (24, 8)  # how far these look, first and after that
LEAST_CORRELATION = 0.3
LEAST_OVERLAP = 0.5  # share of a window that must lie in the image
FLAT = 1e-3  # share of the image's variance below which a place shows nothing


class Peak(NamedTuple):
    """Where a window fits best.

    shift : (2,) float64 — (x, y) of the window's first pixel in the image [px]
    correlation : zero-mean normalised cross-correlation there
    """

    shift: Array
    correlation: float


def search(window: npt.NDArray[Any], image: npt.NDArray[Any], usable: Mask | None = None) -> Peak:
    """The place in an image at which a window fits best.

    window : (rows, cols) grey
    image : (rows, cols) grey, of any other size
    usable : (rows, cols) bool — pixels of the window that count

    The window may stand over the image's edge by half its usable pixels. The place is refined by a parabola through
    the highest value and its neighbours.
    """
    counts = np.ones(window.shape) if usable is None else usable.astype(np.float64)
    f = np.where(counts > 0, window - np.average(window, weights=counts), 0.0)
    g = image - float(image.mean())
    shape = [next_fast_len(a + b - 1, real=True) for a, b in zip(window.shape, image.shape, strict=True)]
    from_f, from_counts, from_g, from_square, from_frame = (
        rfft2(part, shape) for part in (f, counts, g, g * g, np.ones(image.shape))
    )

    def against(of_window: Any, of_image: Any) -> Array:
        return np.asarray(irfft2(np.conj(of_window) * of_image, shape))

    number = np.maximum(against(from_counts, from_frame), 1.0)
    sum_f, sum_g = against(from_f, from_frame), against(from_counts, from_g)
    of_f = against(rfft2(f * f, shape), from_frame) - sum_f**2 / number
    of_g = against(from_counts, from_square) - sum_g**2 / number
    enough = number >= LEAST_OVERLAP * counts.sum()
    known = enough & (of_g > FLAT * number * float((g * g).mean())) & (of_f > FLAT * float((f * f).sum()))
    product = np.where(known, of_f * of_g, 1.0)
    surface = np.where(known, (against(from_f, from_g) - sum_f * sum_g / number) / np.sqrt(product), -1.0)
    return _peak(surface)


def _peak(surface: Array) -> Peak:
    """The highest value of a periodic surface; the second half of the indices are negative shifts."""
    at = np.array(np.unravel_index(int(surface.argmax()), surface.shape))
    place = at.astype(np.float64)
    for axis in range(2):
        step = np.eye(2, dtype=int)[axis]
        low, high = (float(surface[tuple((at + sign * step) % surface.shape)]) for sign in (-1, 1))
        bend = low - 2.0 * float(surface[tuple(at)]) + high
        place[axis] += float(np.clip(0.5 * (low - high) / bend, -0.5, 0.5)) if bend < 0.0 else 0.0
    place = np.where(at > np.array(surface.shape) // 2, place - surface.shape, place)
    return Peak(place[::-1], float(surface.max()))


def fft_matches(
    reference: npt.NDArray[Any], target: npt.NDArray[Any], usable: Mask, *, in_pieces: bool = False
) -> tuple[Array, Array]:
    """Places in a reference image and where cross-correlation finds them in a target image, (n, 2) each [px].

    reference, target : (rows, cols) grey; they may differ in size
    usable : (rows, cols) bool — one connected part of the reference that moves as one piece
    in_pieces : many windows look for themselves first, not the region as a whole: dearer, and for larger deformations
    """
    from_image, to_image = (np.asarray(image, dtype=np.float32) for image in (reference, target))
    pairs = (_piece_by_piece if in_pieces else _as_a_whole)(from_image, to_image, usable)
    for reach, count in zip(REACH_PX, NEAR_WINDOWS, strict=True):
        pairs = _nearby(from_image, to_image, _window_centres(usable, NEAR_PX, count), usable, pairs, reach)
    return pairs


def _as_a_whole(reference: Image, target: Image, usable: Mask) -> tuple[Array, Array]:
    """The shift of the region, from one correlation at reduced resolution."""
    x, y, width, height = cv2.boundingRect(usable.astype(np.uint8))
    scale = min(1.0, WHOLE_PX / max(width, height))
    part = slice(y, y + height), slice(x, x + width)
    window, image = _reduced(reference[part], scale), _reduced(target, scale)
    counts = _reduced(usable[part].astype(np.float32), scale) > 0.5
    centre = np.array([[x + 0.5 * (width - 1), y + 0.5 * (height - 1)]])
    shift = search(window, image, counts).shift / scale - (x, y) if counts.any() else np.zeros(2)
    return centre, centre + shift


def _reduced(image: Image, scale: float) -> Image:
    if scale == 1.0:
        return image
    size = [max(1, round(side * scale)) for side in image.shape[::-1]]
    return np.asarray(cv2.resize(image, size, interpolation=cv2.INTER_AREA), dtype=np.float32)


def _piece_by_piece(reference: Image, target: Image, usable: Mask) -> tuple[Array, Array]:
    """Windows that look for themselves in the whole target."""
    centres = _window_centres(usable, FAR_PX, FAR_WINDOWS)
    half, scale = FAR_PX // 2, min(1.0, 2 * WHOLE_PX / max(target.shape))
    image, places, found = _reduced(target, scale), [], []
    for centre in centres.astype(int):
        window, counts = _window(reference, centre, half), _window(usable, centre, half)
        reduced = _reduced(window, scale)
        peak = search(reduced, image, _reduced(counts.astype(np.float32), scale) > 0.5)
        if peak.correlation >= LEAST_CORRELATION:
            corner = np.maximum(centre - half, 0)
            places.append(centre)
            found.append(peak.shift / scale + centre - corner)
    return _kept(places, found)


def _nearby(
    reference: Image, target: Image, centres: Array, usable: Mask, pairs: tuple[Array, Array], reach: int
) -> tuple[Array, Array]:
    """Windows around centres (n, 2) that look near where the pairs put them, bent as the pairs say."""
    if len(pairs[0]) == 0:
        return pairs
    motion, half = local_motion(*pairs, centres), NEAR_PX // 2
    offsets = np.arange(-half - reach, half + reach + 1)
    grid = np.stack(np.meshgrid(offsets, offsets), axis=-1).astype(np.float64)
    places, found = [], []
    for centre, place, slope in zip(centres.astype(int), *motion, strict=True):
        at = (place + grid @ slope.T).astype(np.float32)
        image = np.asarray(cv2.remap(target, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE))
        peak = _template_peak(image, _window(reference, centre, half), _window(usable, centre, half))
        shift = peak.shift - (half + reach) + centre - np.maximum(centre - half, 0)
        if peak.correlation >= LEAST_CORRELATION and np.abs(shift).max() < reach:
            places.append(centre)
            found.append(place + slope @ shift)
    return _kept(places, found)


def _template_peak(image: Image, window: Image, usable: Mask) -> Peak:
    """The place at which a window fits best wholly inside a small image."""
    mask = None if usable.all() else usable.astype(np.float32)
    surface = cv2.matchTemplate(image, window, cv2.TM_CCOEFF_NORMED, mask=mask)
    surface[~(np.abs(surface) <= 1.0)] = -1.0  # where the image shows nothing at all
    return _peak(surface)


def _kept(places: list[Any], found: list[Any]) -> tuple[Array, Array]:
    """The pairs that agree with each other."""
    source, target = np.array(places, dtype=np.float64).reshape(-1, 2), np.array(found).reshape(-1, 2)
    keep = agreeing(source, target)
    return source[keep], target[keep]


def _window(image: npt.NDArray[Any], centre: Index, half: int) -> npt.NDArray[Any]:
    """The square around a pixel, less what lies outside the image."""
    x, y = centre
    return image[max(0, y - half) : y + half + 1, max(0, x - half) : x + half + 1]


def _window_centres(usable: Mask, side: int, count: int) -> Array:
    """Centres (n, 2) of windows that are usable by half, at most half overlapping; the fullest one where none is.

    count : about how many, at most
    """
    left, top, width, height = cv2.boundingRect(usable.view(np.uint8))
    part = usable[top : top + height, left : left + width].astype(np.float32)
    share = cv2.blur(part, (side, side), borderType=cv2.BORDER_CONSTANT)
    step = max(side // 2, int(np.sqrt(part.sum() / count)))
    rows, cols = np.nonzero(share[step // 2 :: step, step // 2 :: step] >= 0.5)
    if len(rows) == 0:
        y, x = np.unravel_index(int(share.argmax()), share.shape)
        return np.array([[left + x, top + y]], dtype=np.float64)
    return np.asarray(np.stack([cols, rows], axis=-1).astype(np.float64) * step + step // 2 + (left, top))
