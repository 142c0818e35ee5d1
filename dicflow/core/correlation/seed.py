"""Starting warps without the user: where the subsets of one image lie in another, to a few pixels.

Each connected part of the grid finds its own way. What may tell its motion is asked in turn, and the first that the
grey levels bear out is taken: matches of features; that nothing moved; cross-correlation of the part as a whole;
features found here that have an orientation of their own; cross-correlation of many windows. From scattered places
motion is carried to the grid by moving least squares, which tells its gradient too.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any, NamedTuple

import cv2
import numpy as np
import numpy.typing as npt
from scipy.ndimage import label
from scipy.spatial import cKDTree

from dicflow.core.arrays import Array, Mask
from dicflow.core.correlation.warp import apply_warp, identity, warp_from_gradient
from dicflow.core.matching.features import detect
from dicflow.core.matching.fft_search import fft_matches
from dicflow.core.matching.pairs import agreeing, guided_matches, local_motion, match_features

__all__ = ["Pairs", "agreement", "feature_pairs", "islands", "seed_warps"]


FEW = 6  # pairs below which they tell nothing
CELL_PX = 12.0  # pairs nearer to each other than this would tell a gradient with more noise than one of them
REACH = 2.0  # a pair tells the motion as far as this times the distance of the neighbours that its own rests on
SAMPLES = 150  # points of a part whose grey levels are looked at
HALF_PX = 15  # half the side of the windows that are looked at [px]
BLUR_PX = 1.5  # smoothing before, so that a start that is off by a pixel or two still shows
ACCEPTED, POSSIBLE = 0.6, 0.3  # median correlation of those windows that settles it, and the least that is taken
BORDER_PX = 64  # around the region where its features may have an effect [px]


class Pairs(NamedTuple):
    """Places in a reference image and in a target image that show the same, (n, 2) each [px]."""

    source: Array
    target: Array


def seed_warps(
    reference: npt.NDArray[Any], target: npt.NDArray[Any], points: Array, matches: Pairs | None = None
) -> Array:
    """Affine warps of the subsets around points of a grid, to start correlation from.

    reference, target : (rows, cols) grey
    points : (i, j, 2) — places in the reference, about regular there or once so [px]; NaN where there is none
    matches : pairs of features that are known already, with false ones among them
    Returns (i, j, 2, 3); NaN where nothing is known.
    """
    warps = np.full((*points.shape, 3), np.nan)
    parts = islands(points)
    late = _Late(partial(feature_pairs, reference, target, points))
    images = np.asarray(reference, dtype=np.float32), np.asarray(target, dtype=np.float32)
    blurred = cv2.GaussianBlur(images[0], (0, 0), BLUR_PX), cv2.GaussianBlur(images[1], (0, 0), BLUR_PX)
    for part in range(1, parts.max(initial=0) + 1):
        mine = parts == part
        best = POSSIBLE
        for guess in _guesses(*images, points, mine, matches, late):
            score = agreement(*blurred, points[mine], guess)
            if score > best:
                best, warps[mine] = score, guess
            if best >= ACCEPTED:
                break
    return warps


class _Late:
    """Something that is worked out once, when it is first asked for."""

    def __init__(self, work: Callable[[], Pairs]) -> None:
        self._work = work
        self._done: Pairs | None = None

    def __call__(self) -> Pairs:
        if self._done is None:
            self._done = self._work()
        return self._done


def _guesses(
    reference: npt.NDArray[Any],
    target: npt.NDArray[Any],
    points: Array,
    mine: Mask,
    matches: Pairs | None,
    features: Callable[[], Pairs],
) -> Iterator[Array]:
    """Warps (n, 2, 3) of the points of one part, one source after the other."""
    centres = points[mine]
    if matches is not None:
        yield _carried(_near(matches, points, mine), centres)
    yield identity(centres)
    footprint = _footprint(points, mine, reference.shape)
    yield _carried(Pairs(*fft_matches(reference, target, footprint)), centres)
    yield _carried(_near(features(), points, mine), centres)
    yield _carried(Pairs(*fft_matches(reference, target, footprint, in_pieces=True)), centres)


def islands(points: Array) -> npt.NDArray[np.int32]:
    """Connected parts of a grid (i, j, 2), numbered from 1; 0 where it has no point."""
    numbered: npt.NDArray[np.int32] = label(np.isfinite(points).all(axis=-1), structure=np.ones((3, 3)))[0]
    return numbered


def agreement(reference: npt.NDArray[Any], target: npt.NDArray[Any], centres: Array, warps: Array) -> float:
    """Median correlation of small windows around points with where warps put them, −1 … 1; −1 where none can be seen.

    centres : (n, 2) [px]; warps : (n, 2, 3) — NaN where unknown

    A few points, evenly chosen, are looked at.
    """
    known = np.flatnonzero(np.isfinite(warps).all(axis=(1, 2)))
    chosen = known[np.linspace(0, len(known) - 1, min(SAMPLES, len(known))).astype(int)]
    if len(chosen) == 0:
        return -1.0
    side = np.arange(-HALF_PX, HALF_PX + 1.0)
    offsets = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    at = apply_warp(warps[chosen][:, None], offsets)
    f, g = _sampled(reference, centres[chosen][:, None] + offsets), _sampled(target, at)
    seen = np.isfinite(f) & np.isfinite(g)
    enough = seen.mean(axis=1) >= 0.5
    if enough.mean() < 0.1:
        return -1.0
    return float(np.median(_correlation(f[enough], g[enough], seen[enough])))


def _correlation(f: Array, g: Array, seen: Mask) -> Array:
    """Zero-mean normalised cross-correlation of rows over what is seen; 0 of a flat one."""
    count = seen.sum(axis=1, keepdims=True)
    f, g = (np.where(seen, v - np.where(seen, v, 0.0).sum(axis=1, keepdims=True) / count, 0.0) for v in (f, g))
    size = np.sqrt((f * f).sum(axis=1) * (g * g).sum(axis=1))
    return np.asarray((f * g).sum(axis=1) / np.where(size > 0.0, size, 1.0))


def _sampled(image: npt.NDArray[Any], places: Array) -> Array:
    """Grey levels at places (..., 2), bilinear; NaN outside."""
    grey, at = image.astype(np.float32, copy=False), places.astype(np.float32)
    value = cv2.remap(grey, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan,))
    return np.asarray(value, dtype=np.float64)


def _near(pairs: Pairs, points: Array, mine: Mask) -> Pairs:
    """The pairs that belong to one part of the grid, without the false ones."""
    source, target = pairs
    everywhere = np.isfinite(points).all(axis=-1)
    if len(source) == 0:
        return pairs
    distance, nearest = cKDTree(points[everywhere]).query(source)
    here = mine[everywhere][nearest] & (distance <= 2.0 * _spacing(points))
    source, target = source[here], target[here]
    keep = agreeing(source, target)
    return Pairs(source[keep], target[keep])


def _carried(pairs: Pairs, centres: Array) -> Array:
    """Warps (n, 2, 3) around the centres (n, 2), from the pairs around them; NaN where these are too far away."""
    _, apart = np.unique(np.floor(pairs.source / CELL_PX), axis=0, return_index=True)
    pairs = Pairs(pairs.source[apart], pairs.target[apart])
    if len(pairs.source) < FEW:
        return np.full((len(centres), 2, 3), np.nan)
    warps = warp_from_gradient(*local_motion(*pairs, centres))
    tree = cKDTree(pairs.source)
    among = min(len(pairs.source), 24)
    usual = float(np.median(tree.query(pairs.source, k=[among])[0]))
    warps[tree.query(centres)[0] > REACH * usual] = np.nan
    return warps


def _spacing(points: Array) -> float:
    """The usual distance of neighbours on a grid [px]."""
    steps = [np.linalg.norm(np.diff(points, axis=axis), axis=-1).ravel() for axis in (0, 1)]
    known = np.concatenate(steps)
    known = known[np.isfinite(known)]
    return float(np.median(known)) if len(known) else float(HALF_PX)


def _footprint(points: Array, mine: Mask, shape: tuple[int, ...]) -> Mask:
    """Pixels of an image that one part of the grid covers."""
    covered = np.zeros(shape, dtype=np.uint8)
    spacing = max(1, int(np.ceil(_spacing(points))))
    x, y = np.rint(points[mine]).astype(int).T
    inside = (x >= 0) & (x < shape[1]) & (y >= 0) & (y < shape[0])
    covered[y[inside], x[inside]] = 1
    return np.asarray(cv2.dilate(covered, np.ones((2 * spacing + 1,) * 2, dtype=np.uint8)) > 0)


def feature_pairs(reference: npt.NDArray[Any], target: npt.NDArray[Any], points: Array) -> Pairs:
    """Matched features with orientations of their own, around points (i, j, 2), with false ones among them.

    SIFT: Lowe, Int. J. Computer Vision 60, 2004.
    """
    known = points[np.isfinite(points).all(axis=-1)]
    low, high = known.min(axis=0) - BORDER_PX, known.max(axis=0) + BORDER_PX
    corner, end = np.maximum(low, 0).astype(int), np.minimum(high, reference.shape[::-1]).astype(int)
    if (end <= corner).any():
        return Pairs(np.zeros((0, 2)), np.zeros((0, 2)))
    box = int(corner[0]), int(corner[1]), int(end[0]), int(end[1])
    before, after = detect(reference, "SIFT", box=box, upright=False), detect(target, "SIFT", upright=False)
    found = match_features(before, after)
    source, moved = before.xy[found[:, 0]].astype(float), after.xy[found[:, 1]].astype(float)
    keep = agreeing(source, moved)
    if keep.sum() >= FEW:
        predicted = local_motion(source[keep], moved[keep], before.xy.astype(float)).position
        found = guided_matches(before, after, predicted)
        source, moved = before.xy[found[:, 0]].astype(float), after.xy[found[:, 1]].astype(float)
    return Pairs(source, moved)
