"""Jumps of the motion that no lost points mark: a crack towards its tip, or one that opens by a fraction of a pixel.

Subsets on the line of a jump J average both sides, so that their places rise across it by J r(δ), with δ the distance
from the line and r the **profile** of a subset, from −1/2 to 1/2 over its side. Strain has a ridge there that is none.
For every point, and lines through it in four directions, J is a coefficient of a least-squares fit to the displacements
around: a polynomial of degree 3, which follows smooth motion, and J r(δ). It is a weighted sum of points, so that its
covariance is known.

The line of a jump goes where J is most significant along its normal. A jump counts where it stands out against noise;
ahead of the end of its line, what is found there counts as the jump that may go on unseen.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from dicflow.core.arrays import Array, Codes, Index, Mask
from dicflow.core.parts import beside_borders
from dicflow.core.strain.deformation_gradient import ErrorShare, MeasuredSurface
from dicflow.core.strain.window_fits import places_of
from dicflow.core.uncertainty.covariance import displacement_covariance
from dicflow.core.uncertainty.overlap import Overlap, ShapeFunction, subset_weights

__all__ = ["GridOfSubsets", "UnseenJumps", "unseen_jumps"]


_NORMALS = np.array([[1.0, 0.0], [0.0, 1.0], [0.5**0.5, 0.5**0.5], [0.5**0.5, -(0.5**0.5)]])
"""Normals (row, col) of the lines."""
_STEPS = np.sign(np.rint(1e3 * _NORMALS)).astype(np.int64)
"""Steps on the grid along them."""
_DEPTH, _WIDTH = 1.6, 0.7
"""Distances from a point, normal to the line and along it, up to which points count [sides of a subset]."""
_DEGREE, _MIN_POINTS_PER_TERM, _MAX_CONDITION = 3, 1.5, 1e7
_SIGMAS = 6.0
"""Significance above which a jump counts: on rendered photographs noise reaches it in one of 10,000 points."""
_OF_BAND = 1.0 / 3.0**0.5
"""Share of a ridge of strain that is wrong where it may be a narrow band as well: as likely none as all of it."""
_BESIDE = 1.5
"""Distance from a line up to which points lie on it [points]."""


class GridOfSubsets(NamedTuple):
    """Subsets of a grid: their side, the distance of its points [px], and how they may deform."""

    size: int
    step: int
    shape_function: ShapeFunction

    @property
    def side(self) -> float:
        """Side of a subset [points]."""
        return self.size / self.step

    def profile(self, distance: Array, normal: Array) -> Array:
        """r at distances from a line [points], −1/2 to 1/2. normal : (2,) — of the line"""
        weights, pixel = subset_weights(self.size, self.shape_function), np.arange(self.size) - self.size // 2
        across = np.add.outer(normal[0] * pixel, normal[1] * pixel)
        table = np.arange(-self.size, self.size + 1)
        values = [0.5 * np.sum(weights * np.sign(np.rint(1e6 * (across + at)))) for at in table]
        return np.asarray(np.interp(self.step * distance, table, values))


class _Fit(NamedTuple):
    """The fit around a point for lines of one direction, over points of a square (side, side).

    terms : (term, n) — of the points that count, the profile first; places : (n,) — of these in the square
    weights : (side, side) — of the points in J, where all of them are known
    """

    terms: Array
    places: Index
    side: int

    @property
    def weights(self) -> Array:
        return self.on_square(np.linalg.pinv(self.terms.T)[:1])[0]

    def on_square(self, values: Array) -> Array:
        """Values (k, n) of the points that count as squares (k, side, side), 0 elsewhere."""
        whole = np.zeros((len(values), self.side**2))
        whole[:, self.places] = values
        return whole.reshape(-1, self.side, self.side)


class _Jumps(NamedTuple):
    """The most significant of the jumps across lines through each point of a grid.

    significance : (row, col) — |J| in standard deviations; 0 where unknown
    jump : (row, col, 3) [mm]; direction : (row, col) — number of the normal of its line
    """

    significance: Array
    jump: Array
    direction: Codes


class UnseenJumps(NamedTuple):
    """The jump whose line passes closest to each point of a grid.

    jump : (row, col, 3) [mm]; 0 far from all lines
    direction : (row, col) — number of the normal of its line
    distance : (row, col) — of the point from the line, along its normal [points]
    is_crack : (row, col) — where the line goes on from lost points; a crack's jump may vanish within half a window
    subsets : of the grid; window : side of the window [points]
    """

    jump: Array
    direction: Codes
    distance: Array
    is_crack: Mask
    subsets: GridOfSubsets
    window: int

    def of_places(self) -> Array:
        """What displacements (row, col, 3) may be off, since subsets average both sides of a crack [mm]."""
        share = np.zeros(self.distance.shape)
        for number, normal in enumerate(_NORMALS):
            here = self.is_crack & (self.direction == number)
            share[here] = 0.5 - np.abs(self.subsets.profile(self.distance[here], normal))
        return np.asarray(np.abs(share[..., None] * self.jump))

    def of_slopes(self, at: Index, weights: Array) -> Array:
        """What slopes per column and per row have by the jumps, and by their change along cracks, (n, 2, 2, 3) [mm].

        at : (n, 2) — rows and columns; weights : (n, 2, high, wide) — of the points in both slopes
        """
        row, col = (np.arange(-(side // 2), side // 2 + 1) for side in weights.shape[2:])
        rows, cols = at.T
        shares = np.zeros((len(at), 2, 2))
        for number, normal in enumerate(_NORMALS):
            here = np.flatnonzero(self.direction[rows, cols] == number)
            distance = self.distance[rows, cols][here, None, None]
            rise = self.subsets.profile(distance + np.add.outer(normal[0] * row, normal[1] * col), normal)
            wrong = (rise - np.where(distance < 0.0, -0.5, 0.5)) * np.add.outer(normal[1] * row, -normal[0] * col)
            shares[here] = np.einsum("naij,knij->nka", weights[here], np.stack([rise, wrong / (0.5 * self.window)]))
        is_crack = self.is_crack[rows, cols][:, None]
        shares[:, 0] *= np.where(is_crack, 1.0, _OF_BAND)
        shares[:, 1] *= is_crack
        return np.asarray(shares[..., None] * self.jump[rows, cols][:, None, None])


def unseen_jumps(surface: MeasuredSurface, lost: Mask, subsets: GridOfSubsets, window: int) -> UnseenJumps | None:
    """Jumps between the points of a surface; None where there is none.

    lost : (row, col) — points at which a jump was found; window : side of the window of a strain [points]
    """
    jumps = _jumps(surface, lost, subsets)
    if not (jumps.significance > _SIGMAS).any():
        return None
    gap = ~surface.known & (surface.points.parts.number > 0)
    counts, is_crack = _lines(jumps, gap, lost, subsets)
    return _nearest(jumps, counts & surface.known, is_crack, subsets, window) if counts.any() else None


def _jumps(surface: MeasuredSurface, lost: Mask, subsets: GridOfSubsets) -> _Jumps:
    """The most significant jump at each point with a complete window, or near points at which a jump was found."""
    shape = lost.shape
    best = _Jumps(np.zeros(shape), np.zeros((*shape, 3)), np.zeros(shape, dtype=np.uint8))
    values = surface.points.values[..., :3] - surface.points.values[..., 3:]
    whole = surface.known & ~beside_borders(surface.points.parts)
    reach = int(np.ceil(_DEPTH * subsets.side))
    near = _grown(lost, np.ones((2 * reach + 1,) * 2)) & surface.known
    surface = surface._replace(errors=_least_around(surface, reach))
    for number, fit in enumerate(_fits(subsets)):
        square = fit.on_square(np.ones((1, len(fit.places))))[0]
        complete = (_summed(whole.astype(np.float64), square) > len(fit.places) - 0.5) & surface.known
        at = places_of(complete)
        found = _summed(values, fit.weights)[complete]
        _take(best, at, found, _covariance(surface, at, fit.weights), number)
        _take_partial(best, surface, places_of(near & ~complete), fit, number)
    return best


def _least_around(surface: MeasuredSurface, reach: int) -> list[ErrorShare]:
    """Errors of the points, as large as the least ones around: those beside a jump are uncertain by the jump itself."""
    sigma = np.where(surface.known, surface.points.sigma, np.inf)
    least = cv2.erode(sigma, np.ones((reach + 1,) * 2, dtype=np.uint8))
    share = np.where(surface.known, least / sigma, 1.0)[..., None, None] ** 2
    return [error._replace(covariance=share * error.covariance) for error in surface.errors]


def _fits(subsets: GridOfSubsets) -> Iterator[_Fit]:
    """The fits for lines of all directions; none where too few points count."""
    depth, width = (max(1, round(part * subsets.side)) for part in (_DEPTH, _WIDTH))
    reach = int(np.ceil(np.hypot(depth, width)))
    row, col = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    for normal in _NORMALS:
        across, along = row * normal[0] + col * normal[1], row * normal[1] - col * normal[0]
        places = np.flatnonzero((np.abs(across) < depth + 0.1) & (np.abs(along) < width + 0.1))
        x, y = across.ravel()[places] / depth, along.ravel()[places] / depth
        powers = [x**a * y**b for a in range(_DEGREE + 1) for b in range(_DEGREE + 1 - a)]
        terms = np.stack([subsets.profile(depth * x, normal), *powers])
        if len(places) >= _MIN_POINTS_PER_TERM * len(terms) and np.linalg.cond(terms) < _MAX_CONDITION:
            yield _Fit(terms, places, 2 * reach + 1)


def _summed(values: Array, weights: Array) -> Array:
    """Sums of a field (row, col, …) with weights (side, side) around each point."""
    return np.asarray(cv2.filter2D(values, -1, weights, borderType=cv2.BORDER_CONSTANT))


def _covariance(surface: MeasuredSurface, at: Index, weights: Array) -> Array:
    """Covariance (n, 3, 3) of such sums of displacements at rows and columns (n, 2)."""
    parts = [
        share.rho.variance(weights) * displacement_covariance(share.covariance[at[:, 0], at[:, 1]])
        for share in surface.errors
    ]
    return np.asarray(np.sum(parts, axis=0))


def _take(best: _Jumps, at: Index, jump: Array, covariance: Array, number: int) -> None:
    """Set jumps (n, 3) of lines with a normal where they are more significant than those before."""
    if not len(at):
        return
    whitened = np.einsum("nij,nj->ni", np.linalg.pinv(covariance, hermitian=True), jump)
    significance = np.sqrt(np.maximum((whitened * jump).sum(axis=1), 0.0))
    better = significance > best.significance[at[:, 0], at[:, 1]]
    rows, cols = at[better].T
    best.significance[rows, cols], best.jump[rows, cols] = significance[better], jump[better]
    best.direction[rows, cols] = number


def _take_partial(best: _Jumps, surface: MeasuredSurface, at: Index, fit: _Fit, number: int) -> None:
    """The same for points (n, 2) whose windows lack points."""
    if not len(at):
        return
    points, reach = surface.points, fit.side // 2
    weights, part = (
        sliding_window_view(np.pad(field, reach), (fit.side,) * 2)[at[:, 0], at[:, 1]]
        .reshape(len(at), -1)[:, fit.places]
        for field in (points.weights, points.parts.number)
    )
    weights = np.where(part == points.parts.number[at[:, 0], at[:, 1]][:, None], weights, 0.0)
    weights /= np.maximum(weights.max(axis=1, keepdims=True), 1e-300)
    normal = (fit.terms * weights[:, None]) @ fit.terms.T
    firm = np.linalg.cond(normal) < _MAX_CONDITION
    at, weights = at[firm], weights[firm]
    unit = np.broadcast_to(np.eye(len(fit.terms))[:, :1], (len(at), len(fit.terms), 1))
    solved = np.linalg.solve(normal[firm], unit)[..., 0]
    squares = fit.on_square((solved @ fit.terms) * weights)[:, None]
    both = points.sums(at, squares)[:, 0]
    covariance = np.zeros((len(at), 3, 3))
    for share in surface.errors:
        covariance += points.variances(at, squares, share.rho) * displacement_covariance(share.covariance[at[:, 0], at[:, 1]])
    known = np.isfinite(covariance).all(axis=(1, 2))
    _take(best, at[known], (both[:, :3] - both[:, 3:])[known], covariance[known], number)


def _lines(jumps: _Jumps, gap: Mask, lost: Mask, subsets: GridOfSubsets) -> tuple[Mask, Mask]:
    """Points (row, col) on lines of jumps that count, and which of them go on from lost points."""
    strength = np.where(gap, np.inf, jumps.significance)
    reach = int(np.ceil(_DEPTH * subsets.side))
    crest, strong = np.zeros(gap.shape, bool), jumps.significance > _SIGMAS
    ahead, strips = np.zeros(gap.shape, bool), []
    for number, step in enumerate(_STEPS):
        here = jumps.direction == number
        crest |= here & (jumps.significance > 0.0) & (strength >= _largest_along(strength, step, reach))
        strips.append(_strip(number, reach))
        ahead |= here & _grown(strong & here & crest, strips[number])
    counts = crest & (strong | ahead)
    is_crack, count = counts & False, -1
    while is_crack.sum() > count:
        count = is_crack.sum()
        for number, strip in enumerate(strips):
            is_crack |= counts & (jumps.direction == number) & _grown(is_crack | lost, strip)
    return counts, is_crack


def _largest_along(values: Array, step: Index, reach: int) -> Array:
    """Largest value on the grid within a reach along a step."""
    kernel = np.zeros((2 * reach + 1,) * 2)
    for k in range(-reach, reach + 1):
        if np.hypot(*step) * abs(k) <= reach:
            kernel[reach + k * step[0], reach + k * step[1]] = 1
    return np.asarray(cv2.dilate(values, kernel.astype(np.uint8)))


def _strip(number: int, reach: int) -> Array:
    """The points (side, side) within a reach of the middle that lie on a line through it."""
    row, col = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    normal = _NORMALS[number]
    return np.abs(row * normal[0] + col * normal[1]) <= _BESIDE


def _grown(mask: Mask, by: Array) -> Mask:
    """The mask grown by a set of points (side, side)."""
    return np.asarray(cv2.dilate(mask.astype(np.uint8), by.astype(np.uint8)) > 0, dtype=np.bool_)


def _nearest(jumps: _Jumps, counts: Mask, is_crack: Mask, subsets: GridOfSubsets, window: int) -> UnseenJumps:
    """Of each point the jump that counts most there, the less the further its line is away."""
    shape, reach = counts.shape, int(np.ceil(0.5 * (window + subsets.side)))
    most, found = np.zeros(shape), UnseenJumps(
        np.zeros((*shape, 3)), np.zeros(shape, np.uint8), np.zeros(shape), np.zeros(shape, bool), subsets, window
    )
    places = places_of(counts)
    size = np.linalg.norm(jumps.jump, axis=-1)
    for a in range(-reach, reach + 1):
        for b in range(-reach, reach + 1):
            moved = places + (a, b)
            number = jumps.direction[places[:, 0], places[:, 1]]
            normal = _NORMALS[number]
            distance = normal @ (a, b)
            along = normal[:, 1] * a - normal[:, 0] * b
            ok = (np.abs(along) <= 0.5 * window) & (np.abs(distance) < reach) & (moved >= 0).all(1) & (moved < shape).all(1)
            r, c = moved[ok].T
            q = tuple(places[ok].T)
            value = size[q] * (1.0 - np.hypot(distance[ok], along[ok]) / (reach + window))
            better = value > most[r, c]
            r, c, q = r[better], c[better], tuple(i[better] for i in q)
            most[r, c] = value[better]
            found.jump[r, c], found.direction[r, c] = jumps.jump[q], jumps.direction[q]
            found.distance[r, c], found.is_crack[r, c] = distance[ok][better], is_crack[q]
    return found
