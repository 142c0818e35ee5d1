from functools import cache

import numpy as np
import pytest

from dicflow.core.correlation.lattice_sums import NO_SUMS, lattice_sums
from dicflow.core.correlation.subsets import Subset, correlate, describe, with_sums
from dicflow.core.correlation.template import template
from dicflow.core.correlation.warp import identity
from dicflow.core.photographs.interpolate import spline
from dicflow.core.status import Status
from tests.scenes import texture

HEIGHT, WIDTH = 140, 171


@cache
def photograph(shift=0.0):
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    return texture(x - shift, y, 6.0)


def images():
    whole = template(spline(photograph()))
    return whole.grey, whole.by_x, whole.by_y


def lattice(x=(0, WIDTH), y=(0, HEIGHT), step=7):
    return np.stack(np.meshgrid(np.arange(*x, step), np.arange(*y, step)), axis=-1).astype(float)


def monomials(degree, xi, eta):
    return [xi ** (both - down) * eta**down for both in range(degree + 1) for down in range(both + 1)]


def sums_of_one(centre, weight, degree, level):
    """The sums over the square around a pixel, from their definition."""
    half, (x, y) = len(weight) // 2, (int(place) for place in centre)
    square = np.s_[y - half : y + half + 1, x - half : x + half + 1]
    f, fx, fy = (image[square].astype(float) for image in images())
    f -= level
    eta, xi = np.mgrid[-half : half + 1, -half : half + 1] / half
    both = np.outer(weight, weight)
    slopes = [(both * a * m).sum() for a in (fx, fy, fx * f, fy * f) for m in monomials(degree, xi, eta)]
    return slopes + [(both * a * m).sum() for a in (fx * fx, fx * fy, fy * fy) for m in monomials(2 * degree, xi, eta)]


