import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import contains, densify, rectangle
from dicflow.core.surfaces.length import cloud_length, edge_pairs, edge_span, tracked_length

ROW, COL = np.mgrid[:200, :80].astype(float)
OUTLINE = rectangle(20, 30, 60, 170).exterior


def tilted(angle_deg=25.0, scale=0.1):
    """A plane turned about X, 0.1 mm per px along it."""
    y = scale * ROW
    angle = np.radians(angle_deg)
    return np.stack([scale * COL, y * np.cos(angle), 500 + y * np.sin(angle)], axis=-1)


@pytest.mark.parametrize("start", [0, 1, 2, 3])
@pytest.mark.parametrize("turned", [False, True])
def test_edges_of_a_rectangle_do_not_depend_on_its_first_corner(start, turned):
    ring = np.roll(densify(OUTLINE, 7.0), -5 * start, axis=0)
    upper, lower = edge_pairs(ring[::-1] if turned else ring)
    assert np.allclose(upper, np.stack([np.linspace(20, 60, 101), np.full(101, 30.0)], axis=-1))
    assert np.allclose(lower, np.stack([np.linspace(20, 60, 101), np.full(101, 170.0)], axis=-1))


def test_edges_of_a_sheared_outline_stay_paired():
    ring = OUTLINE @ np.array([[1.0, 0.0], [0.2, 1.0]])
    upper, lower = edge_pairs(ring)
    assert np.allclose(lower - upper, [28.0, 140.0])


@given(angle=st.floats(-50, 50))
@settings(max_examples=15)
def test_perfect_length_of_a_tilted_plane(angle):
    assert cloud_length(tilted(angle), (0.0, 0.0), edge_pairs(OUTLINE)) == pytest.approx(14.0, rel=1e-9)


def test_a_cloud_that_ends_before_the_edge_is_extrapolated():
    """A stretch that varies along the length as a parabola is continued exactly."""
    cloud = tilted()
    cloud[..., 1] += 1e-4 * ROW**2
    whole = cloud_length(cloud, (0.0, 0.0), edge_pairs(OUTLINE))
    cloud[:40], cloud[160:] = np.nan, np.nan
    assert cloud_length(cloud, (0.0, 0.0), edge_pairs(OUTLINE)) == pytest.approx(whole, rel=1e-6)


def test_a_cloud_far_from_the_edge_gives_nan():
    cloud = tilted()
    cloud[:80] = np.nan
    assert np.isnan(cloud_length(cloud, (0.0, 0.0), edge_pairs(OUTLINE)))
    assert np.isnan(cloud_length(np.full_like(cloud, np.nan), (0.0, 0.0), edge_pairs(OUTLINE)))


def test_edges_of_a_tilted_outline_are_not_mistaken_for_its_sides():
    tilted_outline = np.array([[0.0, 0.0], [10.0, 1.0], [8.0, 41.0], [-2.0, 40.0]])
    spans = edge_span(tilted_outline, np.array([0.0, 4.0, 9.0, -1.0, 11.0]))
    assert np.allclose(spans[:2], [[0.0, 40.2], [0.4, 40.6]])
    assert np.isnan(spans[2:]).any(axis=1).all()


def grid(step=5.0):
    """Material points that keep half a step from the outline."""
    y, x = np.meshgrid(np.arange(30 + step / 2, 170, step), np.arange(20 + step / 2, 60, step), indexing="ij")
    return np.stack([x, y], axis=-1)


@pytest.mark.parametrize("stretch", [0.7, 1.0, 2.2])
def test_perfect_tracked_length(stretch):
    reference = grid()
    x, y = np.moveaxis(reference, -1, 0)
    points = np.stack([0.1 * x, 0.1 * stretch * y, 500 + 0.0 * x], axis=-1)
    assert tracked_length(points, reference, OUTLINE) == pytest.approx(14.0 * stretch, rel=1e-9)


def test_tracked_length_of_an_uneven_stretch_with_lost_points():
    reference = grid()
    x, y = np.moveaxis(reference, -1, 0)
    points = np.stack([0.1 * x, 0.1 * y + 5e-4 * (y - 100) ** 2, 500 + 0.02 * y], axis=-1)
    points[:2, 3], points[10:14, 2] = np.nan, np.nan
    points[:, 5] = np.nan
    ends = np.array([[0.1 * e + 5e-4 * (e - 100) ** 2, 0.02 * e] for e in (30.0, 170.0)])
    assert tracked_length(points, reference, OUTLINE) == pytest.approx(np.linalg.norm(ends[1] - ends[0]), rel=1e-9)


def test_tracked_length_of_a_region_that_is_no_rectangle():
    """Upper edge from (20, 30) to (60, 50), lower edge at 170: a mean length of 13 mm."""
    ring = np.array([[20.0, 30.0], [60.0, 50.0], [60.0, 170.0], [20.0, 170.0]])
    reference = np.stack(np.meshgrid(np.arange(16.0, 65.0), np.arange(26.0, 180.0, 2.0)), axis=-1)
    reference[~contains([Polygon(ring)], reference)] = np.nan
    points = 0.1 * np.concatenate([reference, reference[..., :1]], axis=-1)
    assert tracked_length(points, reference, ring) == pytest.approx(13.0, rel=2e-3)


def test_tracked_length_without_points():
    reference = grid()
    assert np.isnan(tracked_length(np.full((*reference.shape[:2], 3), np.nan), reference, OUTLINE))
