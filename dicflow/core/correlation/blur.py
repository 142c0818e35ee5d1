"""Template and target made equally sharp before their subsets are compared.

A stretch changes how much of the material a pixel covers, which follows from the motion. Focus, depth of field and
motion during the exposure change too, which the spectra of both photographs tell. The sharper one is blurred: without
that, its edges pull the subsets.
"""

from __future__ import annotations

from functools import reduce
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Image, Mask
from dicflow.core.correlation.warp import apply_warp
from dicflow.core.photographs.footprint import Blurs, blurred, missing_blurs, white_noise_share
from dicflow.core.photographs.interpolate import Spline, spline
from dicflow.core.photographs.sharpness import blur_difference

__all__ = ["Damping", "equally_sharp"]


_WINDOWS, _SIDE = 32, 48
"""Windows whose spectra are compared, at most, and their side [px]."""
_MIN_WINDOWS = 4
_ROUNDS = 5
"""Estimates of a blur at most, each of what those before left: windows flatten spectra that fall steeply."""
_NEGLIGIBLE_PX2, _MIN_SIGNIFICANCE, _MAX_PX2 = 0.15, 4.0, 36.0
"""Variance of a blur up to which it is left alone, that in standard errors, and the largest that is made up for."""


class Damping(NamedTuple):
    """What a blur does to the noise of the photograph that it is applied to: ratios of variances, 1 without a blur.

    template, target : of the place of a subset by the noise of each
    template_grey, target_grey : of the noise itself
    excess : of the place by the noise of the template, beyond that with the subset before the blur
    blur : variance of the Gaussian that a change of sharpness takes [px²]
    mixing : standard deviation of the wider blur of both: about so far from a rim grey levels of the material mix with
        those of what lies beyond [px of the template]
    """

    template: float = 1.0
    target: float = 1.0
    template_grey: float = 1.0
    target_grey: float = 1.0
    excess: float = 0.0
    blur: float = 0.0
    mixing: float = 0.0


def equally_sharp(
    image: Image, region: Mask, target: Spline, places: Array, warps: Array, smoothing_px: float
) -> tuple[Image, Spline, Damping]:
    """The template's photograph and the target, one of them blurred so that both show the material equally sharp.

    image : (h, w) — photograph with the subsets; region : (h, w) — its pixels that count
    places : (n, 2) — centres of subsets in it; warps : (n, 2, 3) — approximately, to the target
    smoothing_px : standard deviation of the Gaussian that has been applied to both
    """
    if not len(places):
        return image, target, Damping()
    slope = np.median(warps[..., 1:3], axis=0)
    by_pixels, covariance = missing_blurs(slope, smoothing_px), np.zeros((2, 2))
    soft, softer, covariances = _softened(image, target, by_pixels)
    for _ in range(_ROUNDS):
        more = _missing_covariance(soft, softer.image, places, warps)
        if not more.any():
            break
        covariance = covariance + more
        soft, softer, covariances = _softened(image, target, by_pixels, _further_blurs(covariance, slope))
    seen = softer.image[_box(softer.image.shape, warps[..., 0])]
    damping = _damping(image, region, soft, seen, covariances)
    return soft, softer, damping._replace(blur=_size(covariance), mixing=_widest(covariances, slope))


def _widest(covariances: list[Array | None], slope: Array) -> float:
    """Largest standard deviation of the blurs of template and target [px of the template].

    slope : (2, 2) — gradient of the motion from the template to the target
    """
    ways = zip(covariances, (np.eye(2), np.linalg.inv(slope)), strict=True)
    variances = [np.linalg.norm(way @ one @ way.T, 2) for one, way in ways if one is not None]
    return float(np.sqrt(max(variances, default=0.0)))


def _further_blurs(covariance: Array, slope: Array) -> Blurs:
    """Blurs for a change of sharpness, without what is negligible of it.

    covariance : (2, 2) — of the target's blur in pixels of the template; along axes where it is negative, of the
        template's
    slope : (2, 2) — gradient of the motion from the template to the target
    """
    variances, axes = np.linalg.eigh(covariance)
    variances[np.abs(variances) < _NEGLIGIBLE_PX2] = 0.0
    of_template, of_target = ((axes * np.maximum(part, 0.0)) @ axes.T for part in (variances, -variances))
    return Blurs(of_template if of_template.any() else None, slope @ of_target @ slope.T if of_target.any() else None)


def _size(covariance: Array) -> float:
    """Mean size of the variances of a blur along its axes, one of which may be negative [px²]."""
    return float(np.abs(np.linalg.eigvalsh(covariance)).mean())


def _box(shape: tuple[int, ...], places: Array) -> tuple[slice, slice]:
    """The part (rows, columns) of an image around places (n, 2) [px]; all of it where they are few or outside."""
    limits = np.array(shape[::-1])
    low, high = np.clip([places.min(axis=0) - _SIDE, places.max(axis=0) + _SIDE], 0, limits).astype(int)
    (x0, y0), (x1, y1) = (low, high) if (high - low > _SIDE).all() else (0 * limits, limits)
    return slice(y0, y1), slice(x0, x1)


