"""The settings that are tried."""

from __future__ import annotations

import math
from typing import NamedTuple

from dicflow.core.strain.gauge_kernel import GaugeSetting

__all__ = ["Region", "candidates"]

_SPECKLES = (3.0, 4.3, 6.0, 8.5)
"""Along the side of a subset; three are the least that the field recommends."""
_PER_SUBSET = (4, 2)
"""Steps in a subset."""
_SMALLEST_SUBSET, _SMALLEST_STEP = 9, 2
_WINDOW_POINTS = (3, 41)
_MOST_POINTS = 40_000
_ALIKE = 1.2
"""Ratio below which two subsets count as the same."""
_LARGEST_SHARE = 0.5
"""Of the region's side, for the largest gauge."""


class Region(NamedTuple):
    """What is measured.

    speckle_px : diameter of the speckles [px]
    side_px : of a square as large as the region [px]
    """

    speckle_px: float
    side_px: float


def candidates(present: GaugeSetting, region: Region) -> list[GaugeSetting]:
    """Settings around the speckles of the pattern, the present one first.

    Subsets by speckles, with the shape function of the file and quadratic; steps by subsets, and windows that give each
    of them about the same ladder of gauges, √2 apart.
    """
    found = {present: None}
    least_step = max(_SMALLEST_STEP, math.ceil(region.side_px / math.sqrt(_MOST_POINTS)))
    subsets = _subset_sizes(present.subset_size, region)
    ladder = _ladder(subsets[0] + 2 * least_step, region.side_px * _LARGEST_SHARE)
    for size in subsets:
        steps = {max(least_step, round(size / share)) for share in _PER_SUBSET}
        if size == present.subset_size:
            steps = {present.step_size, *(step for step in steps if step >= _ALIKE * present.step_size)}
        for step in sorted(steps):
            windows = {_window_points(gauge, size, step, present.degree) for gauge in ladder} - {None}
            for window in sorted(filter(None, windows)):
                for usual in (present, present._replace(shape_function="quadratic")):
                    found[usual._replace(subset_size=size, step_size=step, window_points=window)] = None
    return list(found)


def _subset_sizes(present: int, region: Region) -> list[int]:
    """Odd sides of subsets [px], the present one among them, in place of one alike."""
    sizes = {max(_SMALLEST_SUBSET, 2 * math.ceil((share * region.speckle_px - 1.0) / 2.0) + 1) for share in _SPECKLES}
    others = {size for size in sizes if not 1.0 / _ALIKE < size / present < _ALIKE}
    return sorted({present, *(size for size in others if size <= region.side_px * _LARGEST_SHARE)})


def _ladder(smallest: float, largest: float) -> list[float]:
    """Sides of gauges [px]."""
    count = 1 + max(0, math.floor(2.0 * math.log2(largest / smallest)))
    return [smallest * 2.0 ** (0.5 * k) for k in range(count)]


def _window_points(gauge: float, size: int, step: int, degree: int) -> int | None:
    """The odd window of the gauge next to a side [px]; None where none is near."""
    points = 2 * round((gauge - size) / step / 2.0) + 1
    least, most = max(_WINDOW_POINTS[0], degree + 2 - degree % 2), _WINDOW_POINTS[1]
    near = least <= points <= most and abs((points - 1) * step + size - gauge) <= max(step, 0.1 * gauge)
    return points if near else None
