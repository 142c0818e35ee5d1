import numpy as np
import pytest

from dicflow.core.matching.tracking import (
    Estimation,
    carry_points,
    deviations,
    follow_matches,
    nearest_subset,
    subset_grid,
    track_subsets,
)
from dicflow.core.matching.transform import apply_transform
from dicflow.core.photographs.polygon import Polygon
from dicflow.core.photographs.region import rectangle

BOX = (20.0, 10.0, 320.0, 250.0)
REGION = [rectangle(*BOX)]
AFFINE = np.array([[0.85, 0.03, 12.0], [-0.02, 1.39, -40.0], [0, 0, 1]])
SOURCE = np.random.default_rng(0).uniform(BOX[:2], BOX[2:], (900, 2))
GRID = subset_grid(BOX, (3, 4), 0.25)


def track(target, source=SOURCE, grid=GRID, region=REGION, **options):
    return track_subsets(grid, region, source, target, source, Estimation(**options))


def following(transforms, source, target, points):
    return follow_matches(GRID, transforms, deviations(GRID, transforms, source, target), points)


def test_subsets_tile_the_box_and_overlap():
    np.testing.assert_allclose(GRID.x, [57.5, 132.5, 207.5, 282.5])
    np.testing.assert_allclose(GRID.y, [50, 130, 210])
    memberships = sum(GRID.members(i, j, SOURCE).astype(int) for i, j in np.ndindex(3, 4))
    assert memberships.min() == 1
    assert memberships.max() == 4
    alone = subset_grid(BOX, (3, 4), 0.0)
    assert sum(alone.members(i, j, SOURCE).astype(int) for i, j in np.ndindex(3, 4)).tolist() == [1] * 900


@pytest.mark.parametrize("kind", ["affine", "projective"])
def test_perfect_affine_motion(kind):
    found = track(apply_transform(AFFINE, SOURCE), kind=kind)
    np.testing.assert_allclose(found.transforms, np.broadcast_to(AFFINE, (3, 4, 3, 3)), atol=1e-9)
    assert (found.inliers == found.matches).all()
    assert (found.matches == found.features).all()
    assert found.residual_px.max() < 1e-9
    assert not found.filled.any()


def test_a_subset_with_too_few_matches_is_filled_and_marked():
    lonely = ~GRID.members(1, 1, SOURCE)
    lonely[np.flatnonzero(~lonely)[:4]] = True
    found = track(apply_transform(AFFINE, SOURCE)[lonely], SOURCE[lonely])
    np.testing.assert_array_equal(np.argwhere(found.filled), [[1, 1]])
    np.testing.assert_allclose(found.transforms[1, 1], AFFINE, atol=1e-9)
    assert np.isnan(found.residual_px[1, 1])


@pytest.mark.parametrize("wrong", [np.diag([-1.0, 1.0]), 2.5 * np.eye(2), 0.4 * np.eye(2)])
def test_a_transform_that_folds_or_changes_the_area_is_replaced(wrong):
    target = apply_transform(AFFINE, SOURCE)
    inner = (np.abs(SOURCE - [57.5, 50]) < [56, 60]).all(axis=1)
    target[inner] = (SOURCE[inner] - [57.5, 50]) @ (AFFINE[:2, :2] @ wrong).T + [60, 30]
    found = track(target)
    assert found.filled[0, 0]
    assert found.filled.sum() == 1
    assert np.linalg.det(found.transforms[0, 0, :2, :2]) > 0


def test_nothing_is_tracked_without_matches():
    assert track(SOURCE[:3], SOURCE[:3]) is None


def test_matches_outside_the_region_do_not_count():
    half = [rectangle(20, 10, 170, 250)]
    target = apply_transform(AFFINE, SOURCE)
    target[SOURCE[:, 0] > 170] += 80
    found = track(target, region=half)
    assert found.matches.sum() == found.inliers.sum()
    np.testing.assert_array_equal(found.empty, [[False, False, True, True]] * 3)
    assert not found.filled.any()


def test_a_subset_in_a_hole_is_empty():
    hole = rectangle(90, 85, 175, 175).exterior
    found = track(apply_transform(AFFINE, SOURCE), region=[Polygon(REGION[0].exterior, (hole,))])
    np.testing.assert_array_equal(np.argwhere(found.empty), [[1, 1]])


def test_two_runs_give_equal_bytes():
    target = apply_transform(AFFINE, SOURCE) + np.random.default_rng(2).normal(0, 1, SOURCE.shape)
    assert track(target).transforms.tobytes() == track(target).transforms.tobytes()
    assert track(target).transforms.tobytes() != track(target, seed=1).transforms.tobytes()


def random_transforms(seed=0):
    transforms = np.broadcast_to(np.eye(3), (3, 4, 3, 3)).copy()
    transforms[..., :2, 2] = np.random.default_rng(seed).normal(0, 5, (3, 4, 2))
    return transforms


def test_blending_is_continuous_and_exact_at_the_centres():
    transforms = random_transforms()
    centres = np.stack(np.meshgrid(GRID.x, GRID.y), axis=-1)
    np.testing.assert_allclose(carry_points(GRID, transforms, centres), centres + transforms[..., :2, 2])
    line = np.linspace([0.0, 0.0], [340, 260], 5001)
    steps = np.diff(carry_points(GRID, transforms, line) - line, axis=0)
    assert np.abs(steps).max() < 0.05


def test_without_blending_each_point_follows_its_own_subset():
    transforms = random_transforms()
    row, column = nearest_subset(GRID, SOURCE)
    for i, j in np.ndindex(3, 4):
        own = (row == i) & (column == j)
        np.testing.assert_array_equal(own, subset_grid(BOX, (3, 4), 0.0).members(i, j, SOURCE))
        expected = SOURCE[own] + transforms[i, j, :2, 2]
        np.testing.assert_allclose(carry_points(GRID, transforms, SOURCE, blend=False)[own], expected)


def test_one_subset_carries_everything():
    grid = subset_grid(BOX, (1, 1), 0.0)
    carried = carry_points(grid, AFFINE[None, None], SOURCE)
    np.testing.assert_allclose(carried, apply_transform(AFFINE, SOURCE))


def test_following_the_matches_resolves_motion_within_a_subset():
    def neck(points):
        x, y = points.T
        return np.stack([x, y + 15 * np.tanh((y - 130) / 40)], axis=1)

    source = np.random.default_rng(1).uniform(BOX[:2], BOX[2:], (4000, 2))
    found = track(neck(source), source)
    points = np.random.default_rng(3).uniform([60, 50], [280, 210], (300, 2))
    blended = carry_points(GRID, found.transforms, points) - neck(points)
    followed = following(found.transforms, source, neck(source), points) - neck(points)
    reach = np.sqrt(25 / (np.pi * 4000 / (300 * 240)))  # of the 25 matches around a point
    assert (
        np.abs(followed).max() < 0.25 * 15 * 0.77 / 40**2 * reach**2 * 1.5
    )  # ½ u'' times the weights' mean d² ≈ reach²/2
    assert np.abs(blended).max() > 5 * np.abs(followed).max()


def test_unknown_points_stay_unknown():
    points = np.array([[[50.0, 60.0], [np.nan, np.nan]]])
    for carried in (
        carry_points(GRID, random_transforms(), points),
        following(random_transforms(), SOURCE, SOURCE, points),
    ):
        np.testing.assert_array_equal(np.isnan(carried), np.isnan(points))
