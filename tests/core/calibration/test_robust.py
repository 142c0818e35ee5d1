import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad

from dicflow.core.calibration.robust import (
    Loss,
    cost,
    efficient_scale,
    noise_sigma,
    sigma_from_median,
    variance,
    weights,
)

KINDS = ("squares", "huber", "cauchy")
LENGTHS = st.floats(1e-3, 50.0)
SCALES = st.floats(0.1, 10.0)


@pytest.mark.parametrize("kind", KINDS)
@given(LENGTHS, SCALES)
def test_weights_are_half_the_slope_of_the_cost_over_the_length(kind, length, scale):
    loss, step = Loss(kind, scale), 1e-5 * length
    slope = (cost(loss, np.array([length + step])) - cost(loss, np.array([length - step]))) / (2.0 * step)
    assert weights(loss, np.array([length]))[0] == pytest.approx(slope / (2.0 * length), rel=1e-4)


@pytest.mark.parametrize("kind", KINDS)
@given(LENGTHS)
def test_small_residuals_count_as_squares(kind, length):
    loss = Loss(kind, 1e4 * length)
    assert cost(loss, np.array([length])) == pytest.approx(length**2, rel=1e-6)


@pytest.mark.parametrize(("kind", "far"), [("squares", 1.0), ("huber", 1e-3), ("cauchy", 1e-6)])
def test_weight_of_an_outlier(kind, far):
    assert weights(Loss(kind, 1.0), np.array([1000.0]))[0] == pytest.approx(far, rel=1e-5)


@pytest.mark.parametrize("kind", ["huber", "cauchy"])
def test_scales_keep_95_percent_efficiency(kind):
    """Variance of least squares over that of the loss, for residuals of independent normal coordinates."""
    loss = Loss(kind, efficient_scale(kind, 1.0))

    def mean(function):
        return quad(lambda r: function(r) * r * np.exp(-0.5 * r * r), 0.0, 12.0, limit=200)[0]

    def weight(r):
        return float(weights(loss, np.array([r]))[0])

    def stiffness(r):
        step = 1e-6
        return weight(r) + 0.5 * r * (weight(r + step) - weight(r - step)) / (2.0 * step)

    assert mean(stiffness) ** 2 / mean(lambda r: 0.5 * (weight(r) * r) ** 2) == pytest.approx(0.95, abs=0.001)


@pytest.mark.parametrize("kind", KINDS)
def test_variance_of_normal_residuals(kind):
    """σ² for squares, σ² / 0.95 for the others; of 40,000 residuals known to 1 %."""
    residuals = np.random.default_rng(0).normal(0.0, 0.3, (40_000, 2))
    lengths = np.hypot(*residuals.T)
    expected = 0.09 if kind == "squares" else 0.09 / 0.95
    assert variance(Loss(kind, efficient_scale(kind, 0.3)), lengths, 0) == pytest.approx(expected, rel=0.02)


def test_sigma_from_the_median_ignores_a_minority():
    lengths = np.hypot(*np.random.default_rng(1).normal(0.0, 0.2, (2, 20_000)))
    assert sigma_from_median(lengths) == pytest.approx(0.2, rel=0.02)
    lengths[:1000] = 100.0
    assert sigma_from_median(lengths) == pytest.approx(0.2, rel=0.07)
    assert noise_sigma(Loss("huber", 0.3), lengths, 0) == sigma_from_median(lengths)


def test_estimated_parameters_raise_the_variance():
    lengths = np.ones(100)
    assert variance(Loss(), lengths, 100) == pytest.approx(2.0 * variance(Loss(), lengths, 0))
    assert noise_sigma(Loss(), lengths, 100) == pytest.approx(1.0)
