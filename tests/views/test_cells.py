"""Cells of a grid as pixels: the cell under each pixel's centre, without gaps, and nothing where none lies."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from dicflow.views.cells import cells_at_pixels


def grid(rows, cols, pitch, corner=(0.0, 0.0), turn=0.0):
    """A turned grid (row, col, 2) of square cells [px]."""
    row, col = np.mgrid[0:rows, 0:cols] * float(pitch)
    cos, sin = np.cos(turn), np.sin(turn)
    return np.stack([corner[0] + cos * col - sin * row, corner[1] + sin * col + cos * row], axis=-1)


def test_each_pixel_has_the_number_of_its_cell():
    index = cells_at_pixels(grid(4, 5, 3.0, corner=(1.5, 2.5)), (20, 16))
    y, x = np.mgrid[0:16, 0:20]
    col, row = np.floor((x - 1.5) / 3.0), np.floor((y - 2.5) / 3.0)
    inside = (col >= 0) & (col < 4) & (row >= 0) & (row < 3)
    np.testing.assert_array_equal(index, np.where(inside, 4 * row + col, -1))


@pytest.mark.parametrize("pitch", [0.4, 2.3, 40.0])
@pytest.mark.parametrize("turn", [0.0, 0.3, np.pi / 2, 2.5])
def test_a_turned_grid_has_no_gaps_and_ends_at_its_edge(turn, pitch):
    count = int(80 / pitch) + 1
    places = grid(count, count, pitch, corner=(150.0, 150.0), turn=turn)
    index = cells_at_pixels(places, (300, 300))
    outline = np.array([places[0, 0], places[0, -1], places[-1, -1], places[-1, 0]], np.float32)
    for y, x in np.ndindex(300, 300):
        distance = cv2.pointPolygonTest(outline, (float(x), float(y)), True)
        if abs(distance) > 1e-3:
            assert (index[y, x] >= 0) == (distance > 0)


def test_a_pixel_lies_inside_the_cell_whose_number_it_has():
    rng = np.random.default_rng(1)
    places = grid(12, 15, 7.0, corner=(4.0, 6.0)) + rng.uniform(-2.0, 2.0, (12, 15, 2))
    index = cells_at_pixels(places, (110, 90))
    corners = np.stack([places[:-1, :-1], places[:-1, 1:], places[1:, 1:], places[1:, :-1]], axis=2).reshape(-1, 4, 2)
    known = np.argwhere(index >= 0)
    assert len(known) > 5000
    for y, x in known:
        assert cv2.pointPolygonTest(corners[index[y, x]].astype(np.float32), (float(x), float(y)), True) > -1e-3


def test_a_cell_with_an_unknown_corner_is_left_out():
    places = grid(5, 5, 4.0, corner=(0.5, 0.5))
    places[2, 2, 1] = np.nan
    index = cells_at_pixels(places, (17, 17))
    assert set(np.unique(index)) == {-1, *range(16)} - {5, 6, 9, 10}
    assert (index[5:13, 5:13] == -1).all()


def test_what_lies_beyond_the_picture_is_cut_off():
    index = cells_at_pixels(grid(3, 3, 100.0, corner=(-50.0, -50.0)), (10, 6))
    assert index.shape == (6, 10)
    assert (index == 0).all()
    assert (cells_at_pixels(grid(3, 3, 5.0, corner=(1e7, -1e7)), (10, 6)) == -1).all()
    assert (cells_at_pixels(np.full((3, 3, 2), np.nan), (10, 6)) == -1).all()
