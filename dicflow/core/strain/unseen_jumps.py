"""Jumps of the motion that no lost points mark: a crack towards its tip, or one that opens by a fraction of a pixel.

Strain has a ridge there that is none. The line of a jump goes where the jump is most significant along its normal
(:mod:`dicflow.core.strain.small_jumps`). It counts where it stands out against noise; ahead of the end of its line, or
of a long gap of lost points, what is found there counts as the jump that may go on unseen. A line that goes on from
lost points is a crack. Any other may be a narrow band of true strain as well, so that between none and all of the ridge
is wrong.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import cv2
import numpy as np

from dicflow.core.arrays import Array, Codes, Index, Mask
from dicflow.core.strain.deformation_gradient import MeasuredSurface
from dicflow.core.strain.small_jumps import NORMALS, GridOfSubsets, Jumps, grown, jumps_at_points
from dicflow.core.strain.window_fits import places_of

__all__ = ["UnseenJumps", "cut_by_jumps", "unseen_jumps"]


_SIGMAS = 5.4
"""Significance above which a jump counts; on rendered photographs noise reaches it in one of 10,000 points."""
_OF_BAND = 1.0 / 3.0**0.5
"""Standard deviation of the wrong share of a ridge that may be a narrow band: any share is as likely."""
_TURN = np.pi / 8.0 / 3.0**0.5
"""Standard deviation of the angle between a line and the nearest of four directions [rad]."""
_BESIDE, _NEXT = 1.5, 2
"""Distances from a line up to which points lie on it, and up to which it is the crest where it goes on [points]."""
_WEDGE = np.tan(np.pi / 8.0)
"""Slope up to which a line may turn away from the nearest of four directions."""


class UnseenJumps(NamedTuple):
    """The jump whose line counts most at each point of a grid.

    jump : (row, col, 3) [mm]; 0 far from all lines
    direction : (row, col) — number of the normal of its line
    distance : (row, col) — of the point from the line, along its normal [points]
    is_crack : (row, col) — where the line goes on from lost points; the jump may vanish within half a window there
    subsets : of the grid; window : side of the window of a strain [points]
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
        for number, normal in enumerate(NORMALS):
            here = self.is_crack & (self.direction == number)
            share[here] = 0.5 - np.abs(self.subsets.profile(self.distance[here], normal))
        return np.asarray(np.abs(share[..., None] * self.jump))

    def of_slopes(self, at: Index, weights: Array) -> Array:
        """What slopes per column and per row have by jumps, (n, 3, 2, 3) [mm].

        By the jumps themselves, by how far their lines may be turned from the four directions, and by the change of
        jumps along cracks.

        at : (n, 2) — rows and columns; weights : (n, 2, high, wide) — of the points in both slopes
        """
        row, col = (np.arange(-(side // 2), side // 2 + 1) for side in weights.shape[2:])
        rows, cols = at.T
        shares = np.zeros((len(at), 3, 2))
        for number, normal in enumerate(NORMALS):
            here = np.flatnonzero(self.direction[rows, cols] == number)
            distance = self.distance[rows, cols][here, None, None]
            across = distance + np.add.outer(normal[0] * row, normal[1] * col)
            along = np.add.outer(normal[1] * row, -normal[0] * col)
            rise, one, other = (self.subsets.profile(across + turn * along, normal) for turn in (0.0, _TURN, -_TURN))
            change = (rise - np.where(distance < 0.0, -0.5, 0.5)) * along / (0.5 * self.window)
            shares[here] = np.einsum("naij,knij->nka", weights[here], np.stack([rise, 0.5 * (one - other), change]))
        shares[:, 2] *= self.is_crack[rows, cols][:, None]
        shares[~self.is_crack[rows, cols]] *= _OF_BAND
        return np.asarray(shares[..., None] * self.jump[rows, cols][:, None, None])


def unseen_jumps(surface: MeasuredSurface, lost: Mask, subsets: GridOfSubsets, window: int) -> UnseenJumps | None:
    """Jumps between the points of a surface; None without any.

    lost : (row, col) — points at which a jump was found; window : side of the window of a strain [points]
    """
    jumps = jumps_at_points(surface, lost, subsets)
    counts, direction = _lines(jumps, surface, subsets.reach)
    for number, ahead in enumerate(_ahead_of_gaps(jumps, surface, lost, subsets)):
        counts |= ahead
        direction[ahead] = number
        jumps.jump[ahead] = jumps.of_normals[1][number][ahead]
    if not counts.any():
        return None
    jumps = jumps._replace(direction=direction)
    found = UnseenJumps(
        np.zeros_like(jumps.jump),
        np.zeros_like(jumps.direction),
        np.zeros(lost.shape),
        np.zeros(lost.shape, dtype=np.bool_),
        subsets,
        window,
    )
    _take_nearest(found, jumps, places_of(counts), _going_on(jumps, counts, lost, subsets.reach))
    return found


def cut_by_jumps(surface: MeasuredSurface, lost: Mask, subsets: GridOfSubsets, window: tuple[int, int]) -> Mask:
    """Points (row, col) beside a jump whose places count so little that their strain would be that of others.

    Their weight is less than that of the most certain point around over the number of points in a window.

    lost : (row, col) — points at which a jump was found; window : rows and columns of the window of a strain [points]
    """
    sigma = np.where(surface.known, surface.points.sigma, np.inf)
    least = cv2.erode(sigma, np.ones(window, dtype=np.uint8))
    beside = grown(lost, np.ones((2 * subsets.half + 1,) * 2, dtype=np.uint8))
    return np.asarray(surface.known & beside & (sigma / np.sqrt(window[0] * window[1]) > least), dtype=np.bool_)


def _lines(jumps: Jumps, surface: MeasuredSurface, reach: int) -> tuple[Mask, Codes]:
    """Points (row, col) on the lines of jumps that count, and the number of the normal of each one.

    Beside a line, at most of a subset's distance, polynomials that cannot follow its jump look like lines themselves.
    So a line counts that is not beside a more significant one, and goes on along its crest.
    """
    gap = ~surface.known & (surface.points.parts.number > 0)
    strength, strong = np.where(gap, np.inf, jumps.significance), jumps.significance > _SIGMAS
    counts, direction = np.zeros_like(gap), jumps.direction.copy()
    for number, normal in enumerate(NORMALS):
        along, own = normal[::-1] * (1.0, -1.0), jumps.direction == number
        crest = own & strong & surface.known & (strength >= cv2.dilate(strength, _line(normal, reach, 0.1)))
        beside = cv2.dilate(np.where(crest, jumps.significance, 0.0), _beside(normal, reach))
        lines = crest & (jumps.significance >= beside)
        free = surface.known & (jumps.significance > 0.0) & ~grown(gap, _line(normal, reach, 0.1))
        crest = free & (strength >= cv2.dilate(strength, _line(normal, _NEXT, 0.1)))
        ahead = crest & grown(lines, _line(along, reach, _BESIDE)) & ~counts
        direction[ahead] = number
        counts |= lines | ahead
    return counts, direction


def _ahead_of_gaps(jumps: Jumps, surface: MeasuredSurface, lost: Mask, subsets: GridOfSubsets) -> Iterator[Mask]:
    """For each normal the points (row, col) straight ahead of the ends of long gaps of lost ones, on the crest there.

    A gap along a crack is as wide as a subset. One that is twice as long, and not as wide, has the direction of its
    crack, which goes on: what jumps in that direction counts, even if another one is more significant.
    """
    gap, twice = ~surface.known & (surface.points.parts.number > 0), int(np.ceil(subsets.size / subsets.step))
    for number, normal in enumerate(NORMALS):
        along, strength = normal[::-1] * (1.0, -1.0), jumps.of_normals[0][number]
        narrow = lost & ~_runs(lost, _line(normal, twice, 0.1))
        long = _runs(narrow, _line(along, twice, 0.1))
        free = surface.known & (strength > 0.0) & ~grown(gap, _line(normal, subsets.reach, 0.1))
        crest = free & (strength >= cv2.dilate(strength, _line(normal, _NEXT, 0.1)))
        yield crest & grown(long, _line(along, subsets.reach, _BESIDE))


def _runs(mask: Mask, line: Codes) -> Mask:
    """The points of a mask (row, col) that lie on a line (side, side) inside it."""
    inside = cv2.morphologyEx(
        mask.astype(np.uint8), cv2.MORPH_OPEN, line, borderType=cv2.BORDER_CONSTANT, borderValue=0
    )
    return np.asarray(inside > 0, dtype=np.bool_)


def _beside(normal: Array, reach: int) -> Codes:
    """The points (side, side) within a reach of the middle that lie on no line through it, however that is turned."""
    row, col = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    across, along = np.abs(row * normal[0] + col * normal[1]), np.abs(row * normal[1] - col * normal[0])
    return np.asarray((across > _BESIDE + _WEDGE * along) & (np.maximum(across, along) <= reach), dtype=np.uint8)


def _going_on(jumps: Jumps, counts: Mask, lost: Mask, reach: int) -> Mask:
    """Which of the points on lines (row, col) lie on one that goes on from lost points."""
    found, before = np.zeros_like(counts), -1
    while found.sum() > before:
        before = found.sum()
        for number, normal in enumerate(NORMALS):
            ahead = grown(found | lost, _line(normal[::-1] * (1.0, -1.0), reach, _BESIDE))
            found |= counts & (jumps.direction == number) & ahead
    return found


def _line(direction: Array, reach: int, beside: float) -> Codes:
    """The points (side, side) within a reach of the middle that lie on a line through it."""
    row, col = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    across, along = row * direction[1] - col * direction[0], row * direction[0] + col * direction[1]
    return np.asarray((np.abs(across) <= beside) & (np.abs(along) <= reach), dtype=np.uint8)


def _take_nearest(found: UnseenJumps, jumps: Jumps, lines: Index, is_crack: Mask) -> None:
    """Set the largest jump at each point, of those at points (n, 2) on lines, the less the further away."""
    shape, rows, cols = found.distance.shape, *lines.T
    normal, size = NORMALS[jumps.direction[rows, cols]], np.linalg.norm(jumps.jump[rows, cols], axis=1)
    reach, most = int(np.ceil(0.5 * (found.window + found.subsets.size / found.subsets.step))), np.zeros(shape)
    right = np.arange(-reach, reach + 1)[:, None]
    to_cols = cols + right
    for down in range(-reach, reach + 1):
        to_rows = np.broadcast_to(rows + down, to_cols.shape)
        across = normal[:, 0] * down + normal[:, 1] * right
        along = np.abs(normal[:, 1] * down - normal[:, 0] * right)
        value = size * (1.0 - np.hypot(across, along) / (reach + found.window))
        near = (np.abs(across) < reach) & (along <= 0.5 * found.window)
        near &= (to_rows >= 0) & (to_rows < shape[0]) & (to_cols >= 0) & (to_cols < shape[1])
        near[near] = value[near] > most[to_rows[near], to_cols[near]]
        np.maximum.at(most, (to_rows[near], to_cols[near]), value[near])
        near[near] = value[near] == most[to_rows[near], to_cols[near]]
        number, k = (index[::-1] for index in np.nonzero(near))  # of equal ones the first counts, which is set last
        here, source = (to_rows[number, k], to_cols[number, k]), (rows[k], cols[k])
        found.distance[here] = across[number, k]
        found.jump[here], found.direction[here] = jumps.jump[source], jumps.direction[source]
        found.is_crack[here] = is_crack[source]
