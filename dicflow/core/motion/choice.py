"""Which photographs of a series are worth measuring: those that differ from one another."""

from __future__ import annotations

import numpy as np

__all__ = ["most_different", "moved_steps"]

_SHARP = 0.7
"""Least sharpness of a photograph, as a share of the sharpest in its surroundings."""
_SURROUNDINGS = 15
"""Photographs before and after one that count as its surroundings."""
_SAME = 0.5
"""Photographs whose smallest copies differ by less than this share of the mean difference show the same."""


def moved_steps(cells: np.ndarray, least: float) -> list[int]:
    """The first photograph, and each in which a part of the picture has moved since the one chosen before.

    cells : (n, cell, 2) float64 — displacements since the first photograph [px]
    least : motion [px]
    Returns indices. The last photograph is chosen too if anything has moved by half as much by then.
    """
    chosen = [0]
    for k in range(1, len(cells)):
        allowed = 0.5 * least if k == len(cells) - 1 else least
        if np.hypot(*(cells[k] - cells[chosen[-1]]).T).max() >= allowed:
            chosen.append(k)
    return chosen


def most_different(thumbs: np.ndarray, sharpness: np.ndarray, motion: np.ndarray, count: int) -> list[int]:
    """The sharpest photographs that differ most from one another, in their order.

    thumbs : (n, height, width) uint8 — smallest copies
    sharpness : (n,) float64
    motion : (n,) float64 — how fast the picture moved; of photographs that show nearly the same, the calmest counts
    count : number of photographs at most

    Each photograph chosen is the one farthest from all chosen before (Gonzalez, Theor. Comput. Sci. 38, 1985); the
    first is the farthest from the mean.
    """
    copies = thumbs.reshape(len(thumbs), -1).astype(np.float64)
    sharp = np.flatnonzero(sharpness >= _SHARP * _highest_around(sharpness))
    calm = sharp[motion[sharp] <= np.median(motion[sharp])]
    points = copies[calm]
    distance = np.linalg.norm(points - points.mean(axis=0), axis=1)
    limit, chosen = _SAME * distance.mean(), [int(distance.argmax())]
    distance = np.linalg.norm(points - points[chosen[0]], axis=1)
    while len(chosen) < count and distance.max() > limit:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(points - points[chosen[-1]], axis=1))
    return sorted(int(calm[k]) for k in chosen)


def _highest_around(values: np.ndarray) -> np.ndarray:
    """The highest value among the neighbours of each."""
    padded = np.pad(values, _SURROUNDINGS, mode="edge")
    return np.asarray(np.lib.stride_tricks.sliding_window_view(padded, 2 * _SURROUNDINGS + 1).max(axis=1))
