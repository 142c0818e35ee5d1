"""Equal blur of the material by the pixels of two photographs.

A pixel shows the mean over its square. If the material is stretched by A between two photographs, the square covers
another part of the material, so the photographs differ by more than the motion. In pixels of the target the template's
square has the covariance A Aᵀ / 12, the target's own has I / 12. Gaussians with the missing covariances, applied to
the two photographs, make their blur equal to second order.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Image

__all__ = ["Blurs", "blurred", "missing_blurs", "white_noise_share"]


NEGLIGIBLE_VARIANCE_PX2 = 0.02
"""Variance below which a blur is not applied: that of a stretch by a tenth."""
_MAX_STRETCH = 5.0
"""Larger stretches are treated as this one, so that the kernel is large enough for the blur."""
_KERNEL_RADIUS_PX, _KERNEL_SIGMAS = 6, 4.0
"""Least radius of a kernel, and in standard deviations of a large blur."""
_PIXEL_VARIANCE_PX2 = 1.0 / 12.0


class Blurs(NamedTuple):
    """Covariances (2, 2) of the Gaussians to apply to template and target [px² of each]; None for negligible ones."""

    template: Array | None
    target: Array | None


def missing_blurs(slope: Array, smoothing_px: float = 0.0) -> Blurs:
    """The blurs that make template and target blur the material equally.

    slope : (2, 2) — gradient of the motion from the template to the target
    smoothing_px : standard deviation of the Gaussian that has been applied to both
    """
    blur = _PIXEL_VARIANCE_PX2 + smoothing_px**2
    return Blurs(
        _missing_covariance(np.asarray(np.linalg.inv(slope), dtype=np.float64), blur), _missing_covariance(slope, blur)
    )


def _missing_covariance(slope: Array, blur: float) -> Array | None:
    """blur (A Aᵀ − I) with negative eigenvalues set to 0; None where it is negligible."""
    squares, axes = np.linalg.eigh(slope @ slope.T)
    more = blur * (np.clip(squares, 1.0, _MAX_STRETCH**2) - 1.0)
    return None if more.max() < NEGLIGIBLE_VARIANCE_PX2 else np.asarray((axes * more) @ axes.T)


def blurred(image: Image, covariance: Array | None) -> Image:
    """An image after a Gaussian filter of a covariance (2, 2) [px²], exact below the Nyquist frequency."""
    if covariance is None:
        return image
    kernel = _kernel(covariance)
    return np.asarray(cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REFLECT_101), dtype=np.float32)


def white_noise_share(covariance: Array) -> float:
    """Variance of white noise after a Gaussian filter of a covariance (2, 2) [px²], over that before."""
    return float((_kernel(covariance) ** 2).sum())


def _kernel(covariance: Array) -> Array:
    largest = float(np.sqrt(np.linalg.eigvalsh(covariance)[-1]))
    frequency = np.fft.fftfreq(2 * max(_KERNEL_RADIUS_PX, int(np.ceil(_KERNEL_SIGMAS * largest))) + 1)
    pairs = np.stack(np.meshgrid(frequency, frequency), axis=-1)
    transfer = np.exp(-2.0 * np.pi**2 * np.einsum("ijk,kl,ijl->ij", pairs, covariance, pairs))
    return np.asarray(np.fft.fftshift(np.fft.ifft2(transfer).real))
