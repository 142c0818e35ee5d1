import numpy as np
import pytest
from scipy.signal import correlate2d

from dicflow.core.uncertainty.overlap import Derivative, lag_products, mixed, overlap
from tests.noise import subset_kernel


@pytest.mark.parametrize("shape_function", ["affine", "quadratic"])
@pytest.mark.parametrize(("subset_size", "step_size"), [(21, 5), (9, 2), (15, 15), (11, 20)])
def test_overlap_is_the_autocorrelation_of_the_kernel(subset_size, step_size, shape_function):
    kernel = subset_kernel(subset_size, shape_function)
    full = correlate2d(kernel, kernel)
    middle = subset_size - 1
    rho = overlap(subset_size, step_size, shape_function)
    lag = np.arange(0, 4)
    down, across = np.meshgrid(lag, lag, indexing="ij")
    expected = [
        [full[middle + step_size * i, middle + step_size * j] if max(i, j) * step_size <= middle else 0.0 for j in lag]
        for i in lag
    ]
    assert np.abs(rho.at(down, -across) - expected).max() < 1e-12


def test_affine_subsets_overlap_by_a_triangle():
    rho = overlap(30, 6.0)
    assert rho.at(np.array([0, 1, 2, 5]), np.array([0, 0, 3, 0])) == pytest.approx([1.0, 0.8, 0.6 * 0.4, 0.0])


def test_correlation_of_a_sum_is_the_mean_by_shares():
    affine, quadratic = overlap(21, 5), overlap(21, 5, "quadratic")
    rows, cols = np.array([0, 1, 0, 3, 9]), np.array([0, 0, 2, 1, 0])
    expected = 0.7 * affine.at(rows, cols) + 0.3 * quadratic.at(rows, cols)
    assert mixed([(0.7, affine), (0.3, quadratic)]).at(rows, cols) == pytest.approx(expected)


@pytest.mark.parametrize("shape_function", ["affine", "quadratic"])
def test_variance_of_a_weighted_sum(shape_function):
    """Against the quadratic form over all pairs of points, of a sum that is wider than the correlation."""
    weights, rho = np.random.default_rng(3).normal(size=(9, 5)), overlap(21, 7, shape_function)
    row, col = np.indices(weights.shape).reshape(2, -1)
    pairs = rho.at(np.subtract.outer(row, row), np.subtract.outer(col, col))
    assert rho.variance(weights) == pytest.approx(weights.ravel() @ pairs @ weights.ravel(), rel=1e-12)


@pytest.mark.parametrize("shape_function", ["affine", "quadratic"])
def test_derivatives_reach_less_far_along_their_direction(shape_function):
    """The autocorrelation of the derivative of the kernel, averaged over an edge."""
    size, step, edge_px = 21, 5, 2.0
    kernel = np.pad(subset_kernel(size, shape_function), 1)
    edge = np.exp(-0.5 * (np.arange(-6, 7) / edge_px) ** 2)
    derived = np.apply_along_axis(lambda row: np.convolve(np.diff(row), edge), 1, kernel)
    full = correlate2d(derived, derived)
    row, col = (side - 1 for side in derived.shape)
    rho = overlap(size, step, shape_function, Derivative("across", edge_px))
    down, across = np.ogrid[:5, :5]
    expected = full[row + step * down, col + step * across] / full[row, col]
    assert np.abs(rho.at(down, across) - expected).max() < 1e-12
    assert rho.at(np.array(0), np.array(1)) < overlap(size, step, shape_function).at(np.array(0), np.array(1)) - 0.1
    turned = overlap(size, step, shape_function, Derivative("down", edge_px))
    np.testing.assert_allclose(turned.at(down, across), rho.at(down, across).T, atol=1e-12)


def test_products_of_weights_by_distance():
    """With the correlation at each distance they give the variance."""
    weights, rho = np.random.default_rng(4).normal(size=(2, 7, 5)), overlap(21, 7)
    products = lag_products(weights)
    assert rho.in_window((7, 5)) == pytest.approx(rho.at(*np.ogrid[:7, :5]), abs=1e-12)
    assert (products * rho.at(*np.ogrid[:7, :5])).sum(axis=(1, 2)) == pytest.approx(rho.variance(weights), rel=1e-9)
    np.testing.assert_allclose(rho.variance(weights), [rho.variance(one) for one in weights], rtol=1e-12)
