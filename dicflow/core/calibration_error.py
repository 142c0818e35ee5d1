"""What the calibration's uncertainty does to displacement and strain.

The rig's error is one for all points and steps: a few independent modes, each of which moves every point in its own way
(:func:`dicflow.core.rig_uncertainty.point_sensitivity`). Displacement sees the difference of a point's motion between
two states, and strain how the motion varies from point to point.
"""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import ArrayLike, NDArray

__all__ = ["error_modes", "mode_displacement_sigma", "mode_gradient_covariance", "spread_out", "thinned"]

Array = NDArray[np.float64]

_NEGLIGIBLE = 1e-9
_ENOUGH_POINTS = 2000
_FEWEST_ACROSS = 12


def error_modes(covariance: ArrayLike) -> Array:
    """Independent errors of unit variance behind a covariance C (p, p): M (p, m) with M Mᵀ = C."""
    full = np.asarray(covariance, dtype=np.float64)
    scale = np.sqrt(np.diagonal(full))
    units = np.where(scale > 0.0, scale, 1.0)
    strengths, directions = np.linalg.eigh(full / np.outer(units, units))
    kept = strengths > _NEGLIGIBLE
    return np.asarray(scale[:, None] * directions[:, kept] * np.sqrt(strengths[kept]))


def mode_displacement_sigma(deformed: Array, reference: Array) -> Array:
    """σ (..., 3) of the displacement.

    deformed, reference : (..., 3, m) — motion of the points in both states by each mode [mm]
    """
    return np.asarray(np.linalg.norm(deformed - reference, axis=-1))


def mode_gradient_covariance(deformed: Array, reference: Array, response: Array, stride: int = 1) -> Array:
    """Covariance (row, col, 4, 4) of the deformation gradient.

    deformed, reference : (row, col, 3, m) — as above, on the grid or on every ``stride``-th of its rows and columns
    response : (row, col, 4, 2, 6) — there, to slopes per step of the whole grid;
        :class:`~dicflow.core.deformation_gradient.SurfaceGradient` has it
    """
    both = np.concatenate([deformed, reference], axis=2)
    slopes = np.stack([_slope(both, axis) for axis in (1, 0)], axis=-1) / stride
    change = np.einsum("...fai,...ima->...fm", response, slopes, optimize=True)
    return np.asarray(change @ np.swapaxes(change, -1, -2))


def thinned(shape: tuple[int, int]) -> tuple[slice, slice]:
    """Rows and columns of a grid that show a field as smooth as the calibration's share."""
    stride = min(int(np.sqrt(shape[0] * shape[1] / _ENOUGH_POINTS)), min(shape) // _FEWEST_ACROSS)
    part = slice(max(stride, 1) // 2, None, max(stride, 1))
    return part, part


def spread_out(field: Array, shape: tuple[int, int]) -> Array:
    """A field on the thinned grid (row, col) on the whole one: at each point the nearest value there is."""
    stride = thinned(shape)[0].step
    known = np.isfinite(field)
    if not known.any():
        return np.full(shape, np.nan)
    label = cv2.distanceTransformWithLabels(
        (~known).astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_5, labelType=cv2.DIST_LABEL_PIXEL
    )[1]
    values = np.full(int(label.max()) + 1, np.nan)
    values[label[known]] = field[known]
    whole = values[label].repeat(stride, axis=0).repeat(stride, axis=1)
    beyond = [(0, max(0, full - size)) for full, size in zip(shape, whole.shape, strict=True)]
    return np.asarray(np.pad(whole, beyond, mode="edge")[: shape[0], : shape[1]])


def _slope(field: Array, axis: int) -> Array:
    """Slope of a field along an axis of the grid: the mean difference to both neighbours, or to the one there is."""
    gap = np.full_like(np.take(field, [0], axis=axis), np.nan)
    steps = np.diff(field, axis=axis)
    before, after = np.concatenate([gap, steps], axis=axis), np.concatenate([steps, gap], axis=axis)
    single = np.where(np.isnan(before), after, before)
    return np.asarray(np.where(np.isnan(before + after), single, 0.5 * (before + after)))
