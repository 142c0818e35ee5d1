"""Automatic starting warps: where the subsets of a reference photograph lie in a target, to a few pixels.

Each connected part of the grid is treated alone. Sources of its motion are tried in turn, and the first that the grey
levels confirm is taken: feature matches of an earlier stage; no motion; cross-correlation of the part as a whole;
cross-correlation of many windows; features detected here, one way after another. Moving least squares interpolate the
motion, and its gradient, from scattered places to the grid.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import partial
from itertools import islice

import cv2
import numpy as np

from dicflow.core.arrays import Array, Grey, Index, Mask, all_finite
from dicflow.core.correlation.feature_pairs import MIN_PAIRS, FeatureSearch, Pairs, feature_pairs
from dicflow.core.correlation.warp import apply_warp, identity, recentred, warp_from_gradient
from dicflow.core.matching.fft_search import fft_matches
from dicflow.core.matching.pairs import agreeing_matches, local_motion
from dicflow.core.nearest import nearest
from dicflow.core.parts import Parts, islands
from dicflow.core.threads import over

__all__ = ["Pairs", "epipolar_pairs", "feature_pairs", "seed_warps", "window_correlation", "window_correlations"]


CELL_PX = 12.0
"""Side of the cells of which each keeps one pair: close pairs give noisy gradients [px]."""
SHARE_OF_DISTANCE = 0.2
"""Side of larger cells, whose subsets share a motion, over the distance of pairs: between these it is not known."""
MAX_REACH = 2.0
"""Largest distance of a point from a pair, over the usual distance of a pair from its farthest neighbour in use."""
SAMPLED_POINTS = 150
"""Points of a part whose grey levels are compared."""
HALF_WINDOW_PX = 15
"""Half the side of the windows that are compared [px]."""
BLUR_PX, BLUR_REACH_PX = 1.5, 6
"""Smoothing before the comparison, so that a start a pixel or two away still correlates, and its reach [px]."""
WINDOWS_AT_ONCE = 256
"""Windows compared at once, which bounds the memory."""
ACCEPTED_CORRELATION, MIN_CORRELATION = 0.6, 0.3
"""Median correlation of those windows at which no further source is tried, and the least for any."""
MIN_SEARCHED_SHARE = 0.1
"""Share of the points that a part needs for more ways of finding features than one: they search whole photographs."""
MAX_EPIPOLAR_PX, MIN_EPIPOLAR_SHARE, MIN_EPIPOLAR_PAIRS = 3.0, 0.6, 30
"""Distance of a pair from the epipolar lines that most share, least share of such pairs, and their least number."""


def seed_warps(
    reference: Grey,
    target: Grey,
    points: Array,
    matches: Pairs | None = None,
    parts: Parts | None = None,
    reach_px: float = np.inf,
    origin: tuple[int, int] = (0, 0),
    threads: int = 1,
) -> Array:
    """Affine warps of the subsets around points of a grid, to start correlation from.

    reference, target : (rows, cols)
    points : (i, j, 2) — places in the reference photograph of a grid that was regular once [px]; NaN where unknown
    matches : feature pairs of an earlier stage, with false ones among them
    parts : of the grid; None for a single one
    reach_px : longest motion of a pattern that repeats itself; among equal ones the shortest is taken, and
        the matches do not count
    origin : (x, y) — place of the reference photograph's first pixel if it is a part of one as large as the target [px]
    threads : how many share the windows and places
    Returns (i, j, 2, 3); NaN where unknown.
    """
    warps = np.full((*points.shape, 3), np.nan)
    numbered = islands(all_finite(points), parts)
    features = FeatureSearch(reference, target, points) if numbered.any() else ()
    images = np.asarray(reference, dtype=np.float32), np.asarray(target, dtype=np.float32)
    for island in range(1, numbered.max(initial=0) + 1):
        in_part = numbered == island
        best = MIN_CORRELATION
        repeats = np.isfinite(reach_px)
        guesses = (
            [_nearby_warps(*images, points[in_part], reach_px, origin)]
            if repeats
            else _candidate_warps(*images, points, in_part, matches, features, origin, threads)
        )
        for guess in guesses:
            score = window_correlation(*images, points[in_part], guess, threads)
            if score > best:
                best, warps[in_part] = score, guess
            if best >= ACCEPTED_CORRELATION:
                break
    return warps


def _candidate_warps(
    reference: Grey,
    target: Grey,
    points: Array,
    in_part: Mask,
    matches: Pairs | None,
    features: Iterable[Pairs],
    origin: tuple[int, int],
    threads: int,
) -> Iterator[Array]:
    """Warps (n, 2, 3) of the points of one part, from one source after the other."""
    centres = points[in_part]
    by_pairs = partial(_warps_from_pairs, centres=centres, threads=threads)
    if matches is not None:
        yield by_pairs(_pairs_of_part(matches, points, in_part))
    yield identity(centres + origin)
    footprint = _footprint(points, in_part, reference.shape)
    yield by_pairs(Pairs(*fft_matches(reference, target, footprint, threads=threads)))
    yield by_pairs(Pairs(*fft_matches(reference, target, footprint, separate_windows=True, threads=threads)))
    thorough = in_part.sum() >= MIN_SEARCHED_SHARE * np.isfinite(points[..., 0]).sum()
    for found in features if thorough else islice(features, 1):
        yield by_pairs(_pairs_of_part(found, points, in_part))


def _square(image: Grey, centre: tuple[int, int], half: int) -> Grey | None:
    """The pixels up to ``half`` px from a place (x, y); None where the image does not hold all of them."""
    x, y = centre
    inside = half <= x < image.shape[1] - half and half <= y < image.shape[0] - half
    return image[y - half : y + half + 1, x - half : x + half + 1] if inside else None


def _nearby_warps(reference: Grey, target: Grey, centres: Array, reach_px: float, origin: tuple[int, int]) -> Array:
    """Warps (n, 2, 3) of subsets at centres (n, 2) by the best motions of at most ``reach_px`` of windows there."""
    reference, target = (np.asarray(cv2.GaussianBlur(image, (0, 0), BLUR_PX)) for image in (reference, target))
    reach = int(np.ceil(reach_px))
    lags = np.arange(-reach, reach + 1)
    near = np.hypot(*np.meshgrid(lags, lags)) <= reach_px
    source, moved = [], []
    for x, y in np.rint(centres[:: 1 + len(centres) // SAMPLED_POINTS]).astype(int):
        size, wide = HALF_WINDOW_PX, HALF_WINDOW_PX + reach
        there = x + origin[0], y + origin[1]
        window, around = _square(reference, (x, y), size), _square(target, there, wide)
        if window is None or around is None:
            continue
        fit = cv2.matchTemplate(around, window, cv2.TM_CCOEFF_NORMED)
        fit[~near | ~(np.abs(fit) <= 1.0)] = -1.0
        row, col = np.unravel_index(fit.argmax(), fit.shape)
        if fit[row, col] >= ACCEPTED_CORRELATION:
            source.append((x, y))
            moved.append((there[0] + lags[col], there[1] + lags[row]))
    pairs = Pairs(np.array(source, dtype=float).reshape(-1, 2), np.array(moved, dtype=float).reshape(-1, 2))
    keep = agreeing_matches(*pairs)
    return _warps_from_pairs(Pairs(pairs.source[keep], pairs.target[keep]), centres)


def window_correlation(reference: Grey, target: Grey, centres: Array, warps: Array, threads: int = 1) -> float:
    """Median correlation, −1 … 1, of small windows around points with those where warps put them.

    centres : (n, 2) [px]; warps : (n, 2, 3) — NaN where unknown
    Returns −1 where too few windows lie in both images. At most SAMPLED_POINTS points, evenly chosen, are compared.
    """
    known = np.flatnonzero(all_finite(warps, 2))
    chosen = known[np.linspace(0, len(known) - 1, min(SAMPLED_POINTS, len(known))).astype(int)]
    if len(chosen) == 0:
        return -1.0
    found = window_correlations(reference, target, centres[chosen], warps[chosen], threads)
    seen = np.isfinite(found)
    return float(np.median(found[seen])) if seen.mean() >= 0.1 else -1.0


def window_correlations(reference: Grey, target: Grey, centres: Array, warps: Array, threads: int = 1) -> Array:
    """Correlations (n,), −1 … 1, of small windows around points with those where warps put them, both smoothed.

    centres : (n, 2) [px]; warps : (n, 2, 3); threads : how many share the windows
    NaN for windows of which less than half lies in both images.
    """
    views = np.asarray(reference, dtype=np.float32), np.asarray(target, dtype=np.float32)
    at_once = min(WINDOWS_AT_ONCE, max(1, -(-len(centres) // threads)))
    parts = [slice(begin, begin + at_once) for begin in range(0, len(centres), at_once)]
    found = over(threads, lambda part: _of_windows(*views, centres[part], warps[part]), parts)
    return np.concatenate([np.empty(0), *found])


def _of_windows(reference: Grey, target: Grey, centres: Array, warps: Array) -> Array:
    """The same for few windows at once."""
    side = np.arange(-HALF_WINDOW_PX - BLUR_REACH_PX, HALF_WINDOW_PX + BLUR_REACH_PX + 1.0)
    offsets = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
    f, in_f = _smooth_windows(reference, centres[:, None] + offsets)
    g, in_g = _smooth_windows(target, apply_warp(warps[:, None], offsets))
    seen = in_f & in_g
    return np.where(seen.mean(axis=1) >= 0.5, _correlation(f, g, seen), np.nan)


def _smooth_windows(image: Grey, places: Array) -> tuple[Array, Mask]:
    """Grey levels of square windows, from those at places (n, pixels, 2) in them and up to BLUR_REACH_PX around.

    Returns the smoothed windows, and which of their pixels lie in the image, (n, pixels) each.
    """
    count, side = len(places), 2 * (HALF_WINDOW_PX + BLUR_REACH_PX) + 1
    grey = cv2.remap(image, places.astype(np.float32), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    smooth = cv2.GaussianBlur(grey.reshape(count * side, side), (0, 0), BLUR_PX)
    with np.errstate(invalid="ignore"):
        inside = ((places >= 0.0) & (places <= np.array(image.shape[::-1]) - 1.0)).all(axis=-1)
    inner = np.s_[:, BLUR_REACH_PX:-BLUR_REACH_PX, BLUR_REACH_PX:-BLUR_REACH_PX]
    windows, seen = (values.reshape(count, side, side)[inner].reshape(count, -1) for values in (smooth, inside))
    return windows.astype(np.float64), seen


def _correlation(f: Array, g: Array, seen: Mask) -> Array:
    """Zero-mean normalised cross-correlation of rows over the pixels seen in both; 0 for a flat row."""
    count = seen.sum(axis=1, keepdims=True)
    f, g = (
        np.where(seen, v - np.where(seen, v, 0.0).sum(axis=1, keepdims=True) / np.maximum(count, 1), 0.0)
        for v in (f, g)
    )
    size = np.sqrt((f * f).sum(axis=1) * (g * g).sum(axis=1))
    return np.asarray((f * g).sum(axis=1) / np.where(size > 0.0, size, 1.0))


def _pairs_of_part(pairs: Pairs, points: Array, in_part: Mask) -> Pairs:
    """The pairs of one part of the grid, without those that disagree with their neighbours."""
    source, target = pairs
    known = all_finite(points)
    if len(source) == 0:
        return pairs
    distance, index = nearest(points[known], source)
    here = (in_part[known][index] & (distance <= 2.0 * _spacing(points)))[:, 0]
    source, target = source[here], target[here]
    keep = agreeing_matches(source, target)
    return Pairs(source[keep], target[keep])


def _warps_from_pairs(pairs: Pairs, centres: Array, threads: int = 1) -> Array:
    """Warps (n, 2, 3) of subsets at centres (n, 2), from the pairs around them; NaN where these are too far away.

    Of close centres one gives the motion of all: it is affine there. threads : how many share the centres
    """
    kept, _ = _one_per_cell(pairs.source, CELL_PX)
    pairs = Pairs(pairs.source[kept], pairs.target[kept])
    if len(pairs.source) < MIN_PAIRS:
        return np.full((len(centres), 2, 3), np.nan)
    distances = np.median(nearest(pairs.source, pairs.source, min(len(pairs.source), 24))[0], axis=0)
    reach = MAX_REACH * float(distances[-1])
    chosen, cell = _one_per_cell(centres, max(CELL_PX, SHARE_OF_DISTANCE * float(distances[1])))
    some = centres[chosen]
    warps = np.concatenate(over(threads, partial(_warps_within, pairs, reach), np.array_split(some, threads)))
    return recentred(warps[cell], centres - some[cell])


def _warps_within(pairs: Pairs, reach: float, centres: Array) -> Array:
    """Warps (n, 2, 3) of subsets at centres (n, 2); NaN for those farther than so much from all pairs [px]."""
    warps = warp_from_gradient(*local_motion(*pairs, centres))
    warps[nearest(pairs.source, centres)[0][:, 0] > reach] = np.nan
    return warps


def _one_per_cell(places: Array, side_px: float) -> tuple[Index, Index]:
    """The first of the places (n, 2) in each cell with such a side, and the cell of each place."""
    column, row = np.floor(places / side_px).astype(np.int64).T
    _, first, cell = np.unique((column << 32) + row, return_index=True, return_inverse=True)
    return first, cell


def _spacing(points: Array) -> float:
    """Median distance of neighbours on a grid [px]."""
    steps = (np.moveaxis(np.diff(points, axis=axis), -1, 0) for axis in (0, 1))
    known = np.concatenate([np.hypot(*step).ravel() for step in steps])
    known = known[np.isfinite(known)]
    return float(np.median(known)) if len(known) else float(HALF_WINDOW_PX)


def _footprint(points: Array, in_part: Mask, shape: tuple[int, ...]) -> Mask:
    """Pixels of an image that one part of the grid covers."""
    covered = np.zeros(shape, dtype=np.uint8)
    spacing = max(1, int(np.ceil(_spacing(points))))
    x, y = np.rint(points[in_part]).astype(int).T
    inside = (x >= 0) & (x < shape[1]) & (y >= 0) & (y < shape[0])
    covered[y[inside], x[inside]] = 1
    return np.asarray(cv2.dilate(covered, np.ones((2 * spacing + 1,) * 2, dtype=np.uint8)) > 0)


def epipolar_pairs(left: Grey, right: Grey, points: Array) -> Pairs:
    """Matches of features around points (i, j, 2) that fit one unknown epipolar geometry; none if they are few.

    Photographs of different things, or with a repeating pattern, have false matches, which no geometry fits.
    """
    none = Pairs(np.zeros((0, 2)), np.zeros((0, 2)))
    pairs = feature_pairs(left, right, points) if all_finite(points).any() else none
    if len(pairs.source) < MIN_EPIPOLAR_PAIRS:
        return none
    cv2.setRNGSeed(0)
    _, fits = cv2.findFundamentalMat(pairs.source, pairs.target, cv2.FM_RANSAC, MAX_EPIPOLAR_PX, 0.999)
    keep = np.zeros(len(pairs.source), dtype=bool) if fits is None else fits.ravel() > 0
    enough = keep.sum() >= max(MIN_EPIPOLAR_PAIRS, MIN_EPIPOLAR_SHARE * len(keep))
    return Pairs(pairs.source[keep], pairs.target[keep]) if enough else none
