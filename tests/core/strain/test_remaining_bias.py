"""Bias that single fits have, and that is much the same over several windows."""

import numpy as np
import pytest

from dicflow.core.strain.remaining_bias import WindowFit, relative_bias
from tests.core.strain.test_degree_choice import ALL, COL, NOISE_PX, SHAPE, STEP, WINDOW, X, measured

INSIDE = np.s_[15:-15, 15:-15]


def along_x(power, size):
    """A displacement u = size ((x − x₀) / 25 points)ᵖ [px], and ∂u/∂x."""
    x = (COL - 0.5 * (SHAPE[1] - 1)) / 25.0
    return np.stack([size * x**power, 0.0 * X], axis=-1), size * power * x ** (power - 1) / (25.0 * STEP)


def stated_over_true(power, size, degree, noise, seed=None):
    """Medians inside: bias of ∂u/∂x as stated, over the true one, and the true one in σ of the fit."""
    field, slope = along_x(power, size)
    exact, surface = measured(field), measured(field, seed, noise)
    at = np.ascontiguousarray(np.argwhere(ALL))
    found = surface.gradient(at, WINDOW, degree)
    sigma = np.sqrt(found.covariance[:, 0, 0]).reshape(SHAPE)
    true = exact.gradient(at, WINDOW, degree).gradient[:, 0, 0].reshape(SHAPE) - 1.0 - slope
    stated = sigma * np.sqrt(relative_bias(surface, WindowFit(WINDOW, degree), ALL).stated[..., 0, 0])
    return np.median((stated / np.abs(true))[INSIDE]), np.median(np.abs(true / sigma)[INSIDE])


def test_degree_3_states_the_bias_by_degree_5():
    """In whole windows it grows at least with the fourth power of the side, on grids a little more."""
    ratio, sigmas = stated_over_true(5, 4.0, 3, 1e-3 * NOISE_PX)
    assert sigmas > 1.0
    assert 1.0 < ratio < 1.35


def test_a_constant_bias_is_stated_in_full():
    """As large as σ, and several standard errors of each change, of which the largest ones count too."""
    ratio, sigmas = stated_over_true(3, 4.2, 1, NOISE_PX, seed=1)
    assert sigmas == pytest.approx(1.0, abs=0.1)
    assert ratio == pytest.approx(1.0, abs=0.07)
