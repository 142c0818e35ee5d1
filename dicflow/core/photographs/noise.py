"""The noise of photographs in grey levels, from one photograph or from two of the same scene."""

from __future__ import annotations

from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Grey, Image, Mask
from dicflow.core.photographs.texture import in_strips, saturation_level

__all__ = [
    "Noise",
    "image_noise",
    "interpolated_noise_ratio",
    "interpolated_variance",
    "noise_from_pair",
    "noise_of_first_photograph",
    "pair_noise",
    "residual_noise",
    "smoothed_noise",
]


ROUNDING_NOISE = 12**-0.5  # grey levels: standard deviation of the rounding to whole numbers
MAX_STATIC_MOTION_PX = 0.05  # motion below which two photographs are a static pair

MIN_PLAIN_SHARE, MIN_PLAIN_PIXELS = 0.03, 500  # size of the plainest part of the region
_FOURTH_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0]) / np.sqrt(70.0)
_DIFFERENCE_REACH_PX, _SLOPE_REACH_PX = 2, 9
"""Reach of fourth differences, and of a slope of grey levels that are smoothed before and after."""
_INTERPOLATED_VARIANCE = {3: 0.874**2, 5: 0.918**2}
"""Mean variance of white noise after interpolation, over that before: (∫ φ²)² of the cardinal spline φ."""
_PLACES_PER_SIDE = 5  # of a subset at which the noise of its interpolated pixels is computed
_CHUNK = 2000
"""Subsets that are computed at once: fetching memory for all of them takes longer than computing."""
_PLAIN_QUANTILE, _NORMAL_QUANTILE = 0.1, 1.2816
"""Share of the subsets whose residual is noise alone, at least, and standard deviations from the mean of a normal
distribution to this quantile."""
_SIGMA_PER_MAD = 1.4826  # of a normal distribution: standard deviation over median absolute deviation


class Noise(NamedTuple):
    """The noise of a series of photographs.

    grey : its standard deviation [grey levels]
    source : photographs from which it is estimated
    is_final : whether later photographs leave it unchanged
    """

    grey: float
    source: str
    is_final: bool


def noise_of_first_photograph(image: Grey, usable: Mask) -> Noise:
    """The noise estimated from the first photograph, not final until a second one shows the same points.

    image : (rows, cols) grey; usable : (rows, cols) bool — the region
    """
    return Noise(max(image_noise(image, usable), ROUNDING_NOISE), "first photograph", False)


def noise_from_pair(
    noise: Noise,
    first: Grey,
    second: Grey,
    usable: Mask,
    points: tuple[Array, Array, Array],
    by_places: float,
    *,
    pixels: int,
    smoothing_px: float,
) -> Noise:
    """The noise estimated from two correlated photographs, or that of the first where it is smaller.

    noise : estimated from the first photograph
    first, second : (rows, cols) grey; usable : (rows, cols) bool — the region in the first one
    points : points in the first one (n, 2), their matches in the second one (n, 2) [px], and the variance of the noise
        as the residual of their subsets has it (n,) [grey levels²]
    by_places : the noise that moves places as the residuals do [grey levels]; infinite where unknown
    pixels : of a subset
    smoothing_px : smoothing of both before the correlation; the residual of smoothed photographs is not used

    Final, except without points. What subsets do not follow adds to most residuals at a large strain, so that the small
    ones tell: by noise alone the variance over n pixels scatters by √(2/n). What a fine pattern adds to all of them
    does less to the places than noise would.
    """
    centres, places, variance = points
    if not len(centres):
        return noise
    if np.quantile(np.linalg.norm(places - centres, axis=-1), 0.95) < MAX_STATIC_MOTION_PX:
        return Noise(max(pair_noise(first, second, usable), ROUNDING_NOISE), "static pair", True)
    plain = np.quantile(variance, _PLAIN_QUANTILE) / (1.0 - _NORMAL_QUANTILE * np.sqrt(2.0 / pixels))
    least = min(float(np.sqrt(max(plain, 0.0))), by_places)
    residual = np.inf if smoothing_px > 0.0 else max(least, ROUNDING_NOISE)
    return (
        Noise(residual, "residual of a second photograph", True)
        if residual < noise.grey
        else noise._replace(is_final=True)
    )


