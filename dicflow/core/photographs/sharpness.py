"""How much more one photograph is blurred than another, from the spectra of windows that show the same.

A Gaussian of covariance C multiplies the power at the frequency k by exp(−4 π² kᵀ C k). So the logarithm of the ratio
of two power spectra falls by that, for every pattern, and a change of contrast adds a constant. Motion during the
exposure, or a specimen that is compressed, makes C larger along one direction than along another. A shift of a few
pixels changes no power. White noise adds a constant to a spectrum, which is the least power at the highest frequencies.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array

__all__ = ["BlurDifference", "blur_difference"]


_LEAST_WAVES, _HIGHEST_FREQUENCY = 2.0, 0.3
"""Lowest frequency in waves per window, and highest one [1/px]: above it, interpolation damps what was resampled."""
_NOISE_FREQUENCY, _MIN_SIGNAL = 0.42, 2.0
"""Frequency above which the spectrum of noise is taken [1/px], and least power of a frequency that counts over it."""
_MIN_FREQUENCIES, _ALIKE = 24, 4.5
"""With fewer frequencies above the noise nothing is known; so many of them are worth one: each is there twice, and
windows that fade out mix it with the next ones."""


class BlurDifference(NamedTuple):
    """Covariance of the Gaussian that blurs one photograph like the other, by its axes.

    variances : (2,) — along the axes, negative where the other one is the more blurred [px²]
    errors : (2,) — standard errors of these [px²]
    axes : (2, 2) — directions (x, y) of the axes, in columns
    """

    variances: Array
    errors: Array
    axes: Array


def blur_difference(sharp: Array, blurred: Array, beside: Array, resampled: float = 1.0) -> BlurDifference:
    """The blur of ``blurred`` beyond that of ``sharp``.

    sharp, blurred : (n, side, side) — windows that show the same, to a few pixels [grey levels]
    beside : (n, side, side) — windows of the photograph of ``blurred`` as it was taken, for its noise
    resampled : power of white noise in ``blurred`` over that in ``beside``
    Infinite errors where too few frequencies rise above the noise.
    """
    frequencies = _frequencies(sharp.shape[-1])
    frequency = np.linalg.norm(frequencies, axis=-1)
    power = [_power(windows) for windows in (sharp, blurred)]
    noise = [_noise_power(power[0], frequency), resampled * _noise_power(_power(beside), frequency)]
    signal = [total - floor for total, floor in zip(power, noise, strict=True)]
    known = (frequency * sharp.shape[-1] >= _LEAST_WAVES) & (frequency <= _HIGHEST_FREQUENCY)
    for part, floor in zip(signal, noise, strict=True):
        known &= part > (_MIN_SIGNAL - 1.0) * floor
    if known.sum() < _MIN_FREQUENCIES:
        return BlurDifference(np.zeros(2), np.full(2, np.inf), np.eye(2))
    first, second = (part[known] for part in signal)
    weight = frequency[known] ** 2 * np.minimum(first, second)
    return _fitted(2.0 * np.pi * frequencies[known], np.log(first / second), weight)


def _frequencies(side: int) -> Array:
    """Frequencies (side, side, 2) along x and y of a spectrum [1/px], 0 in the middle."""
    wave = np.fft.fftshift(np.fft.fftfreq(side))
    return np.stack(np.meshgrid(wave, wave), axis=-1)


def _power(windows: Array) -> Array:
    """Mean power spectrum (side, side) of windows (n, side, side), which fade out towards their borders."""
    fade = np.hanning(windows.shape[-1] + 2)[1:-1]
    fade = fade * fade[:, None]
    mean = (windows * fade).sum(axis=(1, 2), keepdims=True) / fade.sum()
    return np.asarray(np.fft.fftshift((np.abs(np.fft.fft2((windows - mean) * fade)) ** 2).mean(axis=0)))


def _noise_power(power: Array, frequency: Array) -> float:
    """Power of the noise: the lower quartile of that at the highest frequencies. frequency : (side, side) [1/px]"""
    return float(np.quantile(power[frequency >= _NOISE_FREQUENCY], 0.25))


def _fitted(waves: Array, y: Array, weight: Array) -> BlurDifference:
    """The covariance C with y = kᵀ C k + constant at wave vectors k (n, 2), by weighted least squares."""
    kx, ky = waves.T
    terms = np.stack([kx * kx, 2.0 * kx * ky, ky * ky, np.ones_like(kx)], axis=-1)
    inverse = np.linalg.pinv((terms * weight[:, None]).T @ terms)
    gain = inverse @ (terms * weight[:, None]).T
    found = gain @ y
    left = gain * (y - terms @ found)
    covariance = _ALIKE * left @ left.T
    variances, axes = np.linalg.eigh(found[[[0, 1], [1, 2]]])
    along = np.stack([axes[0] ** 2, 2.0 * axes[0] * axes[1], axes[1] ** 2, np.zeros(2)])
    errors = np.sqrt(np.einsum("ik,ij,jk->k", along, covariance, along))
    return BlurDifference(variances, errors, axes)
