import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core import cholesky
from dicflow.core.surfaces import filters
from dicflow.core.surfaces.filters import fill_moving_mean, local_polynomial, odd_window, within_reach

ROWS, COLS = 41, 33


def polynomial(coefficients, rows=ROWS, cols=COLS):
    """Σ c[a, b] rowᵃ colᵇ with its derivatives, on a grid scaled to about ±1."""
    row, col = np.meshgrid(np.linspace(-1, 1, rows), np.linspace(-1, 1, cols), indexing="ij")
    c = np.asarray(coefficients)
    value = np.polynomial.polynomial.polyval2d(row, col, c)
    d_row = np.polynomial.polynomial.polyval2d(row, col, np.polynomial.polynomial.polyder(c, axis=0)) * 2 / (rows - 1)
    d_col = np.polynomial.polynomial.polyval2d(row, col, np.polynomial.polynomial.polyder(c, axis=1)) * 2 / (cols - 1)
    return value, d_row, d_col


def test_fill_takes_the_mean_along_the_column_first():
    field = np.array([[1.0, 9.0], [np.nan, 9.0], [5.0, 9.0]])
    result = fill_moving_mean(field, window=3, passes=1)
    assert result.values[1, 0] == 3.0
    assert result.filled.tolist() == [[False, False], [True, False], [False, False]]


def test_fill_of_an_even_window_looks_further_back():
    column = np.array([[1.0], [2.0], [np.nan], [8.0], [16.0]])
    assert fill_moving_mean(column, window=4, passes=1).values[2, 0] == pytest.approx((1 + 2 + 8) / 3)


def test_fill_goes_on_along_rows_and_over_passes():
    field = np.full((1, 9), np.nan)
    field[0, 0] = 4.0
    assert np.isfinite(fill_moving_mean(field, window=3, passes=2).values).sum() == 3
    assert np.all(fill_moving_mean(field, window=3, passes=8).values == 4.0)


def test_fill_leaves_measured_points_and_those_outside():
    rng = np.random.default_rng(3)
    field = rng.normal(size=(30, 20, 3))
    holed = field.copy()
    holed[5:12, 4:9] = np.nan
    inside = np.ones((30, 20), dtype=bool)
    inside[5:8, 4:9] = False
    result = fill_moving_mean(holed, 5, 5, inside)
    known = np.isfinite(holed)
    assert np.array_equal(result.values[known], field[known])
    assert np.isnan(result.values[5:8, 4:9]).all()
    assert result.filled.sum() == 4 * 5
    assert np.isfinite(result.values[result.filled]).all()


def test_fill_lies_between_its_neighbours():
    row, col = np.mgrid[:40, :40].astype(float)
    plane = 3.0 + 0.1 * row - 0.2 * col
    holed = plane.copy()
    holed[15:25, 15:25] = np.nan
    result = fill_moving_mean(holed, 20, 5)
    assert np.abs(result.values - plane).max() < 0.1 * 10


@given(degree=st.integers(0, 5), seed=st.integers(0, 10_000), kernel=st.sampled_from(["box", "tricube"]))
@settings(max_examples=25)
def test_perfect_polynomial_with_holes(degree, seed, kernel):
    rng = np.random.default_rng(seed)
    a, b = np.indices((degree + 1, degree + 1))
    value, d_row, d_col = polynomial(np.where(a + b <= degree, rng.normal(size=a.shape), 0.0))
    holed = np.where(rng.random(value.shape) < 0.2, np.nan, value + 700.0)
    fit = local_polynomial(holed, (15, 13), degree, kernel=kernel)
    assert np.isfinite(fit.value).all()
    assert np.abs(fit.value - value - 700.0).max() < 1e-8
    assert np.abs(fit.d_row - d_row).max() < 1e-8
    assert np.abs(fit.d_col - d_col).max() < 1e-8


def test_components_and_single_planes_agree():
    field = np.random.default_rng(0).normal(size=(20, 18, 3))
    together = local_polynomial(field, (7, 5), 2)
    for index in range(3):
        alone = local_polynomial(field[..., index], (7, 5), 2)
        assert np.allclose(together.value[..., index], alone.value, atol=1e-12)


def test_leverage_of_a_full_window():
    """Degree 0 and 1 give all n points the same weight; degree 2 follows from the one-dimensional moments."""
    field = np.zeros((31, 31))
    assert local_polynomial(field, (9, 7), 0).leverage[15, 15] == pytest.approx(1 / 63)
    assert local_polynomial(field, (9, 7), 1).leverage[15, 15] == pytest.approx(1 / 63)
    row, col = (axis.ravel() for axis in np.mgrid[-4:5, -3:4])
    design = np.stack([np.ones(63), row, col, row**2, row * col, col**2], axis=1)
    assert local_polynomial(field, (9, 7), 2).leverage[15, 15] == pytest.approx(np.linalg.inv(design.T @ design)[0, 0])