def image_noise(image: Grey, usable: Mask) -> float:
    """Standard deviation of the noise of one photograph [grey levels].

    image : (rows, cols) grey; usable : (rows, cols) bool — the region

    Fourth differences along rows and columns keep the variance of white noise and remove most of the pattern (after
    Immerkær, Computer Vision and Image Understanding 64, 1996, who uses second differences). The edges of sharp
    speckles remain, so only the part where the smoothed image varies least is used. Clipped pixels lack noise and are
    left out. The noise is overestimated where the pattern is finer than a few pixels.
    """
    unclipped = usable & (image > 0) & (image < saturation_level(image))
    if not unclipped.any():
        return 0.0
    share = min(1.0, max(MIN_PLAIN_SHARE, MIN_PLAIN_PIXELS / int(unclipped.sum())))
    slope = np.concatenate([part for _, part in in_strips(image, _SLOPE_REACH_PX, _smooth_slope)])
    plain = unclipped & (slope <= np.quantile(slope[unclipped], share))
    residual = [part[plain[rows]] for rows, part in in_strips(image, _DIFFERENCE_REACH_PX, _fourth_differences)]
    return _standard_deviation_without_outliers(np.concatenate(residual))


def _smooth_slope(grey: Image) -> Image:
    """Slope of the smoothed grey levels, smoothed."""
    smooth = cv2.GaussianBlur(grey, (0, 0), 1.0)
    slope = np.hypot(cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3))
    return np.asarray(cv2.GaussianBlur(slope, (0, 0), 1.0))


def _fourth_differences(grey: Image) -> Array:
    """Fourth differences along rows and columns."""
    kernel = _FOURTH_DIFFERENCE
    return np.asarray(cv2.sepFilter2D(grey, cv2.CV_64F, kernel, kernel, borderType=cv2.BORDER_REFLECT))


def pair_noise(first: Grey, second: Grey, usable: Mask) -> float:
    """Standard deviation of the noise of each of two photographs of a static scene [grey levels].

    first, second : (rows, cols) grey; usable : (rows, cols) bool — the region

    A change of light and a shift of a few hundredths of a pixel are fitted to the difference and subtracted.
    """
    f, g = (image.astype(np.float32) for image in (first, second))
    smooth = cv2.GaussianBlur(f, (0, 0), 1.0)
    slopes = (cv2.Sobel(smooth, cv2.CV_32F, *axis, ksize=1, scale=0.5) for axis in ((1, 0), (0, 1)))
    explained = np.stack([np.ones(int(usable.sum())), *(v[usable] for v in (smooth - smooth.mean(), *slopes))])
    difference = (g - f)[usable].astype(np.float64)
    coefficients = np.linalg.lstsq(explained @ explained.T, explained @ difference, rcond=None)[0]
    return _standard_deviation_without_outliers(difference - coefficients @ explained) / float(np.sqrt(2.0))


def residual_noise(variance: Array, degree: int) -> float:
    """Standard deviation of the noise from the residuals of a correlation [grey levels]; NaN without points.

    variance : (n,) — of the difference of subsets f and what they match, g [grey levels²]
    degree : of the spline, 3 or 5

    The difference contains the noise of f and the interpolated noise of g. Errors of the shape function and changes of
    the light add to it, so this is an upper bound.
    """
    return float(np.sqrt(np.median(variance) / (1.0 + _INTERPOLATED_VARIANCE[degree]))) if len(variance) else np.nan


