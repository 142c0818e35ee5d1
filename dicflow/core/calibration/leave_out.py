"""How a calibration changes when some of its pairs are left out.

The pairs are divided into folds, and the rig is adjusted again without each. The spread of those rigs (the grouped
jackknife, Tukey 1958) needs no model of the errors, so it also includes errors that a covariance from independent
noise misses: bent boards, motion, a lens that the model does not fit. The marks of the pairs left out, triangulated
with a rig that was estimated without them, give known distances to compare with.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.calibration.bundle import Bundle, LensModel, adjust
from dicflow.core.calibration.robust import Loss
from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.rig_parameters import KEY_FIGURES, key_figures
from dicflow.core.cameras.triangulate import triangulate

__all__ = ["LeaveOut", "leave_out", "reconstructed_scale"]


_MAX_FOLDS = 10
_MIN_MARKS = 3


class LeaveOut(NamedTuple):
    """Results of calibrations without some of the pairs.

    spread : (6,) — standard deviations of the rig's :func:`~dicflow.core.cameras.rig_parameters.key_figures`
    scale : (n,) — size of each pair's target, reconstructed with the rig estimated without the pair, over its true
        size [-]; NaN where both cameras see fewer than three common marks
    """

    spread: Array
    scale: Array


def leave_out(bundle: Bundle, board: Array, left: Array, right: Array, model: LensModel, loss: Loss) -> LeaveOut:
    """Leave each fold of pairs out of an adjusted bundle in turn; up to 10 pairs each is a fold, more share 10 folds.

    board : (m, 3) [mm]; left, right : (n, m, 2) [px], as in :func:`~dicflow.core.calibration.bundle.residuals`
    """
    pairs = len(left)
    folds = min(pairs, _MAX_FOLDS)
    fold_figures, scale = np.empty((folds, len(KEY_FIGURES))), np.empty(pairs)
    for fold in range(folds):
        kept = np.arange(pairs) % folds != fold
        start = Bundle(bundle.rig, bundle.rotations[kept], bundle.translations[kept])
        rig = adjust(start, board, left[kept], right[kept], model, loss).rig
        fold_figures[fold] = key_figures(rig)
        scale[~kept] = reconstructed_scale(rig, board, left[~kept], right[~kept])
    spread = np.sqrt((folds - 1) / folds * np.sum((fold_figures - fold_figures.mean(axis=0)) ** 2, axis=0))
    return LeaveOut(spread, scale)


def reconstructed_scale(rig: Rig, board: Array, left: Array, right: Array) -> Array:
    """Size of targets from triangulated marks, over their true size.

    The scale of the similarity that maps the target onto the reconstructed marks best (Umeyama 1991). All distances
    contribute to it, and noise across the target does not increase it, as it increases short distances.

    board : (m, 3) [mm]; left, right : (n, m, 2) [px], NaN where not seen
    Returns (n,) [-].
    """
    return np.array([_scale(board, points) for points in triangulate(rig, left, right).xyz])


def _scale(board: Array, points: Array) -> float:
    """Scale from marks (m, 3) of the target to points (m, 3) in space [-]; NaN with fewer than three."""
    seen = np.isfinite(points).all(axis=-1)
    if np.count_nonzero(seen) < _MIN_MARKS:
        return np.nan
    true, found = board[seen] - board[seen].mean(axis=0), points[seen] - points[seen].mean(axis=0)
    return float(np.linalg.svd(found.T @ true, compute_uv=False).sum() / np.sum(true**2))
