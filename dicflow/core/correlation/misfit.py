"""Covariance of the places of subsets by their residuals, noise and misfit together.

Noise alone moves a subset by Σ k n, with k = H⁻¹ J, which has the covariance σ² Σ k kᵀ. Interpolation of a pattern that
is too sharp for the pixels, or a pattern that has changed, leaves residuals r that are correlated over a few pixels.
Their sums within blocks of pixels estimate the covariance for any such correlation, by

    Σ_b (Σ_{i∈b} kᵢ rᵢ)(Σ_{i∈b} kᵢ rᵢ)ᵀ

(White, Econometrica 48, 1980; for blocks, Liang and Zeger, Biometrika 73, 1986). Bell-shaped windows replace the blocks
here, because residuals that cancel between blocks, as after a change of contrast or focus, would count at sharp edges.
The sum is scaled by what it should be over what it is on average, for residuals with the autocorrelation that these
have: the parameters that were fitted take a part of them, and windows leave out what is correlated over more than their
side.

A pattern that is a little sharper in one photograph leaves second derivatives of the grey levels f, along one
direction more than along another after a stretch. These move no place: f_x f_xx, f_x f_xy and f_x f_yy are made of
derivatives, as of f_x² / 2, whose sums over a subset depend on its rim alone. Sums within windows would count, so that
this part is taken out of the residuals, and its sum over the subset, the shift that it makes, is counted instead.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.fft import irfft2, rfft2

from dicflow.core.arrays import Array, Index, Mask
from dicflow.core.correlation.residuals import Residuals, residuals
from dicflow.core.correlation.subsets import Subset
from dicflow.core.correlation.template import Template
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.tensors import upper_triangle
from dicflow.core.threads import over

__all__ = ["PlaceCovariances", "misfit_covariance", "place_covariances"]


_WINDOWS, _WINDOW_SIGMA = 5, 0.5
"""Windows along the side of a subset, and their standard deviation in distances of one from the next."""
_CHUNK = 64
"""Subsets that are computed at once."""
_MAX_SAMPLES = 250
"""Subsets of a field whose residuals are computed, about; those between them get the misfit of their neighbours."""
_LOSS_STRIDE, _MAX_LOSS, _MAX_TAKEN = 32, 5.0, 0.8
"""Every so many of these give the loss by the fit, which is much the same for all, and the largest that is made up
for; also of the power at a frequency."""
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


def misfit_covariance(
    reference: Template,
    target: Spline,
    centres: Array,
    warp: Array,
    subset: Subset,
    unit: Array,
    noise: Array,
    threads: int = 1,
) -> Array:
    """Covariance (rows, cols, 3) of the places of a grid of subsets by misfit beyond the noise [px² of the template].

    centres : (rows, cols, 2) — whole pixels of the template; warp : (rows, cols, 2, 3 or 6); NaN where not found
    unit : (rows, cols, 3) — covariance of the places for white noise of one grey level in one photograph
    noise : (rows, cols) — variance of the noise of both photographs [grey levels²]

    The misfit of sampled subsets holds for their neighbours in proportion to ``unit``. Twice its standard error is
    subtracted, so that chance alone rarely counts as misfit.
    """
    stride = max(1, int(np.ceil(np.sqrt(np.isfinite(warp[..., 0, 0]).sum() / _MAX_SAMPLES))))
    rows, cols = centres[::stride, ::stride].shape[:2]
    sampled = [part[::stride, ::stride].reshape(-1, *part.shape[2:]) for part in (centres, warp, noise)]
    whole_pixels = np.nan_to_num(sampled[0]).astype(np.int64)
    residual, white = place_covariances(reference, target, whole_pixels, sampled[1], subset, threads)
    scale = np.sqrt(np.diagonal(white, axis1=1, axis2=2))
    excess = (residual - sampled[2][:, None, None] * white) / (scale[:, :, None] * scale[:, None])
    doubled_error = 2.0 * _standard_error(excess)
    values, axes = np.linalg.eigh(_smooth(excess.reshape(rows, cols, 2, 2)) - doubled_error * np.eye(2))
    positive = upper_triangle((axes * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2))
    share = positive.repeat(stride, axis=0).repeat(stride, axis=1)[: centres.shape[0], : centres.shape[1]]
    x, y = np.sqrt(unit[..., 0]), np.sqrt(unit[..., 2])
    return np.asarray(share * np.stack([x * x, x * y, y * y], axis=-1))


def _standard_error(excess: Array) -> float:
    """Standard error of the mean of neighbours, from the scatter of samples (n, 2, 2); 0 where all are NaN."""
    if not np.isfinite(excess).any():
        return 0.0
    return float(np.nanstd(excess[:, [0, 1], [0, 1]]) / np.sqrt(4.0 * np.pi * _NEIGHBOUR_SIGMA**2))


def _smooth(values: Array) -> Array:
    """Means over neighbours on the grid (row, col, 2, 2); 0 where all are NaN."""
    known = np.asarray(np.isfinite(values).all(axis=(-2, -1)))
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
    whole = np.flatnonzero(inside & np.isfinite(warp).all(axis=(1, 2)))

    def compute(part: Index) -> None:
        found.residual[part], found.noise[part] = _inside(reference, target, centres[part], warp[part], subset)

    over(threads, compute, np.array_split(whole, max(1, len(whole) // _CHUNK)) if len(whole) else ())
    return found


def _inside(reference: Template, target: Spline, centres: Index, warp: Array, subset: Subset) -> PlaceCovariances:
    """The same for subsets that lie in the template and were found."""
    fit = residuals(reference, target, centres, warp, subset)
    f, residual, weight = (part.astype(np.float64) for part in (fit.f, fit.residual, fit.weight))
    jacobian = _jacobian(fit, subset.size)
    for brightness in (np.ones_like(f), f):
        part = _weighted_mean(jacobian * brightness, weight) / _weighted_mean(brightness * brightness, weight)
        jacobian = jacobian - part[..., None] * brightness
    return _sandwich(jacobian, weight, residual, _second_derivatives(fit, subset.size), _windows(subset.size))


def _second_derivatives(fit: Residuals, size: int) -> Array:
    """Second derivatives of the grey levels, (n, 3, pixel)."""
    by_x, by_y = (part.reshape(-1, size, size).astype(np.float64) for part in (fit.by_x, fit.by_y))
    terms = np.stack([np.gradient(by_x, axis=2), np.gradient(by_x, axis=1), np.gradient(by_y, axis=1)], axis=1)
    return np.asarray(terms.reshape(len(by_x), 3, -1))


def _weighted_mean(values: Array, weight: Array) -> Array:
    """Weighted means over pixels, (..., n) of (..., n, pixel)."""
    return np.asarray((values * weight).sum(axis=-1) / np.maximum(weight.sum(axis=-1), 1e-12))


def _jacobian(fit: Residuals, size: int) -> Array:
    """Derivatives (term, n, pixel) of the grey levels by the coefficients of the warp, of x before those of y."""
    eta, xi = (np.mgrid[:size, :size].reshape(2, -1) - size // 2) / (size // 2)
    monomials = [np.ones_like(xi), xi, eta, xi * xi, xi * eta, eta * eta][: fit.terms]
    return np.asarray(np.stack([slope * part for slope in (fit.by_x, fit.by_y) for part in monomials]))


def _windows(size: int) -> Array:
    """Weights of the pixels of a subset in each window, (pixel, window)."""
    pixel, middle = np.arange(size), (np.arange(_WINDOWS) + 0.5) * size / _WINDOWS - 0.5
    band = np.exp(-0.5 * ((pixel[:, None] - middle) * _WINDOWS / size / _WINDOW_SIGMA) ** 2)
    return np.asarray(np.einsum("ia,jb->ijab", band, band).reshape(size**2, _WINDOWS**2))


def _sandwich(jacobian: Array, weight: Array, residual: Array, blur: Array, windows: Array) -> PlaceCovariances:
    """The sandwich estimate of the covariances.

    jacobian : (term, n, pixel); weight, residual : (n, pixel); blur : (n, 3, pixel) — what a change of sharpness leaves
    windows : (pixel, window)
    """
    terms = len(jacobian)
    by_point = np.moveaxis(jacobian, 0, 1)
    weighted = by_point * weight[:, None]
    inverse = np.asarray(np.linalg.pinv(weighted @ np.swapaxes(by_point, -1, -2), hermitian=True), dtype=np.float64)
    kernel = np.asarray(inverse[:, [0, terms // 2]] @ weighted)
    noise = kernel @ np.swapaxes(kernel, -1, -2)
    left = blur - (blur @ np.swapaxes(weighted, -1, -2)) @ inverse @ by_point
    factors = _factors(left, weight, residual)
    shift = kernel @ np.swapaxes(blur, -1, -2) @ factors
    scores = (kernel * (residual[:, None] - np.swapaxes(factors, -1, -2) @ left)) @ windows
    by_residual = scores @ np.swapaxes(scores, -1, -2)
    unexplained = residual - (np.swapaxes(factors, -1, -2) @ left)[:, 0]
    sampled = slice(None, None, _LOSS_STRIDE)
    fits = (kernel[sampled], by_point[sampled], weighted[sampled], inverse[sampled])
    spectrum = _spectrum(unexplained, weight, _fitted_share(by_point[sampled], inverse[sampled] @ weighted[sampled]))
    loss = np.sqrt(_fit_loss(*fits, windows, spectrum))
    return PlaceCovariances(by_residual * np.outer(loss, loss) + shift @ np.swapaxes(shift, -1, -2), noise)


def _factors(left: Array, weight: Array, residual: Array) -> Array:
    """Factors (n, k, 1) of terms (n, k, pixel) that explain the residuals best."""
    weighted = left * weight[:, None]
    normal = np.asarray(np.linalg.pinv(weighted @ np.swapaxes(left, -1, -2), hermitian=True))
    return np.asarray(normal @ (weighted @ residual[..., None]))


def _spectrum(residual: Array, weight: Array, fitted: Array) -> Array:
    """Spectrum of the autocorrelation of residuals (n, pixel) before a warp was fitted, the same for all of them.

    fitted : share of the power that the warp has taken, at each frequency
    """
    power = _power(np.where(weight > 0.0, residual, 0.0)).mean(axis=0) / (1.0 - fitted)
    counts = weight > 0.0
    counted = (counts[:1] if counts.all() else counts).astype(np.float64)
    pairs = irfft2(_power(counted).mean(axis=0))
    seldom = pairs < _MIN_PAIRS * pairs[0, 0]
    mean = np.where(seldom, 0.0, irfft2(power) / np.maximum(pairs, 1e-12))
    return np.asarray(rfft2(mean / max(mean[0, 0], 1e-12)).real)


def _fitted_share(by_point: Array, gain: Array) -> Array:
    """Share of the power of white noise that the fit of a warp takes, at each frequency.

    by_point : (n, term, pixel) — J; gain : (n, term, pixel) — A, of which the coefficients are sums over the noise

    Of noise n the fit leaves n − Jᵀ A n, the power of which lacks 2 Re Ĵᵀ Â* − Ĵᵀ (A Aᵀ) Ĵ*.
    """
    slopes, gains = _transform(by_point), _transform(gain)
    both = np.einsum("nst,ntij->nsij", gain @ np.swapaxes(gain, -1, -2), slopes)
    taken = (slopes * (2.0 * gains - both).conj()).real.sum(axis=1).mean(axis=0)
    return np.asarray(np.clip(taken / by_point.shape[-1], 0.0, _MAX_TAKEN))


def _power(values: Array | Mask) -> Array:
    """Power spectra (..., row, col) of squares of pixels (..., pixel), amid zeros as wide as they are."""
    return np.asarray(np.abs(_transform(values)) ** 2)


def _transform(values: Array | Mask) -> Any:
    """Fourier transforms (..., row, col) of squares of pixels (..., pixel), amid zeros as wide as they are."""
    size = int(np.sqrt(values.shape[-1]))
    side = 2 * cv2.getOptimalDFTSize(size)
    return rfft2(values.reshape(*values.shape[:-1], size, size).astype(np.float32), s=(side, side))


def _fit_loss(
    kernel: Array, by_point: Array, weighted: Array, inverse: Array, windows: Array, spectrum: Array
) -> Array:
    """Variances (2,) by residuals over the mean of their sandwich estimate: a warp was fitted, and windows are small.

    kernel : (n, 2, pixel); by_point, weighted : (n, term, pixel); inverse : (n, term, term)
    windows : (pixel, window); spectrum : of the autocorrelation of the residuals
    """
    parts = kernel[:, :, None] * windows.T
    seen = parts - ((parts @ np.swapaxes(by_point, -1, -2)[:, None]) @ inverse[:, None]) @ weighted[:, None]
    total, kept = _variance(kernel, spectrum).mean(axis=0), _variance(seen, spectrum).sum(axis=-1).mean(axis=0)
    return np.asarray(np.clip(total / np.maximum(kept, 1e-12), 1.0, _MAX_LOSS))


def _variance(weights: Array, spectrum: Array) -> Array:
    """Variance (...) of sums with weights (..., pixel) of values with an autocorrelation, given by its spectrum."""
    power = _power(weights) * spectrum
    ends = power[..., [0, -1]].sum(axis=(-1, -2))
    return np.asarray((2.0 * power.sum(axis=(-1, -2)) - ends) / len(spectrum) ** 2)