@pytest.mark.parametrize("degree", [1, 2])
@pytest.mark.parametrize("size", [21, 31, 33])
@pytest.mark.parametrize("gaussian", [0.0, 6.0])
@pytest.mark.parametrize("step", [1, 4, 7])
def test_the_sums_are_those_of_each_square(degree, size, gaussian, step):
    half = size // 2
    offset = np.arange(-half, half + 1)
    weight = np.exp(-0.5 * (offset / gaussian) ** 2) if gaussian else np.ones(size)
    grid = lattice((half + 1, WIDTH - half), (half + 2, HEIGHT - half), step)
    found = lattice_sums(images(), grid, weight, degree)
    assert found.shape == grid.shape[:2]
    assert (found.left, found.top, found.step) == (half + 1, half + 2, step)
    for row, col in [(0, 0), (-1, -1), (1, 2), (len(grid) // 2, -2)]:
        expected = np.array(sums_of_one(grid[row, col], weight, degree, found.level))
        values = found.values.reshape(*grid.shape[:2], -1)[row, col]
        np.testing.assert_allclose(values, expected, rtol=1e-4, atol=1e-6 * np.abs(expected).max())


def test_squares_that_do_not_lie_in_the_images_are_left_out():
    found = lattice_sums(images(), lattice(), np.ones(31), 1)
    assert (found.left, found.top, found.shape) == (21, 21, (15, 20))


def test_threads_do_not_change_the_sums():
    one, three = (lattice_sums(images(), lattice(), np.ones(31), 2, threads) for threads in (1, 3))
    np.testing.assert_array_equal(one.values, three.values)


def moved(by):
    grid = lattice()
    grid[5, 5] += by
    return grid


def sparse():
    grid = lattice()
    grid[np.random.default_rng(0).random(grid.shape[:2]) > 0.3] = np.nan
    return grid


@pytest.mark.parametrize(
    "grid",
    [
        moved((1.0, 0.0)),
        lattice() + 0.5,
        lattice() * 1.1,
        sparse(),
        lattice(step=20),
        lattice()[:1, :1],
        lattice() * np.nan,
    ],
    ids=["one beside", "between pixels", "no whole step", "sparse", "far apart", "one", "none"],
)
def test_points_that_are_no_lattice_or_too_few_have_none(grid):
    assert lattice_sums(images(), grid, np.ones(31), 1) is NO_SUMS


def test_a_line_of_points_is_a_lattice():
    for grid in (lattice()[5:6], lattice()[:, 5:6]):
        assert lattice_sums(images(), grid, np.ones(31), 1).shape in [(1, 20), (15, 1)]


@pytest.mark.parametrize("shape_function", ["affine", "quadratic"])
@pytest.mark.parametrize("gaussian", [0.0, 7.0])
def test_subsets_are_found_with_the_sums_as_without(shape_function, gaussian):
    """Whole and cut ones, on the lattice and beside it."""
    region = np.ones((HEIGHT, WIDTH), dtype=bool)
    region[:, 100:104] = False
    reference, target = template(spline(photograph()), region), spline(photograph(0.4))
    subset, grid = Subset(31, shape_function, gaussian, tolerance_px=1e-6), lattice()
    _, sums = with_sums(reference, grid, subset)
    assert sums is not NO_SUMS
    centres = np.concatenate([grid.reshape(-1, 2), (grid + np.array([3.0, 0.0])).reshape(-1, 2)])
    start = identity(centres, shape_function)
    for one, other in [
        (describe(reference, None, centres, subset), describe(reference, None, centres, subset, sums=sums)),
        (
            correlate(reference, target, centres, start, subset),
            correlate(reference, target, centres, start, subset, sums=sums),
        ),
    ]:
        np.testing.assert_array_equal(one.status, other.status)
        np.testing.assert_allclose(one.warp, other.warp, atol=1e-5)
        np.testing.assert_allclose(one.covariance, other.covariance, rtol=1e-4, atol=1e-11)
        assert (one.covariance != other.covariance)[np.isfinite(one.covariance)].any()


def test_the_sums_are_what_subsets_are_found_by():
    """Twice as large ones give half the covariance."""
    reference, subset, grid = template(spline(photograph())), Subset(31), lattice()
    _, sums = with_sums(reference, grid, subset)
    centres = grid[5:8, 5:8].reshape(-1, 2)
    right, wrong = (
        describe(reference, None, centres, subset, sums=one).covariance
        for one in (sums, sums._replace(values=2.0 * sums.values))
    )
    np.testing.assert_allclose(wrong[:, [0, 2]], 0.5 * right[:, [0, 2]], rtol=0.2)


@pytest.mark.parametrize("other", [Subset(31, "quadratic"), Subset(33), Subset(31, gaussian=7.0)])
def test_sums_of_other_subsets_are_refused(other):
    reference, grid = template(spline(photograph())), lattice()
    _, sums = with_sums(reference, grid, Subset(31))
    with pytest.raises(ValueError, match="another size, weight or shape function"):
        describe(reference, None, grid[5:6, 5], other, sums=sums)


@pytest.mark.parametrize(("level", "contrast"), [(240.0, 0.05), (60_000.0, 2.0)])
def test_low_contrast_costs_no_digits(level, contrast):
    """Places by sums over the lattice and over each subset, of a pattern that is faint on a bright ground."""
    first, second = (spline((level + contrast * (photograph(by) - 128.0)).astype(np.float32)) for by in (0.0, 0.4))
    reference, grid, subset = template(first), lattice()[3:14, 3:18], Subset(31, tolerance_px=1e-5)
    centres = grid.reshape(-1, 2)
    _, sums = with_sums(reference, grid, subset)
    start = identity(centres)
    alone, shared = (correlate(reference, second, centres, start, subset, sums=one) for one in (NO_SUMS, sums))
    assert (alone.status == Status.VALID).all()
    np.testing.assert_allclose(shared.warp[..., 0], alone.warp[..., 0], atol=2e-5)
