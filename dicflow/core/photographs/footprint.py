"""Photographs whose pixels blur the material alike.

A pixel shows the mean over its square. Where the material has been stretched by A in between, this square covers
another part of it, so that two photographs of the same dots differ by more than their motion. In pixels of the target
the template's square has the covariance A Aᵀ / 12, the target's own I / 12. A Gaussian with what one has more than the
other, laid over either photograph, makes them alike to second order.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Image

__all__ = ["Blurs", "blurred", "missing_blurs"]


NEGLIGIBLE_PX2 = 0.02
"""Variance of a blur that is not worth laying over a photograph: that of a stretch by a tenth."""
_MOST = 5.0
"""Greatest stretch that counts, so that the kernel holds its blur."""
_REACH = 6
_PIXEL = 1.0 / 12.0


class Blurs(NamedTuple):
    """Covariances (2, 2) of the Gaussians that the template and the target lack [px² of each]; None for none."""

    template: Array | None
    target: Array | None


def missing_blurs(slope: Array, smoothing_px: float = 0.0) -> Blurs:
    """What two photographs lack to blur the material alike.

    slope : (2, 2) — gradient of the motion from the template to the target
    smoothing_px : standard deviation of the Gaussian that both have passed already
    """
    blur = _PIXEL + smoothing_px**2
    return Blurs(_excess(np.asarray(np.linalg.inv(slope), dtype=np.float64), blur), _excess(slope, blur))


def _excess(slope: Array, blur: float) -> Array | None:
    """blur (A Aᵀ − I), without what is negative."""
    squares, axes = np.linalg.eigh(slope @ slope.T)
    more = blur * (np.clip(squares, 1.0, _MOST**2) - 1.0)
    return None if more.max() < NEGLIGIBLE_PX2 else np.asarray((axes * more) @ axes.T)


def blurred(image: Image, covariance: Array | None) -> Image:
    """An image under a Gaussian [px²]; its kernel is that of the continuous one below the Nyquist frequency."""
    if covariance is None:
        return image
    frequency = np.fft.fftfreq(2 * _REACH + 1)
    pairs = np.stack(np.meshgrid(frequency, frequency), axis=-1)
    passed = np.exp(-2.0 * np.pi**2 * np.einsum("ijk,kl,ijl->ij", pairs, covariance, pairs))
    kernel = np.fft.fftshift(np.fft.ifft2(passed).real)
    return np.asarray(cv2.filter2D(image, -1, kernel, borderType=cv2.BORDER_REFLECT_101), dtype=np.float32)
