"""The bias of gauges from their differences alone, against exact waves and noise."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import fftconvolve

from dicflow.core.strain.blur import difference_by_noise, estimated_bias, mean_square_differences
from dicflow.core.strain.gauge_kernel import GaugeSetting, gauge_kernel

SETTINGS = [
    GaugeSetting(size, step, shape, window, 1)
    for size, step, window in ((9, 3, 5), (9, 3, 9), (15, 5, 5), (15, 5, 9), (21, 5, 9), (21, 7, 13))
    for shape in ("affine", "quadratic")
]
KERNELS = [gauge_kernel(setting) for setting in SETTINGS]
SIDE, EDGE = 360, 60
INNER = np.s_[EDGE : SIDE - EDGE, EDGE : SIDE - EDGE]


def measured(u):
    """Strains along x of all gauges, (gauge, place)."""
    fields = [fftconvolve(u, kernel[::-1, ::-1], mode="same") for kernel in KERNELS]
    return np.stack([field[INNER][::3, ::3].ravel() for field in fields])


def displacement(strain, width):
    """A band of strain across x, and the strain itself at the places."""
    x = np.arange(SIDE) - SIDE / 2
    profile = strain * np.exp(-0.5 * (x / width) ** 2)
    u = np.cumsum(profile) - 0.5 * profile  # the integral to each pixel's middle
    field = np.broadcast_to(u, (SIDE, SIDE))
    return field, np.broadcast_to(profile, (SIDE, SIDE))[INNER][::3, ::3].ravel()


@pytest.mark.parametrize("width", [12.0, 20.0, 40.0])
def test_the_bias_without_noise(width):
    u, truth = displacement(0.02, width)
    strains = measured(u)
    bias = np.sqrt(np.mean((strains - truth) ** 2, axis=1))
    none = np.zeros((len(KERNELS), len(KERNELS)))
    found = estimated_bias(mean_square_differences(strains), none, KERNELS, (SIDE - 2 * EDGE) ** 2)
    large = bias > 0.2 * bias.max()
    assert found[large] == pytest.approx(bias[large], rel=0.2)
    assert found[~large] == pytest.approx(bias[~large], abs=0.1 * bias.max())


def test_noise_alone_is_not_taken_for_bias():
    rng = np.random.default_rng(2)
    strains = measured(0.02 * rng.normal(size=(SIDE, SIDE)))
    sigma = 0.02 * np.array([np.sqrt((kernel**2).sum()) for kernel in KERNELS])
    assert strains.std(axis=1) == pytest.approx(sigma, rel=0.3)
    found = estimated_bias(
        mean_square_differences(strains), difference_by_noise(sigma, KERNELS), KERNELS, (SIDE - 2 * EDGE) ** 2
    )
    assert (found < 0.5 * sigma).all()


def test_the_least_error_is_found_beneath_noise():
    """The gauge of least estimated error has an error within 10 % of the least true one, at noise low and high."""
    rng = np.random.default_rng(3)
    u, truth = displacement(0.02, 25.0)
    for noise in (0.005, 0.02, 0.05):
        strains = measured(u + noise * rng.normal(size=(SIDE, SIDE)))
        sigma = noise * np.array([np.sqrt((kernel**2).sum()) for kernel in KERNELS])
        error = np.sqrt(np.mean((strains - truth) ** 2, axis=1))
        by_noise = difference_by_noise(sigma, KERNELS)
        bias = estimated_bias(mean_square_differences(strains), by_noise, KERNELS, (SIDE - 2 * EDGE) ** 2)
        assert error[np.hypot(sigma, bias).argmin()] <= 1.1 * error.min()
