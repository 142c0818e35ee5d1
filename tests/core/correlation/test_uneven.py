"""How much the place of a subset depends on its parts: residuals that are known exactly."""

import numpy as np
import pytest

from dicflow.core.correlation.residuals import Residuals
from dicflow.core.correlation.uneven import uneven_variance

pytestmark = pytest.mark.slow

SIZE, N = 31, 200
ROW, COL = np.mgrid[:SIZE, :SIZE].reshape(2, -1) - SIZE // 2
NOISE = 2.0


def subsets(disturbance, terms=3, noise=NOISE, weight=None):
    """Residuals of subsets after a fit, the errors (n, 2) of their places, and the variance of these by noise alone.

    disturbance : (pixel,) — grey levels that do not show the material
    """
    rng = np.random.default_rng(7)
    wave, phase = rng.normal(0.0, 0.35, (N, 12, 2)), rng.uniform(0.0, 2.0 * np.pi, (N, 12, 1))
    angle = wave[..., :1] * COL + wave[..., 1:] * ROW + phase
    f = 20.0 * np.sin(angle).sum(axis=1)
    slopes = [(20.0 * np.cos(angle) * wave[..., axis, None]).sum(axis=1) for axis in (0, 1)]
    xi, eta = COL / (SIZE // 2), ROW / (SIZE // 2)
    monomials = [np.ones(SIZE**2), xi, eta, xi * xi, xi * eta, eta * eta][:terms]
    jacobian = np.stack([slope * part for slope in slopes for part in monomials])
    weight = np.ones((N, SIZE**2)) if weight is None else np.broadcast_to(weight, (N, SIZE**2))
    wrong = disturbance + rng.normal(0.0, noise, (N, SIZE**2))
    columns = np.concatenate([jacobian, np.stack([np.ones_like(f), f])]).transpose(1, 2, 0)
    normal = np.linalg.inv(columns.transpose(0, 2, 1) @ (weight[..., None] * columns))
    fitted = (normal @ (columns.transpose(0, 2, 1) @ (weight * wrong)[..., None]))[..., 0]
    residual = wrong - (columns @ fitted[..., None])[..., 0]
    fit = Residuals(*(np.ascontiguousarray(part, dtype=np.float32) for part in (f, residual, weight, *slopes)), terms)
    places = [0, terms]
    return fit, fitted[:, places], noise**2 * normal[:, places, places]


@pytest.mark.parametrize("terms", [3, 6])
def test_noise_is_even(terms):
    """One of 16 larger parts exceeds its limit, χ² > 8 with at least one degree of freedom, in 7 % at most."""
    fit, _, by_noise = subsets(np.zeros(SIZE**2), terms)
    assert (uneven_variance(fit, SIZE) > 0.0).mean() < 0.075
    stronger, _, _ = subsets(np.zeros(SIZE**2), terms, noise=10.0 * NOISE)
    assert (uneven_variance(stronger, SIZE) > 0.0).mean() < 0.075
    assert by_noise.max() < 1e-3


@pytest.mark.parametrize("terms", [3, 6])
@pytest.mark.parametrize(("at", "radius"), [((3.0, -2.0), 3.0), ((-9.0, 8.0), 5.0), ((0.0, 14.0), 6.0)])
def test_a_spot_makes_the_place_as_uncertain_as_it_is_wrong(terms, at, radius):
    spot = 60.0 * np.exp(-(((COL - at[0]) / radius) ** 2 + ((ROW - at[1]) / radius) ** 2))
    fit, error, by_noise = subsets(spot, terms)
    sigma = np.sqrt(uneven_variance(fit, SIZE)[:, None] + by_noise)
    assert np.abs(error).max() > 0.05
    assert (np.abs(error) > 5.0 * np.sqrt(by_noise)).mean() > 0.1
    assert (np.abs(error) > 5.0 * sigma).mean() < 0.02
    assert np.sqrt(np.mean((error / sigma) ** 2)) > 0.25


def test_two_motions_are_found_along_any_line():
    """One side moves by half a pixel against the other."""
    for direction in ((1.0, 0.0), (0.0, 1.0), (0.7, 0.7), (0.7, -0.7), (0.9, 0.4)):
        still, _, _ = subsets(np.zeros(SIZE**2), noise=0.0)
        beyond = (direction[0] * COL + direction[1] * ROW > 3.0).astype(float)
        fit, error, by_noise = subsets(0.5 * still.by_x * beyond)
        sigma = np.sqrt(uneven_variance(fit, SIZE)[:, None] + by_noise)
        assert np.abs(error[:, 0]).mean() > 0.1
        assert (np.abs(error[:, 0]) > 5.0 * np.sqrt(by_noise[:, 0])).mean() > 0.9
        assert (np.abs(error) > 5.0 * sigma).mean() < 0.02


def test_pixels_that_do_not_count_change_nothing():
    kept = (COL > -6).astype(float)
    fit, _, _ = subsets(60.0 * (COL <= -6), weight=kept)
    assert (uneven_variance(fit, SIZE) > 0.0).mean() < 0.075
    nothing, _, _ = subsets(np.zeros(SIZE**2))
    weightless = nothing._replace(weight=np.zeros_like(nothing.weight))
    assert uneven_variance(weightless, SIZE).max() == 0.0


@pytest.mark.parametrize("terms", [3, 6])
def test_two_motions_put_a_place_off_by_two_misfits_at_most(terms):
    """As much on a line through the centre; nearly always within four, as the pattern is uneven (``edges.py``)."""
    still, _, _ = subsets(np.zeros(SIZE**2), noise=0.0)
    slope = np.mean(still.by_x**2 + still.by_y**2, axis=1)
    offs = {}
    for direction in ((0.0, 1.0), (0.9, 0.4)):
        for distance in (0.5, 4.5):
            beyond = (direction[0] * COL + direction[1] * ROW > distance).astype(float)
            fit, error, _ = subsets(0.5 * still.by_x * beyond, terms, noise=0.0)
            misfit = np.sqrt(2.0 * np.mean(fit.residual**2, axis=1) / slope)
            off = np.minimum(np.abs(error[:, 0]), np.abs(0.5 - error[:, 0]))
            offs[direction, distance] = off / misfit
    found = np.concatenate([*offs.values()])
    assert np.mean(found < 4.0) > 0.99
    assert np.median(offs[(0.0, 1.0), 0.5]) == pytest.approx(2.0, rel=0.15)
