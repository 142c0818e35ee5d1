"""Subsets whose grey levels fit no single motion: at a crack, a wire, a reflection, or the edge of a shadow.

A subset of two motions, or one across an edge of light, converges as well, but to a place between. Its residual exceeds
that of the other subsets. As a motion it amounts to m = √(2 (R − R₀) / S) pixels, for the variance R of the residual,
the usual variance R₀, and the mean square S of the pattern's slope. With two motions δ apart, and a share p of the
subset beyond the edge, the place is wrong by p δ, at most 2 m: as much only with the edge through the centre, for
affine and quadratic subsets alike.

How far it is wrong shows where parts of the subset are left out (:mod:`dicflow.core.correlation.uneven`): a residual
that is the same everywhere, as after a change of focus, moves nothing. Light that changes across a subset moves its
place too. How far follows from one more step of Gauss-Newton that fits slow changes of brightness and contrast beside
the warp.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Codes, Index, Mask
from dicflow.core.correlation.follow import Field
from dicflow.core.correlation.light import light_shift
from dicflow.core.correlation.subsets import Subset, residuals
from dicflow.core.correlation.template import Template
from dicflow.core.correlation.uneven import uneven_variance
from dicflow.core.photographs.interpolate import Spline
from dicflow.core.status import Status

__all__ = ["AT_EDGES", "Edges", "find_edges", "most_off", "residual_variance", "usual_residual"]


AT_EDGES = (Status.MISFIT, Status.UNEVEN_LIGHT, Status.DISCONTINUITY)
"""Reasons of points that are lost at edges."""
_SUSPECT_RATIO, _SUSPECT_MISFIT_PX = 1.2, 0.03
"""Variance of the residual over the usual one, and misfit, above which parts of a subset are left out."""
_USUAL_QUANTILE, _LEAST_QUANTILE, _SUSPECT_SPREAD = 0.25, 0.05, 2.5
"""Quantiles of the variance of the residual in a field, which a minority of disturbed subsets does not change, and how
many times their difference, or which power of their ratio, a subset must exceed the upper one to be unusual: large
residuals spread more upwards."""
_MOST_SPREAD = 1.3
"""Largest ratio of these quantiles that counts: more comes from places of different light."""
_LIGHT_RATIO, _LIGHT_MISFIT_PX = 2.3, 0.05
"""Variance of the residual over the usual one, and misfit, above which an unusual subset is tested for changes of the
light."""
_LOST_RATIO, _LOST_MISFIT_PX = 16.0, 0.5
"""The same above which a subset holds two motions. Undermatched waves of half a pixel reach 0.46 px on patterns of the
DIC Challenge, real specimens 10 times the usual variance."""
_LOST_SIGMA_PX = 1.0
"""Standard deviation by uneven residuals above which a point is lost."""
_LIGHT_LIMITS = ((0.06, 0.3), (0.15, 0.2))
"""Shifts of a place by slow changes of the light [px], and their shares of the residual, above which a point is lost:
above both of either pair. Smaller shifts with the first share add to the variance of the place."""
_MISFITS_OFF, _STANDARD_ERRORS = 4.0, 3.0
"""Misfits that a place between two motions is off at most: two, and twice as many for a pattern that is uneven within
the subset (coarse ones reach 4); and standard errors by which its residual may be too small by chance."""
_MIN_POINTS = 20
"""Points that fix the usual residual."""
_BLOCK = 16
"""Side of the squares of points that have a usual residual of their own."""
_CHUNK = 64
"""Subsets that are computed at once."""


class Edges(NamedTuple):
    """What the residuals of a grid of subsets (rows, cols) tell.

    reason : uint8 — MISFIT, UNEVEN_LIGHT or DISCONTINUITY where the point is lost for it, else VALID
    variance : further variance of the place along each axis [px²]; 0 where the residual is usual
    usual : variance of the residual of an undisturbed subset, the same for all [grey levels²]
    """

    reason: Codes
    variance: Array
    usual: float


def residual_variance(field: Field) -> Array:
    """Variance of the difference of template and target (rows, cols) [grey levels²]; NaN where not found."""
    return np.asarray(np.where(np.isfinite(field.warp[..., 0, 0]), field.znssd * field.texture[..., 0], np.nan))


def usual_residual(residual: Array) -> float:
    """The usual variance of the residual in a field [grey levels²]; infinite with too few points."""
    return _quantile(residual, _USUAL_QUANTILE, np.inf)


def find_edges(
    reference: Template, target: Spline, centres: Array, field: Field, subset: Subset, residual: Array, usual: float
) -> Edges:
    """Subsets of a grid at edges.

    centres : (rows, cols, 2) — whole pixels of the template; field : results of correlation there
    residual : (rows, cols) — variances (:func:`residual_variance`); usual : the variance elsewhere
        (:func:`usual_residual`) [grey levels²]
    """
    local = np.maximum(usual, _local_usual(residual))
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio, excess = residual / usual, np.maximum(residual - usual, 0.0)
        misfit = np.sqrt(2.0 * excess / field.texture[..., 1])
        unfit = (ratio > _LOST_RATIO) & (misfit > _LOST_MISFIT_PX)
        suspect = (residual / local > _unusual_ratio(residual / local)) & (misfit > _SUSPECT_MISFIT_PX) & ~unfit
        near_light = (ratio > _LIGHT_RATIO) & (misfit > _LIGHT_MISFIT_PX)
    by_noise = 0.5 * np.maximum(residual - local, 0.0) * (field.covariance[..., 0] + field.covariance[..., 2])
    variance, dazzled = np.where(suspect, by_noise, 0.0), np.zeros_like(unfit)
    for at in _chunks(suspect):
        fit = residuals(reference, target, centres[at].astype(np.int64), field.warp[at], subset)
        variance[at] = np.maximum(variance[at], uneven_variance(fit, subset.size))
        shift, share = light_shift(fit, near_light[at], subset.size)
        for max_shift, max_share in _LIGHT_LIMITS:
            dazzled[at] |= (shift > max_shift) & (share > max_share)
        variance[at] += np.where(share > _LIGHT_LIMITS[0][1], shift**2, 0.0)
    unfit |= (variance > _LOST_SIGMA_PX**2) & ~dazzled
    reason = np.where(unfit, Status.MISFIT, np.where(dazzled, Status.UNEVEN_LIGHT, Status.VALID)).astype(np.uint8)
    return Edges(reason, np.where(unfit | dazzled, 0.0, variance), usual)


def most_off(field: Field, at: tuple[Index, ...], usual: float, subset: Subset) -> Array:
    """What the places (n,) of points of a field may be off at most by two motions in their subsets [px].

    usual : variance of the residual elsewhere [grey levels²]
    """
    residual, slope = field.znssd[at] * field.texture[at][:, 0], field.warp[at][..., 1:3]
    excess = np.maximum(residual - usual, 0.0) + _STANDARD_ERRORS * np.sqrt(2.0) / subset.size * residual
    square = 0.5 * (slope**2).sum(axis=(-2, -1))
    area = slope[..., 0, 0] * slope[..., 1, 1] - slope[..., 0, 1] * slope[..., 1, 0]
    stretch = np.sqrt(square + np.sqrt(np.maximum(square**2 - area**2, 0.0)))
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(_MISFITS_OFF * stretch * np.sqrt(2.0 * excess / field.texture[at][:, 1]))


def _quantile(residual: Array, share: float, unknown: float) -> float:
    """A quantile of the variance of the residual; ``unknown`` with too few points."""
    known = residual[np.isfinite(residual)]
    return float(np.quantile(known, share)) if len(known) >= _MIN_POINTS else unknown


def _local_usual(residual: Array) -> Array:
    """The usual variance of the residual around each point (rows, cols); 0 where too few points tell.

    It changes over a photograph with focus, light and wear of the pattern, slowly in comparison with what disturbs.
    """
    rows, cols = residual.shape
    padded = np.pad(residual, ((0, -rows % _BLOCK), (0, -cols % _BLOCK)), constant_values=np.nan)
    blocks = padded.reshape(padded.shape[0] // _BLOCK, _BLOCK, -1, _BLOCK).swapaxes(1, 2)
    rising = np.sort(blocks.reshape(*blocks.shape[:2], -1), axis=-1)
    count = np.isfinite(rising).sum(axis=-1, keepdims=True)
    rank = np.rint(_USUAL_QUANTILE * np.maximum(count - 1, 0)).astype(np.int64)
    usual = np.where(count >= _MIN_POINTS, np.take_along_axis(rising, rank, axis=-1), 0.0)[..., 0]
    return np.asarray(cv2.resize(usual, padded.shape[::-1], interpolation=cv2.INTER_LINEAR)[:rows, :cols])


def _unusual_ratio(ratio: Array) -> float:
    """The ratio to the usual variance of the residual above which one is unusual in its field (rows, cols)."""
    low, least = (_quantile(ratio, share, 0.0) for share in (_USUAL_QUANTILE, _LEAST_QUANTILE))
    ratio_of_both = min(low / least, _MOST_SPREAD) if least > 0.0 else 1.0
    return max(_SUSPECT_RATIO, low + _SUSPECT_SPREAD * (low - least), float(low * ratio_of_both**_SUSPECT_SPREAD))


def _chunks(mask: Mask) -> Iterator[tuple[Index, ...]]:
    """Indices of the points of a mask, some at a time."""
    points = np.argwhere(mask)
    return (tuple(points[first : first + _CHUNK].T) for first in range(0, len(points), _CHUNK))