@pytest.mark.parametrize("degree", [1, 2])
def test_noisy_value_and_gradient_have_the_predicted_deviation(degree):
    """Var(value) = σ² leverage; Var(slope) = σ² / Σ u² for degree 1 and 2 in a full window."""
    sigma, window = 0.3, (9, 7)
    noise = np.random.default_rng(5).normal(0, sigma, (720, 560))
    fit = local_polynomial(noise, window, degree)
    apart = (slice(4, -4, 9), slice(3, -3, 7))
    n = fit.value[apart].size
    spread = 4.0 / np.sqrt(2 * n)
    assert fit.value[apart].std() == pytest.approx(sigma * np.sqrt(fit.leverage[360, 280]), rel=spread)
    assert fit.d_row[apart].std() == pytest.approx(sigma / np.sqrt(7 * 2 * (1 + 4 + 9 + 16)), rel=spread)
    assert fit.d_col[apart].std() == pytest.approx(sigma / np.sqrt(9 * 2 * (1 + 4 + 9)), rel=spread)


def test_bias_of_degree_2_shrinks_with_the_fourth_power_of_the_window():
    wave = np.sin(np.arange(200) / 20.0)[:, None] * np.ones(9)
    errors = [np.abs(local_polynomial(wave, (n, 3), 2).value - wave)[60:140, 4].max() for n in (9, 17)]
    assert errors[1] / errors[0] == pytest.approx((17 / 9) ** 4, rel=0.1)


def test_the_order_of_rows_and_columns_does_not_matter():
    field = np.random.default_rng(8).normal(size=(24, 19))
    field[3:7, 5:6] = np.nan
    fit = local_polynomial(field, (7, 5), 2)
    flipped = local_polynomial(field[::-1, ::-1], (7, 5), 2)
    turned = local_polynomial(field.T, (5, 7), 2)
    assert np.allclose(flipped.value[::-1, ::-1], fit.value, atol=1e-11)
    assert np.allclose(flipped.d_row[::-1, ::-1], -fit.d_row, atol=1e-11)
    assert np.allclose(turned.d_row.T, fit.d_col, atol=1e-11)


def test_input_is_not_written_to():
    field = np.random.default_rng(8).normal(size=(12, 12))
    before = field.copy()
    local_polynomial(field, (5, 5), 2)
    fill_moving_mean(field, 5)
    assert np.array_equal(field, before)


def test_too_few_points_give_nan():
    field = np.full((15, 15), np.nan)
    field[7, 3:12] = 1.0
    assert np.isnan(local_polynomial(field, (5, 5), 2).value).all()
    assert np.isnan(local_polynomial(field, (5, 5), 1).value).all()
    assert local_polynomial(field, (5, 5), 0).value[7, 7] == pytest.approx(1.0)
    assert np.isnan(local_polynomial(np.full((6, 6), np.nan), (3, 3), 0).value).all()


def test_a_point_of_no_weight_has_no_influence():
    field, weights = np.ones((9, 9)), np.ones((9, 9))
    field[4, 4], weights[4, 4] = 1000.0, 0.0
    assert np.allclose(local_polynomial(field, (5, 5), 1, weights=weights).value, 1.0)


@pytest.mark.parametrize(("window", "degree"), [((4, 5), 2), ((5, 4), 2), ((5, 5), 6), ((5, 5), -1)])
def test_impossible_windows_are_refused(window, degree):
    with pytest.raises(ValueError, match="odd windows"):
        local_polynomial(np.zeros((9, 9)), window, degree)


def test_window_in_pixels():
    assert odd_window((80, 20), 5) == (17, 5)
    assert odd_window((80, 20), 3) == (27, 7)
    assert odd_window((1, 1), 5) == (3, 3)


def test_reach_is_a_distance():
    mask = np.zeros((21, 21), dtype=bool)
    assert not within_reach(mask, 5).any()
    mask[10, 10] = True
    row, col = np.mgrid[:21, :21]
    assert np.array_equal(within_reach(mask, 5.2), np.hypot(row - 10, col - 10) <= 5.2)


def test_kernel_as_plain_python():
    field = np.random.default_rng(2).normal(size=(6, 6))
    expected = local_polynomial(field, (5, 5), 2)
    kernels = [(filters, name) for name in ("_solve_all", "_solve", "_multiply", "factorise", "solve_columns")]
    with pytest.MonkeyPatch.context() as patch:
        for module, name in [*kernels, (cholesky, "solve")]:
            kernel = getattr(module, name)
            patch.setattr(module, name, getattr(kernel, "py_func", kernel))
        plain = local_polynomial(field, (5, 5), 2)
    assert np.allclose(plain.value, expected.value, atol=1e-12)


@pytest.mark.parametrize("window", [(3, 3), (3, 15), (15, 3)])
def test_a_side_with_too_few_points_for_the_degree_gives_nothing(window):
    fit = local_polynomial(np.random.default_rng(1).normal(size=(20, 20)), window, 3)
    assert np.isnan(fit.value).all()
    assert np.isnan(fit.leverage).all()


def test_whole_windows_are_fitted_as_any_other():
    """With weights that are all alike, each window solves its own equations."""
    rng = np.random.default_rng(4)
    field = rng.normal(size=(25, 21, 2))
    field[3, 5] = np.nan
    for kernel in ("box", "tricube"):
        alike = local_polynomial(field, (7, 9), 2, kernel=kernel)
        each = local_polynomial(field, (7, 9), 2, kernel=kernel, weights=np.full((25, 21), 2.0))
        for one, other in zip(alike[:3], each[:3], strict=True):
            np.testing.assert_allclose(one, other, atol=1e-13)
        np.testing.assert_allclose(alike.leverage, each.leverage, atol=1e-14)
