import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.photographs.region import (
    Polygon,
    area,
    bounding_box,
    carry,
    contains,
    densify,
    grid_points,
    interior,
    mask_polygons,
    rasterise,
    rectangle,
    simplified,
    speckled_region,
)
from dicflow.core.photographs.texture import texture
from dicflow.kinds.region import polygons_from_json, polygons_to_json

HOLE = rectangle(8, 6, 12, 10).exterior
FRAME = [Polygon(rectangle(2, 1, 30, 21).exterior, (HOLE,))]


def test_grid_points_are_whole_pixels_of_the_region():
    points = grid_points([Polygon(FRAME[0].exterior + 0.4, (HOLE,))], 4)
    known = np.isfinite(points).all(axis=-1)
    assert points.shape == (5, 7, 2)
    np.testing.assert_array_equal(points[0, 0], (3.0, 2.0))
    np.testing.assert_array_equal(points[known], np.rint(points[known]))
    np.testing.assert_array_equal(
        known,
        contains(
            [Polygon(FRAME[0].exterior + 0.4, (HOLE,))],
            np.stack(np.meshgrid(3.0 + 4.0 * np.arange(7), 2.0 + 4.0 * np.arange(5)), axis=-1),
        ),
    )
    assert 0 < (~known).sum() < known.sum()


def star(radii, centre=(50.0, 40.0)):
    """A polygon around a centre, one corner per radius: it cannot cross itself."""
    angle = np.linspace(0, 2 * np.pi, len(radii), endpoint=False)
    return np.array(centre) + np.array(radii)[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)


RADII = st.lists(st.floats(5, 35), min_size=3, max_size=12)


def test_area_leaves_holes_out():
    assert area(FRAME) == 28 * 20 - 16


def test_area_does_not_depend_on_the_direction_of_a_ring():
    assert area([Polygon(FRAME[0].exterior[::-1], (HOLE,))]) == area(FRAME)


def test_bounding_box_spans_all_parts():
    assert bounding_box([*FRAME, rectangle(40, -3, 41, 2)]) == (2, -3, 41, 21)


def test_contains():
    points = np.array([[5.0, 5], [10, 8], [31, 5], [29, 20], [np.nan, 5]])
    assert contains(FRAME, points).tolist() == [True, False, False, True, False]


def test_regions_that_share_an_edge_share_no_point_and_lose_none():
    left, right = [rectangle(0, 0, 10, 10)], [rectangle(10, 0, 20, 10)]
    grid = np.stack(np.meshgrid(np.arange(20.0), np.arange(10.0)), axis=-1)
    assert (contains(left, grid) ^ contains(right, grid)).all()


def test_the_interior_keeps_away_from_edges_and_holes_but_not_from_the_photograph_s_border():
    region = [Polygon(rectangle(-5, 9.5, 40, 29.5).exterior, (rectangle(19.5, 14.5, 24.5, 19.5).exterior,))]
    kept = interior(region, (60, 30))
    expected = np.zeros((60, 30), dtype=bool)
    expected[11:29] = True
    expected[14:21, 19:26] = False
    np.testing.assert_array_equal(kept, expected)
    np.testing.assert_array_equal(interior(region, (60, 30), 0), rasterise(region, (60, 30)))


@settings(max_examples=60)
@given(radii=RADII, inner=RADII)
def test_rasterise_is_contains_on_the_pixel_grid(radii, inner):
    polygons = [Polygon(star(radii), (star(np.array(inner) / 8).round(),))]
    x, y = np.meshgrid(np.arange(70.0), np.arange(60.0))
    np.testing.assert_array_equal(rasterise(polygons, (60, 70)), contains(polygons, np.stack([x, y], axis=-1)))


@settings(max_examples=60)
@given(outlines=st.lists(RADII, max_size=3), decimals=st.integers(0, 2))
def test_rasterise_is_contains_for_polygons_that_overlap_and_for_none(outlines, decimals):
    """Corners on whole pixels too."""
    polygons = [
        Polygon(star(radii, (40.0 - 9.0 * k, 30.0 + 7.0 * k)).round(decimals)) for k, radii in enumerate(outlines)
    ]
    x, y = np.meshgrid(np.arange(70.0), np.arange(60.0))
    np.testing.assert_array_equal(rasterise(polygons, (60, 70)), contains(polygons, np.stack([x, y], axis=-1)))


@pytest.mark.parametrize("shape", [(0, 8), (8, 0), (0, 0)])
def test_an_image_without_pixels_has_none_in_a_region(shape):
    assert rasterise(FRAME, shape).shape == shape


