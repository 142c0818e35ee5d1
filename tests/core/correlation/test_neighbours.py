"""Points that do not move as their neighbours do, on grids with exact motions."""

import numpy as np
import pytest

from dicflow.core.correlation.edges import Edges
from dicflow.core.correlation.follow import Field
from dicflow.core.correlation.jumps import find_jumps, predicted_by_sides
from dicflow.core.correlation.neighbours import disagreeing, predicted_by_neighbours
from dicflow.core.correlation.subsets import Subset
from dicflow.core.parts import grid_parts, single_part
from dicflow.core.status import Status

STEP = 7.0
GRID = np.stack(np.meshgrid(20.0 + STEP * np.arange(20), 20.0 + STEP * np.arange(16)), axis=-1)
ALL = np.argwhere(np.ones(GRID.shape[:2], dtype=bool))
VALID = np.zeros(GRID.shape[:2], dtype=np.uint8)


def bent(curvature=2e-4, noise_px=0.0, seed=0):
    """Affine warps (rows, cols, 2, 3) of a motion with a gradient that grows along x [1/px]."""
    x, y = GRID[..., 0], GRID[..., 1]
    warp = np.zeros((*GRID.shape[:2], 2, 3))
    warp[..., 0, 0], warp[..., 1, 0] = 1.02 * x + 0.5 * curvature * x * x, 0.99 * y + 3.0
    warp[..., 0, 1], warp[..., 1, 2] = 1.02 + curvature * x, 0.99
    warp[..., 0] += np.random.default_rng(seed).normal(0.0, noise_px, GRID.shape)
    return warp


def outliers(warp, status=VALID, parts=None, sigma_px=0.01):
    points = np.argwhere(status == Status.VALID)
    predicted = predicted_by_neighbours(points, status, warp, GRID, parts or single_part(GRID))
    found = np.zeros(VALID.shape, dtype=bool)
    place = warp[tuple(points.T)][..., 0]
    found[tuple(points.T)] = disagreeing(place, np.full(len(points), sigma_px), predicted)
    return found


@pytest.mark.parametrize("at", [(8, 10), (0, 10), (0, 0), (15, 19)])
def test_a_wrong_point_is_found_in_the_middle_and_on_the_rim(at):
    warp = bent(noise_px=0.01)
    warp[at][0, 0] += 0.4
    found = outliers(warp)
    assert found[at]
    assert found.sum() == 1


def test_a_wrong_row_on_the_rim_is_found():
    """Neighbours along the rim are wrong too, those inside outnumber them."""
    warp = bent(noise_px=0.01)
    warp[0, 4:8, 1, 0] += [0.5, -0.6, 0.9, -0.4]
    assert outliers(warp)[0, 4:8].all()
    assert outliers(warp).sum() == 4


@pytest.mark.parametrize("curvature", [0.0, 2e-4, 1e-3])
def test_curved_motion_with_noise_has_no_outliers(curvature):
    for seed in range(5):
        assert not outliers(bent(curvature, 0.02, seed), sigma_px=0.02).any()


def test_each_part_is_compared_with_itself():
    """The upper half has moved by 5 px against the lower one."""
    warp = bent()
    warp[:8, :, 1, 0] -= 5.0
    number = np.where(np.arange(16)[:, None] < 8, 1, 2) * np.ones(20, dtype=int)
    assert not outliers(warp, parts=grid_parts(GRID, number, np.zeros((0, 4)))).any()
    lonely = VALID.copy()
    lonely[8:] = Status.UNTRACKED
    lonely[9, 3] = Status.VALID
    assert not outliers(warp, lonely, grid_parts(GRID, number, np.zeros((0, 4)))).any()


def test_neighbours_predict_the_place_and_the_gradient():
    lost = VALID.copy()
    lost[5:7, 9:12] = Status.NOT_CONVERGED
    warp, points = bent(), np.argwhere(lost)
    unknown = np.where((lost > 0)[..., None, None], np.nan, warp)
    found = predicted_by_neighbours(points, lost, unknown, GRID, single_part(GRID)).warp
    np.testing.assert_allclose(found[..., 0], warp[lost > 0][..., 0], atol=0.02)
    np.testing.assert_allclose(found[..., 1:], warp[lost > 0][..., 1:], atol=3e-3)


def cracked(jump_px, noise_px=0.01):
    """A field whose motion along y jumps between the rows 7 and 8; subsets of 31 px see both sides within two rows."""
    warp = bent(noise_px=noise_px)
    share = np.clip((np.arange(16) - 7.5) * STEP / 31.0 + 0.5, 0.0, 1.0)[:, None]
    warp[..., 1, 0] += jump_px * share
    warp[..., 1, 2] += jump_px / 31.0 * ((share > 0.0) & (share < 1.0))
    return warp, np.broadcast_to((share > 0.0) & (share < 1.0), VALID.shape)


def jumps_in(warp, touching, most_off_px):
    """The jumps of a field whose points at the crack have unusual residuals, and may be off by so much.

    They may be off by four times √(2 (1 + 3 √2 / 31) / S), for residuals of 1 where 0 is usual and a slope S.
    """
    shape = VALID.shape
    slope = 32.0 * (1.0 + 3.0 * np.sqrt(2.0) / 31.0) / most_off_px**2
    field = Field(
        warp, np.full(shape, 0.01), np.zeros(shape, dtype=np.int16), VALID,
        np.broadcast_to([1e-4, 0.0, 1e-4], (*shape, 3)), np.broadcast_to([100.0, slope], (*shape, 2)),
    )  # fmt: skip
    edges = Edges(VALID, np.where(touching, 0.01, 0.0), 0.0)
    return find_jumps(edges, GRID, field, single_part(GRID), Subset(31))


@pytest.mark.parametrize("jump_px", [0.6, 2.0, -5.0])
def test_points_between_the_two_sides_of_a_jump_are_lost_or_less_certain(jump_px):
    warp, touching = cracked(jump_px)
    found = jumps_in(warp, touching, np.abs(jump_px))
    lost = found.reason == Status.DISCONTINUITY
    assert lost[touching].mean() > 0.5
    share = np.clip((np.arange(16) - 7.5) * STEP / 31.0 + 0.5, 0.0, 1.0)[:, None]
    error = np.abs(jump_px) * np.minimum(share, 1.0 - share) * np.ones(VALID.shape)
    assert (lost | (error < 3.0 * np.sqrt(found.variance + 0.01**2)))[touching].all()
    assert (found.reason[~touching] == Status.VALID).all()
    straight = jumps_in(bent(noise_px=0.01), touching, np.abs(jump_px))
    assert (straight.reason == Status.VALID).all()


@pytest.mark.parametrize("jump_px", [0.6, 2.0, -5.0])
def test_a_steep_gradient_whose_residuals_allow_for_no_second_motion_is_no_jump(jump_px):
    """The same places as across a crack, but with residuals as small as of a single motion."""
    warp, touching = cracked(jump_px)
    middle = np.abs(np.arange(16) - 7.5) < 1.0
    found = jumps_in(warp, touching, 0.05)
    assert (found.reason[middle] == Status.VALID).all()
    np.testing.assert_array_equal(found.variance[middle], 0.01)


def test_both_sides_of_a_bent_field_predict_the_same():
    sides = predicted_by_sides(ALL, VALID, bent(1e-3), GRID, single_part(GRID), 6)
    assert not sides.jump.any()
    inside = np.isfinite(sides.place).all(axis=(1, 2)).reshape(VALID.shape)
    assert inside[1:-1, 1:-1].all()
