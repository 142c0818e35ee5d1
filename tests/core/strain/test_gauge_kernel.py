"""The gauge as a filter: slopes of polynomials are exact, and noise and waves follow from its kernel."""

from __future__ import annotations

import numpy as np
import pytest

from dicflow.core.strain.gauge_kernel import GaugeSetting, gauge_kernel, kept_of_waves, noise_correlation

SETTINGS = [
    GaugeSetting(21, 5, "affine", 7, 1),
    GaugeSetting(21, 5, "quadratic", 7, 1),
    GaugeSetting(15, 4, "affine", 9, 3),
    GaugeSetting(31, 1, "quadratic", 3, 1),
]


def places(kernel):
    half = (len(kernel) - 1) / 2
    return np.meshgrid(np.arange(len(kernel)) - half, np.arange(len(kernel)) - half)


@pytest.mark.parametrize("setting", SETTINGS)
def test_the_slope_of_a_plane_is_exact(setting):
    kernel = gauge_kernel(setting)
    x, y = places(kernel)
    assert len(kernel) == setting.side_px
    assert (kernel * (0.3 + 0.02 * x - 0.05 * y)).sum() == pytest.approx(0.02, abs=1e-12)


@pytest.mark.parametrize("shape", ["affine", "quadratic"])
def test_a_cubic_window_keeps_the_slope_of_a_cubic_beyond_what_its_subsets_blur(shape):
    setting = GaugeSetting(15, 4, shape, 9, 3)
    kernel = gauge_kernel(setting)
    x, _ = places(kernel)
    blurred = 0.0 if shape == "quadratic" else 3.0 * (15**2 - 1) / 12  # mean of (x + e)³ over a subset: x³ + 3 x <e²>
    assert (kernel * x**3).sum() == pytest.approx(blurred, abs=1e-6)


def test_of_one_point_in_each_pixel_the_noise_is_that_of_a_regression():
    """Subsets of one pixel, n × n of them: Σ K² = 1/Σ x² = 12/(n² (n² − 1))."""
    kernel = gauge_kernel(GaugeSetting(1, 1, "affine", 11, 1))
    assert (kernel**2).sum() == pytest.approx(12 / (11**2 * (11**2 - 1)), rel=1e-12)


@pytest.mark.slow
def test_errors_of_gauges_are_correlated_as_simulated_noise_is():
    kernels = [gauge_kernel(setting) for setting in SETTINGS]
    rng = np.random.default_rng(1)
    side = max(map(len, kernels))
    noise = rng.normal(size=(20_000, side, side)).astype(np.float32)
    strains = []
    for kernel in kernels:
        edge = (side - len(kernel)) // 2
        inner = noise[:, edge : side - edge, edge : side - edge]
        strains.append(np.tensordot(inner, kernel, axes=2))
    assert noise_correlation(kernels) == pytest.approx(np.corrcoef(strains), abs=0.03)


def test_long_waves_are_kept_and_a_window_of_points_keeps_of_a_wave_what_a_regression_does():
    setting = GaugeSetting(1, 1, "affine", 25, 1)
    periods = np.array([12.5, 40.0, 1e6])
    along, across = kept_of_waves(gauge_kernel(setting), periods)
    x, turn = np.arange(-12, 13), 2 * np.pi / periods[:, None]
    assert along == pytest.approx((np.sin(turn * x) * x).sum(axis=1) / turn[:, 0] / (x**2).sum(), rel=1e-9)
    assert across == pytest.approx(np.cos(turn * x).mean(axis=1), abs=1e-9)
    assert along[-1] == pytest.approx(1.0, abs=1e-6)
