"""The noise of photographs, in grey levels: from two of the same scene where there are such, or from one."""

from __future__ import annotations

from functools import cache
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt

from dicflow.core.arrays import Array, Mask
from dicflow.core.photographs.texture import saturation

__all__ = [
    "Noise",
    "first_noise",
    "image_noise",
    "interpolated_noise",
    "pair_noise",
    "residual_noise",
    "smoothed_noise",
    "told_by_motion",
]


ROUNDING = 12**-0.5  # grey levels: noise that whole numbers have in any case
STATIC_PX = 0.05  # motion below which two photographs count as of one scene

PLAIN_SHARE, PLAIN_PIXELS = 0.03, 500  # of the region, where its grey levels change least; at least so many pixels
_DIFFERENCES = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)
_KEPT = {3: 0.874**2, 5: 0.918**2}
"""Share of the noise's variance that interpolation leaves on average: (∫ φ²)² of the cardinal spline φ."""
_MAD = 1.4826  # of a normal distribution: standard deviation over median absolute deviation


class Noise(NamedTuple):
    """What is known of the noise of a series of photographs.

    grey : its standard deviation [grey levels]
    source : what told it
    settled : it stays, whatever photographs follow
    """

    grey: float
    source: str
    settled: bool


def first_noise(image: npt.NDArray[Any], usable: Mask) -> Noise:
    """The noise as the first photograph tells it, until another one shows the same points.

    image : (rows, cols) grey; usable : (rows, cols) bool — the region
    """
    return Noise(max(image_noise(image, usable), ROUNDING), "first photograph", False)


def told_by_motion(
    noise: Noise,
    first: npt.NDArray[Any],
    second: npt.NDArray[Any],
    usable: Mask,
    found: tuple[Array, Array, Array],
    *,
    size: int,
    degree: int,
    smoothing_px: float,
) -> Noise:
    """The noise as two photographs tell it together, where that is better than the first alone.

    noise : as the first photograph tells it
    first, second : (rows, cols) grey; usable : (rows, cols) bool — the region in the first one
    found : points in the first one (n, 2) — whole pixels, in the second one (n, 2) [px], and their ZNSSD (n,)
    size, degree : as in :func:`residual_noise`
    smoothing_px : of both photographs before they were correlated, which leaves little of the noise in the residual

    It stays unsettled where no point was found.
    """
    centres, places, znssd = found
    if not len(centres):
        return noise
    if np.quantile(np.linalg.norm(places - centres, axis=-1), 0.95) < STATIC_PX:
        return Noise(max(pair_noise(first, second, usable), ROUNDING), "static pair", True)
    left = np.inf if smoothing_px > 0.0 else max(residual_noise(first, centres, znssd, size, degree), ROUNDING)
    return Noise(left, "residual of a second photograph", True) if left < noise.grey else noise._replace(settled=True)


def image_noise(image: npt.NDArray[Any], usable: Mask) -> float:
    """Standard deviation of the noise of one photograph [grey levels].

    image : (rows, cols) grey; usable : (rows, cols) bool — the region

    Fourth differences along rows and columns leave white noise as strong as it is, and little of what a lens has
    drawn (after Immerkær, Computer Vision and Image Understanding 64, 1996, who takes second ones). The edges of
    sharp speckles still show, so only the plainest part is used, as the smoothed image has it. Clipped pixels have no
    noise and do not count. With a pattern finer than a few pixels the noise comes out too large.
    """
    grey = image.astype(np.float32)
    residual = cv2.sepFilter2D(grey, cv2.CV_64F, _DIFFERENCES, _DIFFERENCES, borderType=cv2.BORDER_REFLECT)
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)
    slope = np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3))
    slope = np.asarray(cv2.GaussianBlur(slope, (0, 0), 1.0))
    free = usable & (grey > 0) & (grey < saturation(image))
    if not free.any():
        return 0.0
    share = min(1.0, max(PLAIN_SHARE, PLAIN_PIXELS / int(free.sum())))
    return _spread(residual[free & (slope <= np.quantile(slope[free], share))])


