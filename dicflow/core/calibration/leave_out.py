"""What a calibration rests on: how it changes when some of its pairs are left out.

The pairs are dealt into folds; the rig is solved again without each. The spread of those rigs (the grouped jackknife,
Tukey 1958) needs no model of the errors, so it also shows what a covariance from independent noise cannot: bent
boards, motion, a lens that the model does not fit. The marks of the pairs left out, reconstructed with a rig that has
never seen them, measure known distances.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from dicflow.core.arrays import Array
from dicflow.core.calibration.bundle import Bundle, Model, adjust
from dicflow.core.calibration.robust import Loss
from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.rig_parameters import FIGURES, figures
from dicflow.core.cameras.triangulate import triangulate

__all__ = ["LeaveOut", "leave_out", "reconstructed_scale"]


_MOST_FOLDS = 10
_LEAST_MARKS = 3


class LeaveOut(NamedTuple):
    """What the rigs without some of the pairs say.

    spread : (6,) — standard deviations of the rig's :func:`~dicflow.core.cameras.rig_parameters.figures`
    scale : (n,) — size of each pair's target, reconstructed with the rig that has not seen the pair, over its true
        size [-]; NaN where fewer than three marks are seen by both cameras
    """

    spread: Array
    scale: Array


def leave_out(bundle: Bundle, board: Array, left: Array, right: Array, model: Model, loss: Loss) -> LeaveOut:
    """Leave each fold of pairs out of an adjusted bundle in turn: every pair is a fold, or, of many pairs, every tenth.

    board : (m, 3) [mm]; left, right : (n, m, 2) [px], as in :func:`~dicflow.core.calibration.bundle.residuals`
    """
    pairs = len(left)
    folds = min(pairs, _MOST_FOLDS)
    found, scale = np.empty((folds, len(FIGURES))), np.empty(pairs)
    for fold in range(folds):
        kept = np.arange(pairs) % folds != fold
        start = Bundle(bundle.rig, bundle.rotations[kept], bundle.translations[kept])
        rig = adjust(start, board, left[kept], right[kept], model, loss).rig
        found[fold] = figures(rig)
        scale[~kept] = reconstructed_scale(rig, board, left[~kept], right[~kept])
    spread = np.sqrt((folds - 1) / folds * np.sum((found - found.mean(axis=0)) ** 2, axis=0))
    return LeaveOut(spread, scale)


def reconstructed_scale(rig: Rig, board: Array, left: Array, right: Array) -> Array:
    """Size of targets that both cameras see, over their true size, from triangulated marks.

    The scale of the similarity that carries the target onto the reconstructed marks best (Umeyama 1991): to it all
    distances contribute, and noise across the target does not lengthen it, as it lengthens short distances.

    board : (m, 3) [mm]; left, right : (n, m, 2) [px], NaN where not seen
    Returns (n,) [-].
    """
    return np.array([_scale(board, points) for points in triangulate(rig, left, right).xyz])


def _scale(board: Array, points: Array) -> float:
    seen = np.isfinite(points).all(axis=-1)
    if np.count_nonzero(seen) < _LEAST_MARKS:
        return np.nan
    true, found = board[seen] - board[seen].mean(axis=0), points[seen] - points[seen].mean(axis=0)
    return float(np.linalg.svd(found.T @ true, compute_uv=False).sum() / np.sum(true**2))
