"""Template and target made equally sharp before their subsets are compared.

A stretch changes how much of the material a pixel covers, which follows from the motion. Focus, depth of field and
motion during the exposure change too, which the spectra of both photographs tell. The sharper one is blurred: without
that, its edges pull the subsets.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Image, Mask
from dicflow.core.correlation.warp import apply_warp
from dicflow.core.photographs.footprint import blurred, missing_blurs
from dicflow.core.photographs.interpolate import Spline, spline
from dicflow.core.photographs.noise import smoothed_noise
from dicflow.core.photographs.sharpness import blur_difference

__all__ = ["Damping", "equally_sharp"]


_WINDOWS, _SIDE = 64, 48
"""Windows whose spectra are compared, at most, and their side [px]."""
_MIN_WINDOWS = 4
_NEGLIGIBLE_PX2, _MIN_SIGNIFICANCE, _MAX_PX2 = 0.15, 4.0, 36.0
"""Variance of a blur up to which it is left alone, that in standard errors, and the largest that is made up for."""


class Damping(NamedTuple):
    """Effect of the noise of template and target on a place after blurring, over that without: ratios of variances."""

    template: float = 1.0
    target: float = 1.0

    @property
    def none(self) -> bool:
        """Whether neither photograph was blurred for its focus."""
        return self == (1.0, 1.0)


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
    blurs = missing_blurs(slope, smoothing_px)
    image, target = blurred(image, blurs.template), _blurred_spline(target, blurs.target)
    variance = _missing_variance(image, target.image, places, warps)
    if variance == 0.0:
        return image, target, Damping()
    size = float(np.sqrt(abs(variance)))
    if variance > 0.0:
        damping = Damping(template=smoothed_noise(1.0, image, region, size) ** 2)
        return blurred(image, variance * np.eye(2)), target, damping
    damping = Damping(target=smoothed_noise(1.0, target.image, np.ones(target.image.shape, dtype=bool), size) ** 2)
    return image, _blurred_spline(target, -variance * slope @ slope.T), damping


def _blurred_spline(target: Spline, covariance: Array | None) -> Spline:
    """The target after a Gaussian filter."""
    return target if covariance is None else spline(blurred(target.image, covariance), target.degree, target.measured)


def _missing_variance(image: Image, target: Image, places: Array, warps: Array) -> float:
    """Variance of the Gaussian that blurs the template's photograph like the target [px²]; negative if the target is
    the sharper one, 0 if neither is."""
    chosen = np.linspace(0, len(places) - 1, min(4 * _WINDOWS, len(places))).astype(int)
    found = [w for w in (_windows(image, target, places[k], warps[k]) for k in chosen) if w is not None]
    if len(found) < _MIN_WINDOWS:
        return 0.0
    found = found[:: 1 + (len(found) - 1) // _WINDOWS]
    sharp, moved, beside = (np.stack(part).astype(np.float64) for part in zip(*found, strict=True))
    variance, error = blur_difference(sharp, moved, beside)
    if abs(variance) < max(_NEGLIGIBLE_PX2, _MIN_SIGNIFICANCE * error):
        return 0.0
    return float(np.clip(variance, -_MAX_PX2, _MAX_PX2))


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
