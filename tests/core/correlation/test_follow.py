import numpy as np
import pytest

from dicflow.core.correlation.follow import correlate_field
from dicflow.core.correlation.subsets import Subset, with_sums
from dicflow.core.correlation.template import template
from dicflow.core.correlation.warp import apply_warp, gradient
from dicflow.core.photographs.interpolate import spline
from dicflow.core.status import Status
from dicflow.core.synthetic.motion import reference_points
from tests.scenes import texture

pytestmark = pytest.mark.slow

ROWS, COLS, STEP, SUBSET = 29, 37, 7, Subset(21)
GRID = np.stack(np.meshgrid(20.0 + STEP * np.arange(COLS), 20.0 + STEP * np.arange(ROWS)), axis=-1)
SHAPE = (int(GRID[-1, -1, 1]) + 21, int(GRID[-1, -1, 0]) + 21)
MIDDLE = GRID[ROWS // 2, COLS // 2]


def field_of(warp):
    """A motion of the whole plane by one warp about the middle of the grid."""
    warp = np.asarray(warp)
    return lambda points: (apply_warp(warp, points - MIDDLE), gradient(warp, points - MIDDLE))


STRETCHED = field_of([[*MIDDLE[:1], 0.9, 0.05], [*MIDDLE[1:], -0.02, 1.3]])
BENT = field_of(
    [[MIDDLE[0] + 2, 1.02, 0.1, 1e-4, 3e-4, -2e-4], [MIDDLE[1] - 1, -0.1, 1.05, 2e-4, -3e-4, 1e-3]]
)  # from a fifth squeezed to a fifth stretched


def photographs(motion, margin=0, noise=0.0):
    """Reference and target, whose pixel (margin, margin) is at the reference's origin."""
    rng = np.random.default_rng(0)
    images = []
    for edge, moved in ((0, False), (margin, True)):
        height, width = SHAPE[0] + 2 * edge, SHAPE[1] + 2 * edge
        points = np.stack(np.meshgrid(np.arange(width), np.arange(height)), axis=-1).astype(float) - edge
        points = reference_points(motion, points) if moved else points
        images.append(texture(points[..., 0], points[..., 1], 6.0) + rng.normal(0, noise, (height, width)))
    return images


def seeds(motion, places, margin=0, by=(0.0, 0.0)):
    starts = np.full((ROWS, COLS, 2, 3), np.nan)
    for row, col in places:
        starts[row, col, :, 0] = motion(GRID[row, col])[0] + margin + by
        starts[row, col, :, 1:] = motion(GRID[row, col])[1]
    return starts


def follow(motion, places, grid=GRID, usable=None, margin=60, noise=0.0, by=(0.0, 0.0), subset=SUBSET, threads=1):
    reference, target = photographs(motion, margin, noise)
    starts = seeds(motion, places, margin, by)
    reference = template(spline(reference, 3), usable)
    return correlate_field(with_sums(reference, grid, subset), spline(target, 3), grid, starts, subset, threads=threads)


def error(found, motion, margin=60):
    return np.abs(found.warp[..., 0] - margin - motion(GRID)[0]).max(axis=-1)


@pytest.mark.parametrize("shape_function", ["affine", "quadratic"])
@pytest.mark.parametrize("seed", [(0, 0), (14, 18), (28, 36), (13, 3)])
def test_one_seed_fills_a_field_stretched_by_30_percent(seed, shape_function):
    found = follow(STRETCHED, [seed], by=(0.8, -0.7), subset=SUBSET._replace(shape_function=shape_function))
    assert (found.status == Status.VALID).all()
    assert error(found, STRETCHED).max() < 2e-3
    np.testing.assert_allclose(
        found.warp[..., 1:3], np.broadcast_to([[0.9, 0.05], [-0.02, 1.3]], (29, 37, 2, 2)), atol=1e-3
    )


def test_gradients_that_vary_from_place_to_place():
    slope = BENT(GRID)[1][..., 1, 1]
    assert slope.min() < 0.85
    assert slope.max() > 1.25
    found = follow(BENT, [(14, 18)], subset=SUBSET._replace(shape_function="quadratic"))
    assert (found.status == Status.VALID).all()
    assert error(found, BENT).max() < 2e-3


def test_starts_everywhere_and_one_seed_give_the_same_field():
    everywhere = list(np.ndindex(ROWS, COLS))
    dense, sparse = (follow(STRETCHED, places, noise=2.0) for places in (everywhere, [(14, 18)]))
    assert (dense.status == Status.VALID).all()
    assert (sparse.status == Status.VALID).all()
    assert np.abs(dense.warp[..., 0] - sparse.warp[..., 0]).max() < 5e-3


def test_neighbours_correct_wrong_starts():
    everywhere = list(np.ndindex(ROWS, COLS))
    reference, target = photographs(STRETCHED, 60)
    starts = seeds(STRETCHED, everywhere, 60)
    wrong = np.random.default_rng(0).random((ROWS, COLS)) < 0.3
    starts[wrong, :, 0] += [17.0, -23.0]
    found = correlate_field(
        with_sums(template(spline(reference, 3)), GRID, SUBSET), spline(target, 3), GRID, starts, SUBSET
    )
    assert (found.status == Status.VALID).all()
    assert error(found, STRETCHED).max() < 2e-3


def ringed():
    """A grid with a hole, and an island beyond the reach of the coarsest lattice; usable pixels; the island."""
    grid, island = GRID.copy(), np.zeros((ROWS, COLS), dtype=bool)
    grid[10:16, 12:20] = np.nan
    grid[:, 23:32] = np.nan
    island[:, 32:] = True
    usable = np.ones(SHAPE, dtype=bool)
    usable[int(GRID[10, 0, 1]) : int(GRID[15, 0, 1]) + 1, int(GRID[0, 12, 0]) : int(GRID[0, 19, 0]) + 1] = False
    usable[:, int(GRID[0, 23, 0]) : int(GRID[0, 31, 0]) + 1] = False
    return grid, usable, island


def test_a_hole_is_gone_around_and_an_island_needs_its_own_seed():
    grid, usable, island = ringed()
    inside = np.isfinite(grid[..., 0])
    one = follow(STRETCHED, [(12, 4)], grid, usable)
    assert (one.status[inside & ~island] == Status.VALID).all()
    assert (one.status[island] == Status.UNTRACKED).all()
    assert (one.status[~inside] == Status.OUTSIDE).all()
    assert np.isnan(one.warp[~inside | island]).all()
    two = follow(STRETCHED, [(12, 4), (20, 35)], grid, usable)
    assert (two.status[inside] == Status.VALID).all()
    assert error(two, STRETCHED)[inside].max() < 5e-3


def test_no_seed_no_field():
    found = follow(STRETCHED, [])
    assert (found.status == Status.UNTRACKED).all()
    assert np.isnan(found.warp).all()


def test_only_points_outside_the_photograph_are_lost():
    found = follow(STRETCHED, [(14, 18)], margin=0)
    place, reach = STRETCHED(GRID)[0], 1.4 * 11
    low, high = place.min(axis=-1), (np.array(SHAPE[::-1]) - 1 - place).min(axis=-1)
    well_inside, gone = (low > reach) & (high > reach), (low < 0) | (high < 0)
    assert gone.sum() > 50
    assert (found.status[well_inside] == Status.VALID).all()
    assert (found.status[gone] != Status.VALID).all()
    assert set(np.unique(found.status[gone])) <= {Status.OUTSIDE, Status.UNTRACKED, Status.NOT_CONVERGED}


def test_status_of_subsets_that_fit_badly():
    reference, target = photographs(STRETCHED, 60)
    spot = np.zeros(target.shape, dtype=bool)
    spot[150:200, 160:230] = True  # paint fell off
    target[spot] = texture(*np.mgrid[0:50, 0:70], 5.0, seed=5).ravel()
    starts = seeds(STRETCHED, [(2, 2)], 60)
    found = correlate_field(
        with_sums(template(spline(reference, 3)), GRID, SUBSET), spline(target, 3), GRID, starts, SUBSET, max_znssd=0.3
    )
    col, row = np.moveaxis((STRETCHED(GRID)[0] + 60).astype(int), -1, 0)
    hidden, clear = spot[row, col], ~spot[row, col]
    bad = found.status != Status.VALID
    assert bad[hidden].mean() > 0.7
    assert set(np.unique(found.status[bad])) <= {
        Status.LOW_CORRELATION,
        Status.NOT_CONVERGED,
        Status.UNTRACKED,
        Status.OUTLIER,
    }
    assert np.isnan(found.warp[bad]).all()
    assert np.isnan(found.covariance[bad]).all()
    assert bad[clear].mean() < 0.1
    # subsets that touch the spot are off by no more than their few wrong pixels allow
    assert error(found, STRETCHED)[clear & ~bad & (found.znssd < 1e-3)].max() < 0.02


def test_threads_give_the_same_bytes():
    one, two = (follow(STRETCHED, [(3, 4)], noise=3.0, threads=threads) for threads in (1, 2))
    for alone, shared in zip(one, two, strict=True):
        assert alone.tobytes() == shared.tobytes()
