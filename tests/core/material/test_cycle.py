import itertools

import numpy as np
import pytest

from dicflow.core.material.cycle import cycle_of, peak_of, propagated, secant_modulus, tangent_modulus, work_along
from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import principal_stretches
from dicflow.core.material.response import stress_in_mode

YEOH, C = MODELS["yeoh"], np.array([0.2, -0.01, 0.001])


def loading(stretch):
    return stress_in_mode(YEOH, C, "uniaxial", stretch)


def energy(stretch):
    return YEOH.energy(C, principal_stretches("uniaxial", stretch))


def damaged(stretch, most):
    """Stress of unloading by a factor that falls smoothly from 1 at the largest stretch."""
    missing = 1 - energy(stretch) / energy(np.array([most]))
    return loading(stretch) * (1 - 0.5 * np.tanh(missing / 0.4))


def imposed_loop(most):
    fine = np.linspace(1, most, 20001)
    return np.trapezoid(loading(fine) - damaged(fine, most), fine)


def test_work_of_loading_is_the_energy():
    stretch = np.linspace(1, 2.3, 8)
    assert work_along(stretch, loading(stretch)) == pytest.approx(energy(stretch[-1:])[0], rel=3e-4)


def test_work_goes_with_the_square_of_the_spacing_or_better():
    exact = energy(np.array([2.3]))[0]
    errors = [abs(work_along(x := np.linspace(1, 2.3, n), loading(x)) - exact) for n in (6, 11, 21)]
    assert all(finer < coarser / 4 for coarser, finer in itertools.pairwise(errors))


@pytest.mark.parametrize("count", [7, 9, 13])
def test_loop_area_within_a_per_cent(count):
    up = np.linspace(1, 2.3, count)
    down = up[-2::-1]
    found = cycle_of(np.r_[up, down], np.r_[loading(up), damaged(down, 2.3)])
    assert found.loop == pytest.approx(imposed_loop(2.3), rel=0.01)
    assert found.loading - found.unloading == pytest.approx(found.loop)
    assert found.is_closed
    assert found.set == 0.0


def test_set_is_what_remains_without_load():
    found = cycle_of(np.array([1.0, 1.5, 2.0, 1.6, 1.08]), np.array([0.0, 0.4, 0.7, 0.3, 0.0]))
    assert found.set == pytest.approx(0.08)


def test_a_cycle_that_ends_under_load_counts_above_its_last_stretch():
    """Straight branches: a triangle between P = λ − 1 and a line from (2, 1) to (1.5, 0.25)."""
    stretch, stress = np.array([1.0, 1.25, 1.5, 1.75, 2.0, 1.75, 1.5]), np.array([0, 0.25, 0.5, 0.75, 1.0, 0.625, 0.25])
    found = cycle_of(stretch, stress)
    assert not found.is_closed
    assert found.loop == pytest.approx(0.5 * 0.25 / 2)
    assert found.set == pytest.approx(1.5 - 1.25)


def test_set_under_load_is_that_between_the_steps_of_loading():
    """Straight lines between seven steps would miss it by 0.005, since the curve is bent."""
    stretch = np.linspace(1, 2.2, 8)
    last = 1.12
    found = cycle_of(np.r_[stretch, 1.6, last + 0.03], np.r_[loading(stretch), 0.3, loading(np.array([last]))])
    assert found.set == pytest.approx(0.03, abs=0.001)


def test_a_load_that_is_held_belongs_to_loading():
    assert peak_of(np.array([0.0, 1.0, 2.0, 2.0, 1.0])) == 3
    assert peak_of(np.array([np.nan, -1.0, -2.0, -2.0, np.nan])) == 3


def test_compression_is_the_mirror_of_tension():
    up = np.array([1.0, 0.9, 0.8, 0.85, 0.95])
    stress = np.array([0.0, -0.3, -0.8, -0.4, 0.0])
    found = cycle_of(up, stress)
    assert found.loading == pytest.approx(-work_along(-up[:3], stress[:3]))
    assert found.loop > 0.0
    assert found.set == pytest.approx(-0.05)


def test_loading_alone_has_no_loop():
    found = cycle_of(np.array([1.0, 1.5, 2.0]), np.array([0.0, 0.4, 0.7]))
    assert np.isnan([found.unloading, found.loop, found.set]).all()


def test_repeated_points_do_no_work():
    stretch, stress = np.array([1.0, 1.5, 1.5, 1.5, 2.0]), np.array([0.0, 0.4, 0.4, 0.4, 0.7])
    assert work_along(stretch, stress) == pytest.approx(work_along(stretch[[0, 1, 4]], stress[[0, 1, 4]]))


def test_moduli():
    stretch = np.array([1.0, 1.2, 1.5, 1.9])
    stress = 0.7 * (stretch - 1) + 0.2 * (stretch - 1) ** 2
    np.testing.assert_allclose(secant_modulus(stretch, stress)[1:], 0.7 + 0.2 * (stretch[1:] - 1))
    assert np.isnan(secant_modulus(stretch, stress)[0])
    np.testing.assert_allclose(tangent_modulus(stretch, stress), 0.7 + 0.4 * (stretch - 1))


def test_propagated_uncertainty_is_that_of_many_draws():
    up = np.linspace(1, 2.3, 7)
    stretch, stress = np.r_[up, up[-2::-1]], np.r_[loading(up), damaged(up[-2::-1], 2.3)]
    sigma = np.r_[np.full(13, 1e-3), np.full(13, 2e-3)]
    sigma[[0, 13]] = 0.0

    def loop(x):
        return np.array([cycle_of(x[:13], x[13:]).loop])

    rng = np.random.default_rng(5)
    values = np.r_[stretch, stress]
    draws = [loop(values + sigma * rng.standard_normal(26))[0] for _ in range(400)]
    assert propagated(loop, values, sigma)[0] == pytest.approx(np.std(draws), rel=0.12)