def test_a_region_between_two_columns_of_pixels_has_no_grid():
    assert grid_points([rectangle(10.2, 5.0, 10.8, 50.0)], 7).shape[1] == 0


@settings(max_examples=60)
@given(radii=RADII, inner=RADII, step_size=st.integers(1, 9))
def test_grid_points_are_those_that_the_region_contains(radii, inner, step_size):
    polygons = [Polygon(star(radii), (star(np.array(inner) / 8).round(),))]
    points = grid_points(polygons, step_size)
    x0, y0, x1, y1 = bounding_box(polygons)
    axes = (np.arange(np.ceil(low), high, step_size) for low, high in ((x0, x1), (y0, y1)))
    whole = np.stack(np.meshgrid(*axes), axis=-1)
    inside = contains(polygons, whole)
    np.testing.assert_array_equal(np.isfinite(points[..., 0]), inside)
    np.testing.assert_array_equal(points[inside], whole[inside])


@settings(max_examples=60)
@given(radii=RADII)
def test_pixels_count_the_area_to_within_the_outline(radii):
    ring = star(radii)
    outline = np.linalg.norm(np.roll(ring, -1, axis=0) - ring, axis=1).sum()
    assert abs(rasterise([Polygon(ring)], (90, 100)).sum() - area([Polygon(ring)])) <= outline


@settings(max_examples=40)
@given(radii=RADII, spacing=st.floats(0.5, 20))
def test_densify_keeps_the_shape(radii, spacing):
    ring = star(radii)
    dense = densify(ring, spacing)
    assert area([Polygon(dense)]) == pytest.approx(area([Polygon(ring)]))
    assert np.linalg.norm(np.roll(dense, -1, axis=0) - dense, axis=1).max() <= spacing * (1 + 1e-9)
    assert {tuple(corner) for corner in ring} <= {tuple(point) for point in dense}


def test_carry_changes_the_area_by_the_determinant():
    stretch = np.array([[0.8, 0.1], [0.0, 1.5]])
    moved = carry(FRAME, lambda ring: ring @ stretch.T + 7, spacing_px=3.0)
    assert area(moved) == pytest.approx(area(FRAME) * 1.2)


def test_mask_to_polygons_and_back():
    x, y = np.meshgrid(np.arange(120), np.arange(100))
    mask = (np.hypot(x - 60, y - 50) < 40) & (np.hypot(x - 60, y - 50) > 15)
    polygons = mask_polygons(mask)
    assert [len(p.holes) for p in polygons] == [1]
    assert (rasterise(polygons, mask.shape) ^ mask).sum() < 0.06 * mask.sum()


def test_small_parts_of_a_mask_are_dropped_and_others_sorted_by_size():
    mask = np.zeros((60, 80), dtype=bool)
    mask[5:15, 5:25] = mask[20:55, 10:70] = mask[2, 60] = True
    assert [bounding_box([p]) for p in mask_polygons(mask)] == [(10, 20, 69, 54), (5, 5, 24, 14)]


def test_attributes_keep_a_region():
    for one, two in zip(FRAME, polygons_from_json(polygons_to_json(FRAME)), strict=True):
        for ring, other in zip(one.rings, two.rings, strict=True):
            np.testing.assert_array_equal(ring, other)


def test_speckled_specimen_is_found_with_its_opening():
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.arange(400), np.arange(360))
    specimen = (abs(x - 200) < 120) & (abs(y - 180) < 130) & (np.hypot(x - 190, y - 170) > 55)
    grain = np.kron(rng.uniform(20, 220, (90, 100)), np.ones((4, 4)))
    image = np.clip(np.where(specimen, grain, 120) + rng.normal(0, 2, x.shape), 0, 255).astype(np.uint8)
    (found,) = speckled_region(texture(image))
    assert len(found.holes) == 1
    inside = rasterise([found], image.shape)
    assert inside[~specimen].sum() < 0.03 * specimen.sum()
    assert inside[specimen].mean() > 0.8


def test_noise_is_no_specimen():
    noise = np.random.default_rng(0).normal(120, 2, (200, 200)).astype(np.uint8)
    assert speckled_region(texture(noise)) == []


def test_a_line_is_simplified_within_its_tolerance_and_a_closed_one_stays_closed():
    straight = np.stack([np.linspace(0.0, 90.0, 31), np.zeros(31)], axis=-1)
    np.testing.assert_array_equal(simplified(straight), [[0.0, 0.0], [90.0, 0.0]])
    square = np.array([[0.0, 0.0], [50.0, 0.2], [90.0, 0.0], [90.0, 60.0], [0.0, 60.0], [0.0, 0.0]])
    np.testing.assert_array_equal(simplified(square), square[[0, 2, 3, 4, 5]])
