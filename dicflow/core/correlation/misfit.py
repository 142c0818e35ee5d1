"""How far subsets are moved by what their grey levels differ by, whatever its cause.

Noise alone moves a subset by Σ k n, with k = H⁻¹ J, which has the covariance σ² Σ k kᵀ. Interpolation of a pattern that
is too sharp for the pixels, or a pattern that has changed, leaves residuals r that are alike over a few pixels. Their
sums within blocks of pixels estimate the covariance without knowing how alike they are, by

    Σ_b (Σ_{i∈b} kᵢ rᵢ)(Σ_{i∈b} kᵢ rᵢ)ᵀ

(White, Econometrica 48, 1980; for blocks, Liang and Zeger, Biometrika 73, 1986). Here bell-shaped windows stand for the
blocks, at whose sharp edges there would remain what cancels between them, as of a change of contrast or focus, and the
sum is scaled so that white noise gives its own covariance in spite of the parameters that were fitted.
"""

from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Index
from dicflow.core.correlation.subsets import Subset, Template
from dicflow.core.correlation.warp import TERMS, apply_warp
from dicflow.core.photographs.interpolate import Spline, interpolate
from dicflow.core.tensors import upper

__all__ = ["Moved", "misfit_covariance", "moved_by_residuals"]


_WINDOWS, _WIDTH = 5, 0.5
"""Windows along the side of a subset, and their standard deviation in distances of one from the next."""
_CHUNK = 64
_SAMPLES = 250
"""Subsets of a field that are looked at; those between them are taken to be like their neighbours."""
_FEW = 4
"""Every so many of these tell what the fit takes from the sums, which is much the same for all."""
_AROUND = 2.5
"""Standard deviation of the weights of neighbouring samples [samples]: one of them alone says too little."""


class Moved(NamedTuple):
    """Covariances (n, 2, 2) of the places of subsets, in pixels of the template; NaN where there is no value.

    residual : as the residuals tell [px²]; noise : for white noise of one grey level [px² per grey level²]
    """

    residual: Array
    noise: Array


def misfit_covariance(
    reference: Template, target: Spline, centres: Array, warp: Array, subset: Subset, unit: Array, noise: Array
) -> Array:
    """Covariance (rows, cols, 3) of the places of a grid of subsets by what is not noise [px² of the template].

    centres : (rows, cols, 2) — whole pixels of the template; warp : (rows, cols, 2, 3 or 6); NaN where not found
    unit : (rows, cols, 3) — covariance of the places for white noise of one grey level in one photograph
    noise : (rows, cols) — variance of the noise of both photographs [grey levels²]

    What some subsets show holds for their neighbours in proportion to ``unit``, less twice its standard error: what
    chance alone may show is no misfit.
    """
    stride = max(1, int(np.ceil(np.sqrt(np.isfinite(warp[..., 0, 0]).sum() / _SAMPLES))))
    rows, cols = centres[::stride, ::stride].shape[:2]
    some = [part[::stride, ::stride].reshape(-1, *part.shape[2:]) for part in (centres, warp, noise)]
    moved = moved_by_residuals(reference, target, np.nan_to_num(some[0]).astype(np.int64), some[1], subset)
    scale = np.sqrt(np.diagonal(moved.noise, axis1=1, axis2=2))
    more = (moved.residual - some[2][:, None, None] * moved.noise) / (scale[:, :, None] * scale[:, None])
    doubt = np.nanstd(more[:, [0, 1], [0, 1]]) / np.sqrt(4.0 * np.pi * _AROUND**2) if np.isfinite(more).any() else 0.0
    values, axes = np.linalg.eigh(_smooth(more.reshape(rows, cols, 2, 2)) - 2.0 * doubt * np.eye(2))
    positive = upper((axes * np.maximum(values, 0.0)[..., None, :]) @ np.swapaxes(axes, -1, -2))
    share = positive.repeat(stride, axis=0).repeat(stride, axis=1)[: centres.shape[0], : centres.shape[1]]
    x, y = np.sqrt(unit[..., 0]), np.sqrt(unit[..., 2])
    return np.asarray(share * np.stack([x * x, x * y, y * y], axis=-1))


def _smooth(values: Array) -> Array:
    """Means over neighbours on the grid (row, col, 2, 2); 0 where there are none."""
    known = np.asarray(np.isfinite(values).all(axis=(-2, -1)))
    share, total = (
        cv2.GaussianBlur(part, (0, 0), _AROUND, borderType=cv2.BORDER_CONSTANT)
        for part in (known.astype(np.float64), np.where(known[..., None, None], values, 0.0).reshape(*known.shape, 4))
    )
    mean = np.where(share[..., None] > 1e-6, total / np.maximum(share[..., None], 1e-6), 0.0)
    return np.asarray(mean.reshape(values.shape))