def interpolated_variance(degree: int, warp: Array, side: int) -> Array:
    """Variance (n,) of white noise after interpolation at the pixels of subsets, over that before.

    degree : of the spline, 3 or 5; warp : (n, 2, 3 or 6) — of subsets around whole pixels; side : of these [px]

    Between the pixels interpolation with the cardinal spline φ keeps less noise than on them, Σⱼ φ(x − j)² for either
    coordinate x. A motion without strain brings all pixels of a subset to the same x.
    """
    offset = np.rint(np.linspace(-0.5, 0.5, _PLACES_PER_SIDE) * (side - 1))
    offsets = np.stack(np.meshgrid(offset, offset)).reshape(2, -1)
    table = _variance_between_pixels(degree)

    def of_part(part: Array) -> Array:
        places = (part[..., :1] - np.rint(part[..., :1]) + part[..., 1:3] @ offsets).astype(np.float32)
        kept = table[((places - np.floor(places)) * len(table)).astype(np.int32) % len(table)]
        return np.asarray(np.einsum("np,np->n", kept[:, 0], kept[:, 1], dtype=np.float64) / len(offset) ** 2)

    chunks = np.array_split(warp, -(-len(warp) // _CHUNK)) if len(warp) else []
    return np.concatenate([np.empty(0), *map(of_part, chunks)])


@cache
def _variance_between_pixels(degree: int) -> Image:
    """Σⱼ φ(x − j)² at the fractions x of a pixel in the middles of 1000 parts, (1000,)."""
    fraction, frequency = (np.arange(1000) + 0.5) / 1000.0, (np.arange(64) + 0.5) / 64.0 - 0.5
    aliases = frequency[:, None] + np.arange(-4, 5)
    power = np.sinc(aliases) ** (degree + 1)
    transfer = power / power.sum(axis=1, keepdims=True)
    response = (transfer * np.exp(2j * np.pi * aliases * fraction[:, None, None])).sum(axis=-1)
    return np.asarray((np.abs(response) ** 2).mean(axis=1), dtype=np.float32)


def interpolated_noise_ratio(slope: Array, degree: int) -> Array:
    """Variance of a subset's position by the noise of the target, over that by the noise of the template, (...).

    slope : (..., 2, 2) — gradient of the motion into the target; degree : of the spline, 3 or 5

    The samples of a subset that shrinks share pixels of the target, so their noise is correlated; those of one that
    grows depend on more pixels. Interpolation with the cardinal spline φ gives white noise the spectrum |φ̂|², which
    samples at a distance λ alias. If the pattern is coarse relative to the pixels, only the lowest frequencies matter:
    s(λ) = Σₘ |φ̂(m/λ)|² / λ for each of the principal stretches λ.
    """
    (a, b), (c, d) = (np.moveaxis(slope[..., axis, :], -1, 0) for axis in (0, 1))
    even, odd = np.sqrt((a + d) ** 2 + (c - b) ** 2) / 2.0, np.sqrt((a - d) ** 2 + (c + b) ** 2) / 2.0
    stretches, kept = _variance_after_stretch(degree)
    return np.asarray(np.interp(even + odd, stretches, kept) * np.interp(np.abs(even - odd), stretches, kept))


@cache
def _variance_after_stretch(degree: int) -> tuple[Array, Array]:
    """Stretches λ and s(λ) of :func:`interpolated_noise_ratio`, (401,) each."""
    stretches, orders = np.geomspace(0.1, 10.0, 401), np.arange(-30, 31)
    frequency = orders / stretches[:, None]
    alias = frequency - np.rint(frequency)
    sum_of_aliases = (np.sinc(alias[..., None] + np.arange(-4, 5)) ** (degree + 1)).sum(axis=-1)
    spectrum = np.sinc(frequency) ** (degree + 1) / sum_of_aliases
    return stretches, (spectrum**2).sum(axis=1) / stretches


def smoothed_noise(noise: float, image: Grey, usable: Mask, smoothing_px: float) -> float:
    """Standard deviation of the white noise with the same effect on correlation as smoothed noise [grey levels].

    noise : standard deviation before smoothing [grey levels]; smoothing_px : standard deviation of the Gaussian

    Noise n moves a subset by H⁻¹ Σ J n. Smoothed noise has Σ J (K n) = Σ (K J) n, so its variance is that of white
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


def _standard_deviation_without_outliers(values: Grey) -> float:
    """Standard deviation of values without those beyond 4 σ (+ 1) from the median, σ from the median deviation."""
    away = values - np.median(values)
    return float(np.std(away[np.abs(away) <= 4.0 * _SIGMA_PER_MAD * np.median(np.abs(away)) + 1.0]))
