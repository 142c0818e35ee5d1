"""A simple outline lies inside of the region, has no spikes, and few corners."""

from __future__ import annotations

import numpy as np
import pytest

from dicflow.core.photographs.outline import simple_outline
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import area, contains, rasterise

SHAPE = (700, 900)


def strip(*holes):
    """A strip of 200 × 500 px with a ragged edge, and spikes of 120 px that are 6 px wide."""
    rng = np.random.default_rng(3)
    y = np.arange(100.0, 601.0, 20.0)
    left = np.column_stack([300.0 + rng.uniform(-4.0, 4.0, len(y)), y])
    right = np.column_stack([500.0 + rng.uniform(-4.0, 4.0, len(y)), y])[::-1]
    spike = np.array([[620.0, 303.0], [620.0, 297.0]])
    at = int(np.argmin(np.abs(right[:, 1] - 300.0)))
    ring = np.concatenate([left, right[:at], [[500.0, 303.0]], spike, [[500.0, 297.0]], right[at + 1 :]])
    return Polygon(ring, holes)


def all_inside(found, region):
    """Whether every pixel of an outline lies in a region, the pixels of its edge included."""
    inside, whole = rasterise(found, SHAPE), rasterise([region], SHAPE)
    corners = np.concatenate([ring for polygon in found for ring in polygon.rings])
    return bool((whole | ~inside).all()) and bool(contains([region], corners).all())


def test_spikes_go_and_few_corners_stay_inside():
    region = strip()
    (found,) = simple_outline([region], SHAPE, 32)
    assert len(found.exterior) <= 12
    assert all_inside([found], region)
    assert found.exterior[:, 0].max() < 505.0
    assert area([found]) > 0.9 * 200.0 * 500.0


def test_a_hole_stays_a_hole_and_the_outline_keeps_away_from_it():
    angles = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    circle = np.column_stack([400.0 + 40.0 * np.cos(angles), 350.0 + 40.0 * np.sin(angles)])
    region = strip(circle)
    (found,) = simple_outline([region], SHAPE, 32)
    assert len(found.holes) == 1
    assert len(found.holes[0]) <= 12
    assert all_inside([found], region)


@pytest.mark.parametrize("scale", [1, 4])
def test_the_scale_of_the_photograph_does_not_matter(scale):
    shape = tuple(scale * side for side in SHAPE)
    region = Polygon(scale * strip().exterior)
    (found,) = simple_outline([region], shape, 32 * scale)
    assert area([found]) > 0.9 * 200.0 * 500.0 * scale**2


def test_a_region_that_is_narrower_everywhere_is_kept():
    thin = Polygon(np.array([[10.0, 10.0], [800.0, 10.0], [800.0, 20.0], [10.0, 20.0]]), ())
    assert simple_outline([thin], SHAPE, 32) == [thin]
