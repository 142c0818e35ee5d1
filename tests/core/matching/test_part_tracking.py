"""Two halves of a specimen that a crack parts, followed by exact matches."""

import numpy as np
import pytest

from dicflow.core.matching.part_tracking import MaterialGrid, RegionPlaces, Tracking, follow_region
from dicflow.core.matching.tracking import Estimation
from dicflow.core.photographs.region import carry, contains, cut_apart, grid_points, parts_of_region, rectangle

pytestmark = pytest.mark.slow

CRACK = 130.0
LINE = np.array([[20.0, CRACK], [240.0, CRACK]])
WHOLE = rectangle(20, 20, 240, 240)
HALVES = [rectangle(20, 20, 240, CRACK - 1), rectangle(20, CRACK + 1, 240, 240)]
SOURCE = np.random.default_rng(2).uniform(15, 245, (3000, 2))


def opened(width, turn=0.01):
    """The half below the crack moves away from the one above, turns, and slides along it."""
    linear = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])

    def mapping(places):
        below = (places - [130, CRACK]) @ linear.T + [130 + 0.4 * width, CRACK + width]
        return np.where(places[..., 1:] > CRACK, below, places - [0.0, 0.2 * width])

    return mapping


def material(polygons, cuts=()):
    outline = carry(polygons, lambda ring: ring, spacing_px=20.0)
    return MaterialGrid(parts_of_region(outline, cuts, grid_points(outline, 5)), outline)


def followed(grid, widths, follow="matches", mapping=opened):
    """Places of the region at each width of the crack, with the matches from the one before."""
    tracking = Tracking((2, 2), 0.25, Estimation(), follow)
    before, place, places = np.array, RegionPlaces(grid.parts.places, grid.outline), []
    for width in widths:
        after = mapping(width)
        pairs = before(SOURCE), after(SOURCE)
        place = follow_region(grid, place, pairs, pairs[0], tracking).places
        places.append(place)
        before = after
    return places


@pytest.mark.parametrize("follow", ["matches", "blend", "subset"])
@pytest.mark.parametrize(
    ("polygons", "cuts"), [(HALVES, []), ([cut_apart(WHOLE, [LINE])], [LINE])], ids=["polygons", "cut"]
)
def test_each_part_follows_its_own_matches(polygons, cuts, follow):
    grid, widths = material(polygons, cuts), (1.0, 4.0, 12.0, 40.0)
    assert grid.parts.number.max() == 2
    for width, place in zip(widths, followed(grid, widths, follow), strict=True):
        expected = opened(width)(grid.parts.places)
        assert np.isfinite(place.points[grid.parts.number > 0]).all()
        np.testing.assert_allclose(place.points, expected, atol=1e-6)
        inner = (grid.parts.number > 0) & contains([rectangle(22, 22, 238, 238)], grid.parts.places)
        assert contains(place.polygons, place.points[inner]).all()


def test_the_corners_of_the_outline_move_with_their_part():
    grid = material(HALVES)
    (place,) = followed(grid, [20.0])
    for polygon, first in zip(place.polygons, grid.outline, strict=True):
        np.testing.assert_allclose(polygon.exterior, opened(20.0)(first.exterior), atol=1e-6)


def test_beside_a_cut_that_ends_inside_the_sides_are_followed_apart():
    """The crack runs from the left edge to the middle and opens like a wedge."""
    tip = 130.0

    def wedge(width):
        def mapping(places):
            x, y = places[..., 0], places[..., 1]
            turn = np.where(y > CRACK, 1.0, -1.0) * 0.5 * width * np.clip((tip - x) / 110.0, 0.0, None)
            return np.stack([x, y + turn], axis=-1)

        return mapping

    line = np.array([[20.0, CRACK], [tip, CRACK]])
    grid = material([cut_apart(WHOLE, [line])], [line])
    assert grid.parts.number.max() == 1
    for width, place in zip((4.0, 10.0), followed(grid, (4.0, 10.0), mapping=wedge), strict=True):
        error = np.linalg.norm(place.points - wedge(width)(grid.parts.places), axis=-1)
        beside = grid.parts.places[..., 0] < tip - 40
        assert np.nanmax(error[beside]) < 0.03 * width  # blended transforms bend at the subsets' centres
        whole = material([WHOLE])
        smeared = followed(whole, (width,), mapping=wedge)[0].points - wedge(width)(whole.parts.places)
        assert np.abs(smeared[20:24, :8]).max() > 0.2 * width


def test_a_part_without_matches_is_lost_alone():
    grid = material(HALVES)
    above = SOURCE[SOURCE[:, 1] < CRACK]
    place = RegionPlaces(grid.parts.places, grid.outline)
    found = follow_region(grid, place, (above, above + 3.0), above, Tracking((2, 2), 0.25, Estimation(), "matches"))
    np.testing.assert_allclose(
        found.places.points[grid.parts.number == 1], grid.parts.places[grid.parts.number == 1] + 3
    )
    assert np.isnan(found.places.points[grid.parts.number == 2]).all()
    np.testing.assert_array_equal(found.places.polygons[1].exterior, grid.outline[1].exterior)
    assert found.tracked.transforms.shape == (4, 2, 3, 3)
