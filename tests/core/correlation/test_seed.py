import numpy as np
import pytest

from dicflow.core.correlation.seed import Pairs, seed_warps, window_correlation
from dicflow.core.correlation.warp import identity, warp_from_gradient
from dicflow.core.matching.transform import apply_transform, jacobian
from dicflow.core.parts import islands
from dicflow.core.synthetic.planar import planar_pair, translation

pytestmark = pytest.mark.slow

MIDDLE = np.array([170.0, 170.0])


def about_middle(matrix):
    transform = np.eye(3)
    transform[:2, :2] = matrix
    transform[:2, 2] = MIDDLE - np.asarray(matrix) @ MIDDLE
    return transform


def turned(angle_deg):
    angle = np.radians(angle_deg)
    return about_middle([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


def grid_with_a_hole(step=10):
    axis = np.arange(90.0, 251.0, step)
    points = np.stack(np.meshgrid(axis, axis), axis=-1)
    points[6:10, 6:10] = np.nan
    return points


def truth(transform, points):
    flat = points.reshape(-1, 2)
    warps = warp_from_gradient(apply_transform(transform, flat), jacobian(transform, flat))
    return warps.reshape(*points.shape[:-1], 2, 3)


def check(found, transform, points, slope=0.06):
    """Every point has a start; with subsets of 31 px it is off by two pixels at most at a corner."""
    inside = np.isfinite(points).all(axis=-1)
    error = np.abs(found - truth(transform, points))[inside]
    assert error[..., 0].max() < 0.8
    assert error[..., 1:].max() < slope
    assert np.isnan(found[~inside]).all()


@pytest.mark.parametrize(
    "transform",
    [
        translation((0.3, -0.4)),
        translation((110.0, -105.0)),
        about_middle(np.diag([0.88, 1.3])),
        turned(170.0),
        translation((60.0, 30.0)) @ turned(4.0),
    ],
    ids=["rest", "far", "stretch", "turned", "both"],
)
def test_starts_without_matches(transform):
    pair = planar_pair((340, 340), transform, noise=2.0)
    points = grid_with_a_hole()
    inside = apply_transform(transform, points.reshape(-1, 2)).reshape(points.shape)
    points[(np.abs(inside - MIDDLE) > 165.0).any(axis=-1)] = np.nan
    check(seed_warps(pair.reference, pair.deformed, points), transform, points)


@pytest.mark.parametrize(
    "transform",
    [
        about_middle(np.diag([0.8, 1.6])),
        about_middle(np.diag([0.75, 1.8])),
        turned(20.0) @ about_middle(np.diag([0.8, 1.6])),
        turned(20.0) @ about_middle([[1.2, 0.4], [0.4, 1.2]]),
    ],
    ids=["60 %", "80 %", "60 % and a turn", "60 % along a diagonal, and a turn"],
)
def test_starts_of_one_large_step_without_matches(transform):
    """Subsets of 31 px find their place from such starts."""
    pair = planar_pair((340, 340), transform, noise=2.0)
    points = grid_with_a_hole()
    inside = apply_transform(transform, points.reshape(-1, 2)).reshape(points.shape)
    points[(np.abs(inside - MIDDLE) > 165.0).any(axis=-1)] = np.nan
    found = seed_warps(pair.reference, pair.deformed, points)
    error = np.abs(found - truth(transform, points))[np.isfinite(points).all(axis=-1)]
    assert np.quantile(error[..., 0], 0.95) < 1.5
    assert np.quantile(error[..., 1:], 0.95) < 0.1


def test_half_of_the_matches_may_be_false():
    transform = translation((40.0, 10.0)) @ about_middle([[1.1, 0.05], [-0.05, 0.95]])
    pair = planar_pair((340, 340), transform, noise=2.0)
    rng = np.random.default_rng(2)
    source = rng.uniform(60.0, 280.0, (400, 2))
    target = apply_transform(transform, source) + rng.normal(0.0, 0.2, (400, 2))
    target[::2] = rng.uniform(0.0, 340.0, (200, 2))
    points = grid_with_a_hole()
    check(seed_warps(pair.reference, pair.deformed, points, Pairs(source, target)), transform, points)


def test_matches_that_are_all_false_do_no_harm():
    pair = planar_pair((340, 340), translation((0.4, 0.2)))
    source = np.random.default_rng(3).uniform(60.0, 280.0, (100, 2))
    points = grid_with_a_hole()
    check(seed_warps(pair.reference, pair.deformed, points, Pairs(source, source + 30.0)), pair.transform, points)


def test_each_island_has_its_own_motion():
    """Two parts of one image, one moved to the left and one to the right."""
    shifts = (48.0, 6.0), (-37.0, -4.0)
    first, second = (planar_pair((260, 150), shift, noise=1.0, seed=seed) for seed, shift in enumerate(shifts))
    reference, target = (np.vstack([getattr(pair, name) for pair in (first, second)]) for name in first._fields[:2])
    upper = np.stack(np.meshgrid(np.arange(70.0, 191.0, 10), np.arange(35.0, 116.0, 10)), axis=-1)
    gap = np.full((2, *upper.shape[1:]), np.nan)
    points = np.concatenate([upper, gap, upper + np.array([0.0, 150.0])])
    found = seed_warps(reference, target, points)[..., 0] - points
    np.testing.assert_allclose(found[:9], np.broadcast_to(shifts[0], upper.shape), atol=0.6)
    np.testing.assert_allclose(found[-9:], np.broadcast_to(shifts[1], upper.shape), atol=0.6)


def test_unrelated_photographs_give_no_starts():
    reference, other = (planar_pair((340, 340), (0.0, 0.0), seed=seed).reference for seed in (1, 2))
    assert np.isnan(seed_warps(reference, other, grid_with_a_hole())).all()
    assert np.isnan(seed_warps(reference, np.full((340, 340), 90, dtype=np.uint8), grid_with_a_hole())).all()


def test_parts_of_a_grid_are_numbered():
    points = np.zeros((4, 5, 2))
    points[:, 2] = np.nan
    np.testing.assert_array_equal(islands(np.isfinite(points).all(axis=-1))[0], [1, 1, 0, 2, 2])


def test_correlation_is_one_at_the_true_place_and_zero_beside_it():
    pair = planar_pair((340, 340), translation((20.0, 10.0)))
    centres = grid_with_a_hole().reshape(-1, 2)
    centres = centres[np.isfinite(centres[:, 0])]
    there = identity(centres)
    assert abs(window_correlation(pair.reference, pair.deformed, centres, there)) < 0.2
    there[..., 0] += (20.0, 10.0)
    assert window_correlation(pair.reference, pair.deformed, centres, there) > 0.99
    there[..., 0] += 500.0
    assert window_correlation(pair.reference, pair.deformed, centres, there) == -1.0
