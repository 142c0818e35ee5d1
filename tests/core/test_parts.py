"""Polygons and cuts that divide a grid of points, and the pixels of a region."""

import numpy as np
import pytest

from dicflow.core.parts import are_apart, cut_segments, islands, sees, single_part
from dicflow.core.photographs.region import (
    Polygon,
    area,
    cut_apart,
    densify_line,
    grid_points,
    interior,
    parts_of_region,
    rasterise,
    rectangle,
)

SQUARE = rectangle(0.0, 0.0, 60.0, 40.0)
ACROSS = np.array([[-5.0, 20.0], [65.0, 20.0]])
NOTCH = np.array([[-5.0, 20.0], [30.0, 20.0]])


def parts(polygons, cuts=()):
    cut = [cut_apart(polygon, cuts) for polygon in polygons]
    return parts_of_region(cut, cuts, grid_points(cut, 5))


def test_a_single_polygon_is_a_single_part():
    found = parts([SQUARE])
    assert found.is_single
    np.testing.assert_array_equal(found.number, single_part(found.places).number)


def test_polygons_that_touch_are_apart_and_their_pixels_too():
    upper, lower = rectangle(0.0, 0.0, 60.0, 20.0), rectangle(0.0, 20.0, 60.0, 40.0)
    found = parts([upper, lower])
    assert found.number[:4].max() == found.number[:4].min() == 1
    assert found.number[4:].max() == found.number[4:].min() == 2
    inside = interior([upper, lower], (45, 65))
    assert not inside[19:21].any()
    assert inside[18, 5:55].all()
    assert inside[21, 5:55].all()


def test_a_cut_across_makes_two_parts():
    found = parts([SQUARE], [ACROSS])
    assert sorted(np.unique(found.number)) == [0, 1, 2]  # points on the cut are outside
    assert np.isnan(found.places[4]).all()
    assert len(np.unique(found.number[:4])) == len(np.unique(found.number[5:])) == 1
    assert islands(found.number > 0, found).max() == 2


def test_a_cut_that_ends_inside_separates_what_does_not_see_each_other():
    found = parts([SQUARE], [NOTCH])
    assert found.number.max() == 1
    assert not found.is_single
    assert are_apart(found, 3, 2, 5, 2)
    assert not are_apart(found, 3, 8, 5, 8)
    assert not are_apart(found, 3, 2, 3, 8)
    row = sees(found.places[3, 2], found.places[5], found.cuts)
    np.testing.assert_array_equal(row[:5], False)
    assert row[11]


@pytest.mark.parametrize("line", [ACROSS, NOTCH, np.array([[10.0, -5.0], [30.0, 20.0], [20.0, 50.0]])])
def test_a_strip_is_taken_out_of_a_polygon(line):
    """Pixels farther than half a strip from the line stay, with holes and all; the others go."""
    hole = np.array([[25.0, 15.0], [35.0, 15.0], [35.0, 25.0], [25.0, 25.0]])
    before = Polygon(SQUARE.exterior, (hole,))
    y, x = np.mgrid[:45, :65]
    start, end = line[:-1], line[1:]
    along = end - start
    offset = np.stack([x, y], axis=-1)[..., None, :] - start
    share = np.clip((offset * along).sum(-1) / (along**2).sum(-1), 0.0, 1.0)
    away = np.linalg.norm(offset - share[..., None] * along, axis=-1).min(axis=-1)
    after = rasterise([cut_apart(before, [line])], (45, 65))
    was = rasterise([before], (45, 65))
    np.testing.assert_array_equal(after[away > 2.2], was[away > 2.2])
    assert not after[away < 1.4].any()


def test_the_area_without_a_strip():
    assert area([cut_apart(SQUARE, [ACROSS])]) == pytest.approx(60.0 * 37.0)


def test_points_of_a_line():
    dense = densify_line(np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 8.0]]), 4.0)
    np.testing.assert_allclose(dense, [[0, 0], [3, 0], [6, 0], [6, 4], [6, 8]])
    np.testing.assert_array_equal(cut_segments([NOTCH]), [[-5.0, 20.0, 30.0, 20.0]])
    assert cut_segments([]).shape == (0, 4)
