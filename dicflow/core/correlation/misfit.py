"""Covariance of the places of subsets by their residuals, noise and misfit together.

Noise alone moves a subset by Σ k n, with k = H⁻¹ J, which has the covariance σ² Σ k kᵀ. Interpolation of a pattern that
is too sharp for the pixels, or a pattern that has changed, leaves residuals that are correlated over a few pixels. With
their power P and autocorrelation ρ, whose spectrum is S, the covariance is

    P Σᵢⱼ kᵢ ρ(i − j) kⱼᵀ = P ∫ k̂ S k̂*,

which takes residuals and slopes of the grey levels as independent. The squares of sums of k r over windows do not need
that (White, Econometrica 48, 1980), but count what cancels from window to window. Either is too large where its
assumption fails, by a pattern too sharp for the pixels or a change of focus, so that the smaller one of both counts. A
fit takes a part of the residuals at each frequency, which is known and made up for.

A pattern that is a little sharper in one photograph leaves second derivatives of the grey levels f, along one
direction more than along another after a stretch. These move no place: f_x f_xx, f_x f_xy and f_x f_yy are made of
derivatives, as of f_x² / 2, whose sums over a subset depend on its rim alone. So this part is taken out of the
residuals, and its sum over the subset, the shift that it makes, is counted instead.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy.fft import irfft2, rfft2

from dicflow.core.arrays import Array, Image, Index, Mask, all_finite
from dicflow.core.correlation.residuals import Residuals
from dicflow.core.correlation.subsets import Subset, residuals
from dicflow.core.correlation.template import Template
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.tensors import upper_triangle
from dicflow.core.threads import over

__all__ = ["PlaceCovariances", "misfit_covariance", "misfit_stride", "place_covariances", "sampled_misfit"]


_CHUNK = 64
"""Subsets that are computed at once, and share an autocorrelation."""
_MAX_SAMPLES = 250
"""Subsets of a field whose residuals are computed, about; those between them get the misfit of their neighbours."""
_KERNEL_STRIDE, _MAX_TAKEN = 16, 0.8
"""Every so many of these give what kernels make of an autocorrelation, which is much the same for all, and the largest
share that a fit takes of the power at a frequency."""
_WINDOWS, _WINDOW_SIGMA, _MAX_LOSS = 5, 0.5, 5.0
"""Windows along the side of a subset, their standard deviation in distances of one from the next, and the largest loss
by the fit that is made up for."""
_CHANCE = 1.1
"""Factor by which sums over the windows of some subsets may be too small by chance: two standard errors."""
_MIN_PAIRS = 0.05
"""Share of the pixels of a subset that must have a partner at a distance, for the correlation there to be known."""
_NEIGHBOUR_SIGMA = 2.5
"""Standard deviation of the weights of neighbouring samples [samples]: a single one is too uncertain."""


class PlaceCovariances(NamedTuple):
    """Covariances (n, 2, 2) of the places of subsets, in pixels of the template; NaN where unknown.

    residual : by the residuals [px²]; noise : for white noise of one grey level [px² per grey level²]
    """

    residual: Array
    noise: Array


def misfit_stride(found: Mask) -> int:
    """Every so many points of a grid along both axes give a sample of the misfit. found : (rows, cols) bool"""
    return max(1, int(np.ceil(np.sqrt(found.sum() / _MAX_SAMPLES))))


def sampled_misfit(
    reference: Template, target: Spline, centres: Array, warp: Array, subset: Subset, noise: Array, threads: int = 1
) -> Array:
    """Variance (rows, cols, 3) of white noise that would move sampled subsets as their misfit does [grey levels²].

    centres : (rows, cols, 2) — whole pixels of the template; warp : (rows, cols, 2, 3 or 6); NaN where not found
    noise : (rows, cols) — variance of the noise of both photographs [grey levels²]

    Misfit is what residuals do beyond the noise. Twice its standard error is subtracted, so that chance alone rarely
    counts as misfit.
    """
    rows, cols = noise.shape
    whole_pixels = np.nan_to_num(centres.reshape(-1, 2)).astype(np.int64)
    warps = warp.reshape(-1, *warp.shape[2:])
    residual, white = place_covariances(reference, target, whole_pixels, warps, subset, threads)
    excess = _in_units(residual - noise.reshape(-1, 1, 1) * white, white)
    doubled_errors = 2.0 * _standard_errors(excess)
    values, axes = np.linalg.eigh(_smooth(excess.reshape(rows, cols, 2, 2)) - np.diag(doubled_errors))
    return upper_triangle((axes * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2))


def misfit_covariance(samples: Array, stride: int, unit: Array) -> Array:
    """Covariance (rows, cols, 3) of the places of a grid of subsets by misfit [px² of the template].

    samples : of every so many subsets (:func:`sampled_misfit`), which hold for their neighbours too
    unit : (rows, cols, 3) — covariance of the places for white noise of one grey level in one photograph
    """
    row, col = (np.arange(count) // stride for count in unit.shape[:2])
    x, y = np.sqrt(unit[..., 0]), np.sqrt(unit[..., 2])
    found = np.empty(unit.shape)
    for term, square in enumerate((unit[..., 0], x * y, unit[..., 2])):
        found[..., term] = samples[..., term][row[:, None], col] * square
    return found


def _standard_errors(excess: Array) -> Array:
    """Standard errors (2,) of the means of neighbours, from the scatter of samples (n, 2, 2); 0 where all are NaN."""
    if not np.isfinite(excess).any():
        return np.zeros(2)
    return np.asarray(np.nanstd(excess[:, [0, 1], [0, 1]], axis=0) / np.sqrt(4.0 * np.pi * _NEIGHBOUR_SIGMA**2))


def _smooth(values: Array) -> Array:
    """Means over neighbours on the grid (row, col, 2, 2); 0 where all are NaN."""
    known = all_finite(values, 2)
    share, total = (
        cv2.GaussianBlur(part, (0, 0), _NEIGHBOUR_SIGMA, borderType=cv2.BORDER_CONSTANT)
        for part in (known.astype(np.float64), np.where(known[..., None, None], values, 0.0).reshape(*known.shape, 4))
    )
    mean = np.where(share[..., None] > 1e-6, total / np.maximum(share[..., None], 1e-6), 0.0)
    return np.asarray(mean.reshape(values.shape))


def place_covariances(
    reference: Template, target: Spline, centres: Index, warp: Array, subset: Subset, threads: int = 1
) -> PlaceCovariances:
    """Covariances of the places of subsets, by their residuals and for white noise.

    centres : (n, 2) — whole pixels of the template; warp : (n, 2, 3 or 6) — results of correlation; NaN where not found
    """
    found = PlaceCovariances(np.full((len(centres), 2, 2), np.nan), np.full((len(centres), 2, 2), np.nan))
    half = subset.size // 2
    limits = np.array(reference.grey.shape[::-1]) - half
    inside = np.asarray((centres >= half) & (centres < limits)).all(axis=1)
    whole = np.flatnonzero(inside & all_finite(warp, 2))

    def compute(part: Index) -> None:
        found.residual[part], found.noise[part] = _inside(reference, target, centres[part], warp[part], subset)

    over(threads, compute, np.array_split(whole, max(1, len(whole) // _CHUNK)) if len(whole) else ())
    return found


def _inside(reference: Template, target: Spline, centres: Index, warp: Array, subset: Subset) -> PlaceCovariances:
    """The same for subsets that lie in the template and were found."""
    fit = residuals(reference, target, centres, warp, subset)
    f, weight = fit.f, fit.weight
    jacobian = _jacobian(fit, subset.size)
    for brightness in (np.ones_like(f), f):
        part = _weighted_mean(jacobian * brightness, weight) / _weighted_mean(brightness * brightness, weight)
        jacobian -= part[..., None] * brightness
    return _by_autocorrelation(jacobian, f, weight, fit.residual, _second_derivatives(fit, subset.size))


def _second_derivatives(fit: Residuals, size: int) -> Image:
    """Second derivatives of the grey levels, (n, 3, pixel)."""
    by_x, by_y = (part.reshape(-1, size, size) for part in (fit.by_x, fit.by_y))
    terms = np.stack([np.gradient(by_x, axis=2), np.gradient(by_x, axis=1), np.gradient(by_y, axis=1)], axis=1)
    return np.asarray(terms.reshape(len(by_x), 3, -1))


def _weighted_mean(values: Image, weight: Image) -> Image:
    """Weighted means over pixels, (..., n) of (..., n, pixel)."""
    return np.asarray((values * weight).sum(axis=-1) / np.maximum(weight.sum(axis=-1), 1e-12))


def _jacobian(fit: Residuals, size: int) -> Image:
    """Derivatives (term, n, pixel) of the grey levels by the coefficients of the warp, of x before those of y."""
    offset = (np.mgrid[:size, :size].reshape(2, -1) - size // 2) / (size // 2)
    eta, xi = offset.astype(np.float32)
    monomials = [np.ones_like(xi), xi, eta, xi * xi, xi * eta, eta * eta][: fit.terms]
    return np.asarray(np.stack([slope * part for slope in (fit.by_x, fit.by_y) for part in monomials]))


def _by_autocorrelation(jacobian: Image, f: Image, weight: Image, residual: Image, blur: Image) -> PlaceCovariances:
    """The covariances by the autocorrelation of the residuals.

    jacobian : (term, n, pixel); f, weight, residual : (n, pixel)
    blur : (n, 3, pixel) — what a change of sharpness leaves
    """
    terms = len(jacobian)
    by_point = np.moveaxis(jacobian, 0, 1)
    weighted = by_point * weight[:, None]
    inverse = _inverse(weighted @ np.swapaxes(by_point, -1, -2))
    kernel = np.asarray(inverse[:, [0, terms // 2]] @ weighted)
    noise = kernel @ np.swapaxes(kernel, -1, -2)
    left = blur - (blur @ np.swapaxes(weighted, -1, -2)) @ inverse @ by_point
    factors = _gain(left, weight) @ residual[..., None]
    shift = kernel @ np.swapaxes(blur, -1, -2) @ factors
    residual = residual - np.float32((np.swapaxes(factors, -1, -2) @ left)[:, 0])
    some = slice(None, None, _KERNEL_STRIDE)
    all_terms = np.concatenate([by_point, np.ones_like(f)[:, None], f[:, None]], axis=1)[some]
    fitted = _fitted_share(all_terms, _gain(all_terms, weight[some]))
    power = _weighted_mean(residual * residual, weight)
    spectrum = _spectrum(residual, weight, fitted) / max(float(power.mean()), 1e-12)
    growth = _in_units(_covariance(kernel[some], spectrum), noise[some]).mean(axis=0)
    scale = np.sqrt(np.diagonal(noise, axis1=1, axis2=2))
    by_power = power[:, None, None] * growth * scale[:, :, None] * scale[:, None]
    windows = _windows(int(np.sqrt(f.shape[-1])))
    loss = _fit_loss(kernel[some], by_point[some], weighted[some], inverse[some], windows, spectrum)
    in_windows = _CHANCE * loss * (((kernel * residual[:, None]) @ windows) ** 2).sum(axis=-1).mean(axis=0)
    share = np.sqrt(np.minimum(in_windows / np.maximum(np.diagonal(by_power.mean(axis=0)), 1e-300), 1.0))
    by_power = by_power * np.outer(share, share)
    return PlaceCovariances(by_power + shift @ np.swapaxes(shift, -1, -2), noise)


def _windows(size: int) -> Image:
    """Weights of the pixels of a subset in each window, (pixel, window)."""
    pixel, middle = np.arange(size), (np.arange(_WINDOWS) + 0.5) * size / _WINDOWS - 0.5
    band = np.exp(-0.5 * ((pixel[:, None] - middle) * _WINDOWS / size / _WINDOW_SIGMA) ** 2)
    return np.asarray(np.einsum("ia,jb->ijab", band, band).reshape(size**2, _WINDOWS**2), dtype=np.float32)


def _gain(left: Array | Image, weight: Image) -> Image:
    """Weights (n, k, pixel) of residuals in the factors of terms (n, k, pixel) that explain them best."""
    weighted = left * weight[:, None]
    return np.asarray(_inverse(weighted @ np.swapaxes(left, -1, -2)) @ weighted)


def _inverse(matrices: Array | Image) -> Image:
    """Pseudoinverses (n, k, k) of symmetric matrices."""
    return np.asarray(np.linalg.pinv(matrices.astype(np.float64), hermitian=True), dtype=np.float32)


def _in_units(covariance: Array, noise: Array) -> Array:
    """Covariances (n, 2, 2) in units of the standard deviations by others (n, 2, 2)."""
    scale = np.sqrt(np.diagonal(noise, axis1=1, axis2=2))
    return np.asarray(covariance / np.maximum(scale[:, :, None] * scale[:, None], 1e-300))


def _spectrum(residual: Image, weight: Image, fitted: Image) -> Array:
    """Power spectrum of residuals (n, pixel) before anything was fitted, the mean of all of them.

    fitted : share of the power that was taken, at each frequency
    """
    power = _summed_power(np.where(weight > 0.0, residual, 0.0)) / len(residual) / (1.0 - fitted)
    counts = weight > 0.0
    counted = counts[:1] if counts.all() else counts
    pairs = irfft2(_summed_power(counted) / len(counted))
    seldom = pairs < _MIN_PAIRS * pairs[0, 0]
    mean = np.where(seldom, 0.0, irfft2(power) / np.maximum(pairs, 1e-12))
    return np.asarray(rfft2(mean).real)


def _fitted_share(by_point: Image, gain: Image) -> Image:
    """Share of the power of white noise that a fit takes, at each frequency.

    by_point : (n, term, pixel) — J; gain : (n, term, pixel) — A, of which the coefficients are sums over the noise

    Of noise n the fit leaves n − Jᵀ A n, the power of which lacks 2 Re Ĵᵀ Â* − Ĵᵀ (A Aᵀ) Ĵ*.
    """
    slopes, gains = _transform(by_point), _transform(gain)
    across = gain @ np.swapaxes(gain, -1, -2)
    both = (across @ slopes.reshape(*slopes.shape[:2], -1)).reshape(slopes.shape)
    taken = (slopes * (2.0 * gains - both)).sum(axis=1).mean(axis=0)
    return np.asarray(np.clip((taken[..., 0] + taken[..., 1]) / by_point.shape[-1], 0.0, _MAX_TAKEN))


def _summed_power(values: Array | Image | Mask) -> Array:
    """Sum of the power spectra (row, col) of squares of pixels (..., pixel), as those of :func:`_transform`."""
    squares, side = _squares(values)
    total = np.zeros((side, side, 2), dtype=np.float32)
    for wave in _waves(squares, side):
        cv2.accumulateSquare(wave, total)
    return np.asarray(total[:, : side // 2 + 1].sum(axis=-1, dtype=np.float64))


def _transform(values: Array | Image) -> Image:
    """Fourier transforms (..., row, col, 2) of squares of pixels (..., pixel), as :func:`_waves`, without the columns
    that mirror others.
    """
    squares, side = _squares(values)
    waves = np.empty((len(squares), side, side // 2 + 1, 2), dtype=np.float32)
    for known, wave in zip(waves, _waves(squares, side), strict=True):
        known[...] = wave[:, : side // 2 + 1]
    return waves.reshape(*values.shape[:-1], *waves.shape[1:])


def _squares(values: Array | Image | Mask) -> tuple[Image, int]:
    """Squares (n, row, col) of pixels (..., pixel), and the side of squares twice as wide, or a little more [px]."""
    size = int(np.sqrt(values.shape[-1]))
    return np.asarray(values, dtype=np.float32).reshape(-1, size, size), 2 * int(cv2.getOptimalDFTSize(size))


def _waves(squares: Image, side: int) -> Iterator[Image]:
    """Fourier transforms (row, col, 2), real and imaginary parts, of squares (n, row, col) amid zeros."""
    size, square = squares.shape[-1], np.zeros((side, side), dtype=np.float32)
    for pixels in squares:
        square[:size, :size] = pixels
        yield np.asarray(cv2.dft(square, flags=cv2.DFT_COMPLEX_OUTPUT, nonzeroRows=size))


def _covariance(kernel: Image, spectrum: Array) -> Array:
    """Covariances (n, 2, 2) of sums with weights (n, 2, pixel) of values with a power spectrum."""
    waves = _transform(kernel)
    twice = np.full(spectrum.shape[-1], 2.0)
    twice[[0, -1]] = 1.0
    weighted = waves * (spectrum * twice)[..., None]
    products = np.einsum("naijk,nbijk->nab", waves, weighted)
    return np.asarray(products / len(spectrum) ** 2)


def _fit_loss(
    kernel: Image, by_point: Image, weighted: Image, inverse: Image, windows: Image, spectrum: Array
) -> Array:
    """Variances (2,) by residuals over the mean of their sandwich estimate: a warp was fitted, and windows are small.

    kernel : (n, 2, pixel); by_point, weighted : (n, term, pixel); inverse : (n, term, term)
    windows : (pixel, window); spectrum : of the autocorrelation of the residuals
    """
    total, kept = np.zeros(2), np.zeros(2)
    for k, axis in np.ndindex(kernel.shape[:2]):
        parts = kernel[k, axis] * windows.T
        seen = parts - ((parts @ by_point[k].T) @ inverse[k]) @ weighted[k]
        total[axis] += _summed_variance(kernel[k, axis], spectrum)
        kept[axis] += _summed_variance(seen, spectrum)
    return np.asarray(np.clip(total / np.maximum(kept, 1e-12), 1.0, _MAX_LOSS))


def _summed_variance(weights: Array | Image, spectrum: Array) -> float:
    """Sum of the variances of sums with weights (..., pixel) of values with an autocorrelation, given by its
    spectrum.
    """
    power = _summed_power(weights) * spectrum
    return float(2.0 * power.sum() - power[:, [0, -1]].sum()) / len(spectrum) ** 2