def pair_noise(first: npt.NDArray[Any], second: npt.NDArray[Any], usable: Mask) -> float:
    """Standard deviation of the noise of each of two photographs in which nothing moved [grey levels].

    first, second : (rows, cols) grey; usable : (rows, cols) bool — the region

    What a change of light, and a shift of a few hundredths of a pixel, explain is taken off the difference by least
    squares.
    """
    f, g = (image.astype(np.float32) for image in (first, second))
    smooth = cv2.GaussianBlur(f, (0, 0), 1.0)
    slopes = (cv2.Sobel(smooth, cv2.CV_32F, *axis, ksize=1, scale=0.5) for axis in ((1, 0), (0, 1)))
    explained = np.stack(
        [np.ones(int(usable.sum()), dtype=np.float32), *(v[usable] for v in (smooth, *slopes))], axis=-1
    )
    difference = (g - f)[usable].astype(np.float64)
    part = np.linalg.lstsq(explained.astype(np.float64), difference, rcond=None)[0]
    return _spread(difference - explained @ part) / float(np.sqrt(2.0))


def residual_noise(image: npt.NDArray[Any], centres: Array, znssd: Array, size: int, degree: int) -> float:
    """Standard deviation of the noise that correlation left between two photographs [grey levels]; NaN without points.

    image : (rows, cols) grey — the reference; centres : (n, 2) — whole pixels; znssd : (n,) — there
    size : side of the subsets [px]; degree : of the spline, 3 or 5

    Σ (f − g)² is ZNSSD times Σ (f − f̄)², and has the noise of both: that of f, and that of g as interpolation leaves
    it. What the shape function or the light did not allow for counts too, so this is an upper bound.
    """
    grey = image.astype(np.float64)
    mean, square = (cv2.blur(part, (size, size)) for part in (grey, grey * grey))
    col, row = centres.astype(int).T
    residual = znssd * (square - mean * mean)[row, col]
    return float(np.sqrt(np.median(residual) / (1.0 + _KEPT[degree]))) if len(residual) else float("nan")


def interpolated_noise(slope: Array, degree: int) -> Array:
    """Variance of a subset's place by the noise of the target, (...), relative to what a template's noise makes.

    slope : (..., 2, 2) — gradient of the motion into the target; degree : of the spline, 3 or 5

    The pixels of a subset that shrinks share those of the target, so their noise is no longer independent; one that
    grows averages over more of them. Interpolation with the cardinal spline φ gives white noise the spectrum |φ̂|², and
    samples λ apart fold it. Of a pattern that is coarse beside the pixels only its lowest frequencies count:
    s(λ) = Σₘ |φ̂(m/λ)|² / λ for each of the principal stretches λ.
    """
    (a, b), (c, d) = (np.moveaxis(slope[..., axis, :], -1, 0) for axis in (0, 1))
    even, odd = np.hypot(a + d, c - b) / 2.0, np.hypot(a - d, c + b) / 2.0
    stretches, kept = _folded(degree)
    return np.asarray(np.interp(even + odd, stretches, kept) * np.interp(np.abs(even - odd), stretches, kept))


@cache
def _folded(degree: int) -> tuple[Array, Array]:
    """Stretches, and s of each."""
    stretches, orders = np.geomspace(0.1, 10.0, 401), np.arange(-30, 31)
    frequency = orders / stretches[:, None]
    part = frequency - np.rint(frequency)
    all_bells = (np.sinc(part[..., None] + np.arange(-4, 5)) ** (degree + 1)).sum(axis=-1)
    spectrum = np.sinc(frequency) ** (degree + 1) / all_bells
    return stretches, (spectrum**2).sum(axis=1) / stretches


def smoothed_noise(noise: float, image: npt.NDArray[Any], usable: Mask, smoothing_px: float) -> float:
    """The level of white noise that does to correlation what noise does after smoothing [grey levels].

    noise : standard deviation before [grey levels]; smoothing_px : standard deviation of the Gaussian

    A subset's place moves by H⁻¹ Σ J n. Smoothed noise has Σ J (K n) = Σ (K J) n, so its variance is that of white
    noise times Σ (K J)² / Σ J², with the derivatives J of the smoothed image.
    """
    if smoothing_px <= 0.0:
        return noise
    smooth = cv2.GaussianBlur(image.astype(np.float32), (0, 0), smoothing_px)
    before, after = 0.0, 0.0
    for axis in ((1, 0), (0, 1)):
        slope = cv2.Sobel(smooth, cv2.CV_32F, *axis, ksize=1, scale=0.5)
        before += float((slope[usable] ** 2).sum())
        after += float((cv2.GaussianBlur(slope, (0, 0), smoothing_px)[usable] ** 2).sum())
    return noise * float(np.sqrt(after / before)) if before > 0.0 else noise


def _spread(values: npt.NDArray[Any]) -> float:
    """Standard deviation without outliers."""
    away = values - np.median(values)
    return float(np.std(away[np.abs(away) <= 4.0 * _MAD * np.median(np.abs(away)) + 1.0]))