def _softened(image: Image, target: Spline, *blurs: Blurs) -> tuple[Image, Spline, list[Array | None]]:
    """Template and target after blurs, and the covariances of all these together."""
    covariances = [reduce(_sum, parts) for parts in zip(*blurs, strict=True)]
    return blurred(image, covariances[0]), _blurred_spline(target, covariances[1]), covariances


def _damping(image: Image, region: Mask, soft: Image, softer: Image, covariances: list[Array | None]) -> Damping:
    """What the blurs do to the noise.

    image : the template's photograph before; soft, softer : it and the target around the points, blurred
    """
    of_template, of_target = covariances
    damping = Damping()
    if of_template is not None:
        place, slopes = _damped(soft, of_template, region), _slope_energy(soft, region) / _slope_energy(image, region)
        grey = white_noise_share(of_template)
        damping = damping._replace(template=place, template_grey=grey, excess=max(0.0, place - slopes))
    if of_target is not None:
        damping = damping._replace(target=_damped(softer, of_target), target_grey=white_noise_share(of_target))
    return damping


def _sum(first: Array | None, second: Array | None) -> Array | None:
    """Sum of the covariances of two blurs; None without any."""
    return first if second is None else second if first is None else first + second


def _damped(soft: Image, covariance: Array, region: Mask | None = None) -> float:
    """Variance of the place of subsets of a blurred image by its blurred noise, over that by white noise.

    Noise n moves a subset by H⁻¹ Σ J n; after a blur K that is H⁻¹ Σ (K J) n with the slopes J of the blurred image.
    """
    return _slope_energy(blurred(soft, covariance), region) / _slope_energy(soft, region)


def _slope_energy(image: Image, region: Mask | None = None) -> float:
    """Mean square of the slope of an image [grey levels² per px²]."""
    square = sum(cv2.Sobel(image, cv2.CV_32F, *axis, ksize=1, scale=0.5) ** 2 for axis in ((1, 0), (0, 1)))
    return float(np.mean(square if region is None else square[region]))


def _blurred_spline(target: Spline, covariance: Array | None) -> Spline:
    """The target after a Gaussian filter."""
    return target if covariance is None else spline(blurred(target.image, covariance), target.degree, target.measured)


def _missing_covariance(image: Image, target: Image, places: Array, warps: Array) -> Array:
    """Covariance (2, 2) of the Gaussian that blurs the template's photograph like the target [px²].

    Negative along axes along which the target is the sharper one, 0 along those along which neither clearly is.
    """
    chosen = np.linspace(0, len(places) - 1, min(_WINDOWS, len(places))).astype(int)
    found = [w for w in (_windows(image, target, places[k], warps[k]) for k in chosen) if w is not None]
    if len(found) < _MIN_WINDOWS:
        return np.zeros((2, 2))
    sharp, moved, beside = (np.stack(part).astype(np.float64) for part in zip(*found, strict=True))
    resampled = 1.0 / np.minimum(np.linalg.svd(np.median(warps[..., 1:3], axis=0), compute_uv=False), 1.0).prod()
    variances, errors, axes = blur_difference(sharp, moved, beside, float(resampled))
    clear = np.abs(variances) >= np.maximum(_NEGLIGIBLE_PX2, _MIN_SIGNIFICANCE * errors)
    return np.asarray((axes * np.where(clear, np.clip(variances, -_MAX_PX2, _MAX_PX2), 0.0)) @ axes.T)


def _windows(image: Image, target: Image, place: Array, warp: Array) -> tuple[Image, Image, Image] | None:
    """The window around a place, the target resampled to show the same, and the target's own; None at a border."""
    side = np.arange(_SIDE) - _SIDE // 2
    offsets = np.stack(np.meshgrid(side, side), axis=-1)
    at = apply_warp(warp, offsets).astype(np.float32)
    own, other = (_square(grey, np.rint(middle)) for grey, middle in ((image, place), (target, warp[:, 0])))
    if own is None or other is None or at.min() < 0.0 or (at.max(axis=(0, 1)) > np.array(target.shape[::-1]) - 1).any():
        return None
    return own, np.asarray(cv2.remap(target, at, None, cv2.INTER_LANCZOS4)), other


def _square(image: Image, middle: Array) -> Image | None:
    """The pixels around a place (x, y); None where the image does not hold all of them."""
    x, y = (int(value) - _SIDE // 2 for value in middle)
    inside = x >= 0 and y >= 0 and x + _SIDE <= image.shape[1] and y + _SIDE <= image.shape[0]
    return image[y : y + _SIDE, x : x + _SIDE] if inside else None