def moved_by_residuals(reference: Template, target: Spline, centres: Index, warp: Array, subset: Subset) -> Moved:
    """What the residuals of subsets say about their places.

    centres : (n, 2) — whole pixels of the template; warp : (n, 2, 3 or 6) — as correlation found them
    """
    found = Moved(np.full((len(centres), 2, 2), np.nan), np.full((len(centres), 2, 2), np.nan))
    half = subset.size // 2
    limits = np.array(reference.grey.shape[::-1]) - half
    inside = np.asarray((centres >= half) & (centres < limits)).all(axis=1)
    whole = np.flatnonzero(inside & np.isfinite(warp).all(axis=(1, 2)))
    for part in np.array_split(whole, max(1, len(whole) // _CHUNK)) if len(whole) else ():
        found.residual[part], found.noise[part] = _moved(reference, target, centres[part], warp[part], subset)
    return found


def _moved(reference: Template, target: Spline, centres: Index, warp: Array, subset: Subset) -> Moved:
    """The same for subsets that lie in the image."""
    axis = np.arange(subset.size) - subset.size // 2
    offsets = np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    x, y = np.moveaxis(centres[:, None] + offsets, -1, 0)
    f, by_x, by_y, weight = (part[y, x].astype(np.float64) for part in reference[:4])
    g = np.nan_to_num(interpolate(target, apply_warp(warp[:, None], offsets)).astype(np.float64))
    if subset.gaussian > 0.0:
        weight = weight * np.exp(-0.5 * (offsets**2).sum(axis=1) / subset.gaussian**2)
    f, g = (part - _mean(part, weight)[:, None] for part in (f, g))
    residual = f - g * np.sqrt(_mean(f * f, weight) / np.maximum(_mean(g * g, weight), 1e-12))[:, None]
    jacobian = _jacobian(by_x, by_y, offsets / (subset.size // 2), TERMS[subset.shape_function])
    for light in (np.ones_like(f), f):
        part = _mean(jacobian * light, weight) / _mean(light * light, weight)
        jacobian = jacobian - part[..., None] * light
    return _sandwich(jacobian, weight, residual, _windows(subset.size))


def _mean(values: Array, weight: Array) -> Array:
    """Weighted means over pixels, (..., n) of (..., n, pixel)."""
    return np.asarray((values * weight).sum(axis=-1) / np.maximum(weight.sum(axis=-1), 1e-12))


def _jacobian(by_x: Array, by_y: Array, offsets: Array, terms: int) -> Array:
    """Derivatives (term, n, pixel) of the grey levels by the coefficients of the warp, of x before those of y."""
    xi, eta = offsets.T
    monomials = [np.ones_like(xi), xi, eta, xi * xi, xi * eta, eta * eta][:terms]
    return np.asarray(np.stack([slope * part for slope in (by_x, by_y) for part in monomials]))


def _windows(size: int) -> Array:
    """Weights of the pixels of a subset in each window, (pixel, window)."""
    pixel, middle = np.arange(size), (np.arange(_WINDOWS) + 0.5) * size / _WINDOWS - 0.5
    band = np.exp(-0.5 * ((pixel[:, None] - middle) * _WINDOWS / size / _WIDTH) ** 2)
    return np.asarray(np.einsum("ia,jb->ijab", band, band).reshape(size**2, _WINDOWS**2))


def _sandwich(jacobian: Array, weight: Array, residual: Array, windows: Array) -> Moved:
    terms = len(jacobian)
    by_point = np.moveaxis(jacobian, 0, 1)
    weighted = by_point * weight[:, None]
    inverse = np.asarray(np.linalg.pinv(weighted @ np.swapaxes(by_point, -1, -2), hermitian=True), dtype=np.float64)
    kernel = np.asarray(inverse[:, [0, terms // 2]] @ weighted)
    noise = kernel @ np.swapaxes(kernel, -1, -2)
    scores = (kernel * residual[:, None]) @ windows
    found = scores @ np.swapaxes(scores, -1, -2)
    some = slice(None, None, _FEW)
    lost = _lost(kernel[some], by_point[some], weighted[some], inverse[some], windows)
    return Moved(found * np.median(lost), noise)


def _lost(kernel: Array, by_point: Array, weighted: Array, inverse: Array, windows: Array) -> Array:
    """By how much (n,) the products fall short of the covariance of white noise because a warp was fitted."""
    middle = inverse @ (weighted @ np.swapaxes(weighted, -1, -2)) @ inverse
    total, kept = (kernel * kernel).sum(axis=(1, 2)), np.zeros(len(kernel))
    for window in windows.T:
        own = kernel * window
        moved = own @ np.swapaxes(by_point, -1, -2)
        both = own @ np.swapaxes(weighted, -1, -2) @ inverse
        whole = (own * own).sum(axis=(1, 2))
        kept += whole - 2.0 * (both * moved).sum(axis=(1, 2)) + ((moved @ middle) * moved).sum(axis=(1, 2))
    return np.asarray(total / np.maximum(kept, 1e-3 * total))
