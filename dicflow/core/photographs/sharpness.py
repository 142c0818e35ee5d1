"""How much more one photograph is blurred than another, from the spectra of windows that show the same.

A Gaussian of variance s² multiplies the power at the frequency k by exp(−4 π² s² k²). So the logarithm of the ratio of
two power spectra falls by 4 π² s² with k², for every pattern, and a change of contrast adds a constant. A shift
of a few pixels changes no power. White noise adds a constant to a spectrum, which is the least power at the highest
frequencies.
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
_MIN_FREQUENCIES = 4
"""With fewer frequencies above the noise, nothing is known."""


class BlurDifference(NamedTuple):
    """variance : of the Gaussian that blurs one photograph like the other [px²]; error : its standard error [px²]"""

    variance: float
    error: float


def blur_difference(sharp: Array, blurred: Array, beside: Array) -> BlurDifference:
    """The blur of ``blurred`` beyond that of ``sharp``; negative where that is the more blurred one.

    sharp, blurred : (n, side, side) — windows that show the same, to a few pixels [grey levels]
    beside : (n, side, side) — windows of the photograph of ``blurred`` as it was taken, for its noise
    An infinite error where too few frequencies rise above the noise.
    """
    frequency, ring = _rings(sharp.shape[-1])
    power = [_mean_in_rings(_power(windows), ring) for windows in (sharp, blurred)]
    noise = [_noise_power(_power(windows), frequency[ring]) for windows in (sharp, beside)]
    known = (frequency * sharp.shape[-1] >= _LEAST_WAVES) & (frequency <= _HIGHEST_FREQUENCY)
    for total, floor in zip(power, noise, strict=True):
        known &= total > _MIN_SIGNAL * floor
    if known.sum() < _MIN_FREQUENCIES:
        return BlurDifference(0.0, np.inf)
    signal = [total[known] - floor for total, floor in zip(power, noise, strict=True)]
    share = [part / total[known] for part, total in zip(signal, power, strict=True)]
    weight = np.bincount(ring.ravel())[known] * (share[0] * share[1]) ** 2
    return _fitted(4.0 * np.pi**2 * frequency[known] ** 2, np.log(signal[0] / signal[1]), weight)


def _rings(side: int) -> tuple[Array, Array]:
    """Frequencies of rings of the spectrum [1/px], and the ring of each of its places (side, side)."""
    wave = np.fft.fftfreq(side)
    ring = np.rint(np.hypot(wave, wave[:, None]) * side).astype(np.int64)
    return np.arange(ring.max() + 1) / side, ring


def _power(windows: Array) -> Array:
    """Mean power spectrum (side, side) of windows (n, side, side), which fade out towards their borders."""
    fade = np.hanning(windows.shape[-1] + 2)[1:-1]
    fade = fade * fade[:, None]
    mean = (windows * fade).sum(axis=(1, 2), keepdims=True) / fade.sum()
    return np.asarray((np.abs(np.fft.fft2((windows - mean) * fade)) ** 2).mean(axis=0))


def _mean_in_rings(power: Array, ring: Array) -> Array:
    return np.asarray(np.bincount(ring.ravel(), power.ravel()) / np.bincount(ring.ravel()))


def _noise_power(power: Array, frequency: Array) -> float:
    """Power of the noise: the lower quartile of that at the highest frequencies. frequency : (side, side) [1/px]"""
    return float(np.quantile(power[frequency >= _NOISE_FREQUENCY], 0.25))


def _fitted(x: Array, y: Array, weight: Array) -> BlurDifference:
    """Slope of y over x and its standard error, by weighted least squares with a constant."""
    total = weight.sum()
    dx, dy = x - (weight * x).sum() / total, y - (weight * y).sum() / total
    square = (weight * dx * dx).sum()
    slope = (weight * dx * dy).sum() / square
    scatter = (weight * (dy - slope * dx) ** 2).sum() / (len(x) - 2)
    return BlurDifference(float(slope), float(np.sqrt(scatter / square)))
