import numpy as np
import pytest

from dicflow.core.material.fit import Curve, fit, relative_errors
from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import principal_stretches
from dicflow.core.material.prediction import Guess, leave_one_out, predicted, spread_of, unsure_pairs
from dicflow.core.material.response import nominal_stress
from tests.core.material.test_models import CONSTANTS

MODES = ("uniaxial", "planar", "equibiaxial")


def curve(name, c, mode, most=2.4, count=12, noise=0.0, rng=None, u=None, **further):
    stretches = principal_stretches(mode, np.linspace(1.1, most, count))
    stress = nominal_stress(MODELS[name], np.array(c), stretches)
    sigma = noise * np.abs(stress)
    if rng is not None:
        stress = stress + sigma * rng.standard_normal(count)
    return Curve(mode, mode, stretches, stress, sigma if u is None else u, **further)


@pytest.mark.parametrize("name", MODELS)
def test_exact_curves_give_back_their_constants(name):
    truth = CONSTANTS[name]
    curves = [curve(name, truth, mode, noise=1e-3) for mode in MODES]
    found = fit(MODELS[name], curves)
    np.testing.assert_allclose(np.sort(found.constants), np.sort(truth), rtol=2e-4)
    assert max(relative_errors(found.errors, curves)) < 1e-5
    assert found.scatter == 0.0


@pytest.mark.slow
@pytest.mark.parametrize("name", ["neo_hooke", "mooney_rivlin", "yeoh", "ogden_1", "gent", "arruda_boyce"])
def test_intervals_hold_the_truth_in_95_of_100_draws(name):
    """300 draws: of a binomial count with 95 %, 99.7 % lie within ± 3.8 %."""
    truth, rng, inside = np.array(CONSTANTS[name]), np.random.default_rng(7), []
    for _ in range(300):
        curves = [curve(name, truth, mode, noise=0.01, rng=rng) for mode in MODES]
        found = fit(MODELS[name], curves)
        inside.append(np.abs(found.constants - truth) <= found.half_width)
    np.testing.assert_allclose(np.mean(inside, axis=0), 0.95, atol=0.038)


@pytest.mark.slow
def test_intervals_from_the_scatter_alone():
    truth, rng, inside = np.array(CONSTANTS["yeoh"]), np.random.default_rng(8), []
    for _ in range(300):
        curves = [curve("yeoh", truth, mode, noise=0.01, rng=rng)._replace(u_stress=None) for mode in MODES]
        found = fit(MODELS["yeoh"], curves)
        inside.append(np.abs(found.constants - truth) <= found.half_width)
    np.testing.assert_allclose(np.mean(inside, axis=0), 0.95, atol=0.038)


@pytest.mark.slow
def test_errors_of_stretch_and_section_are_in_the_intervals():
    """Each draw has errors of single stresses and stretches, and one thickness for both curves."""
    truth, rng, inside = np.array(CONSTANTS["mooney_rivlin"]), np.random.default_rng(9), []
    for _ in range(300):
        thickness, curves = 1 + 0.02 * rng.standard_normal(), []
        for mode in MODES[:2]:
            exact = curve("mooney_rivlin", truth, mode, noise=0.005, rng=rng, common_stress=0.02)
            u_stretch = np.full(12, 0.004)
            measured = exact.stretches[:, 0] + u_stretch * rng.standard_normal(12)
            stretches = principal_stretches(mode, measured)
            curves.append(exact._replace(stretches=stretches, stress=exact.stress * thickness, u_stretch=u_stretch))
        found = fit(MODELS["mooney_rivlin"], curves)
        inside.append(np.abs(found.constants - truth) <= found.half_width)
    np.testing.assert_allclose(np.mean(inside, axis=0), 0.95, atol=0.038)


def test_the_common_share_scales_moduli_and_leaves_exponents():
    curves = [curve("ogden_1", CONSTANTS["ogden_1"], mode, noise=1e-3, common_stress=0.024) for mode in MODES]
    found = fit(MODELS["ogden_1"], curves)
    share = np.sqrt(np.diag(found.common)) / np.abs(found.constants)
    np.testing.assert_allclose(share, [0.024, 0.0], atol=1e-5)


def test_more_points_shrink_the_independent_share_alone():
    few, many = (
        fit(MODELS["neo_hooke"], [curve("neo_hooke", [0.2], "uniaxial", count=n, noise=0.01, common_stress=0.02)])
        for n in (10, 1000)
    )
    assert many.independent[0, 0] < few.independent[0, 0] / 50
    assert many.common[0, 0] == pytest.approx(few.common[0, 0])


def test_scatter_beyond_the_uncertainty_is_found_and_widens_the_intervals():
    rng = np.random.default_rng(3)
    curves = [curve("neo_hooke", [0.2], mode, count=200, noise=0.05, rng=rng) for mode in MODES]
    found = fit(MODELS["neo_hooke"], [one._replace(u_stress=one.u_stress / 10) for one in curves])
    assert found.scatter == pytest.approx(0.05, rel=0.1)
    assert found.misfit_ratio == pytest.approx(100, rel=0.2)
    assert found.half_width[0] == pytest.approx(fit(MODELS["neo_hooke"], curves).half_width[0], rel=0.1)


def test_fewer_points_than_constants_are_refused():
    with pytest.raises(ValueError, match="6 points for 6 constants"):
        fit(MODELS["ogden_3"], [curve("neo_hooke", [0.2], "uniaxial", count=6)])


def test_aicc_prefers_the_true_model_to_one_with_more_constants():
    rng = np.random.default_rng(4)
    curves = [curve("mooney_rivlin", [0.15, 0.05], mode, noise=0.005, rng=rng) for mode in MODES]
    criterion = {name: fit(model, curves).aicc for name, model in MODELS.items()}
    assert min(criterion, key=criterion.get) == "mooney_rivlin"


def test_uniaxial_curves_cannot_tell_the_constants_that_all_modes_can():
    truth, rng = [0.15, 0.05], np.random.default_rng(6)
    strip = [curve("mooney_rivlin", truth, "uniaxial", most=1.6, noise=0.02, rng=rng)]
    three = [*strip, *(curve("mooney_rivlin", truth, mode, most=1.6, noise=0.02, rng=rng) for mode in MODES[1:])]
    alone, joint = (fit(MODELS["mooney_rivlin"], curves) for curves in (strip, three))
    assert [pair[:2] for pair in unsure_pairs(MODELS["mooney_rivlin"], alone.correlation)] == [("C01", "C10")]
    assert unsure_pairs(MODELS["mooney_rivlin"], joint.correlation) == []
    assert joint.condition < alone.condition / 3


def test_a_limit_that_no_point_shows_is_no_result():
    found = fit(MODELS["gent"], [curve("neo_hooke", [0.2], mode, noise=0.001) for mode in MODES])
    assert found.at_limit.tolist() == [False, True]
    assert found.half_width[1] == 0.0


def test_left_out_curves_are_predicted_by_the_true_model():
    curves = [curve("mooney_rivlin", [0.15, 0.05], mode, noise=1e-3) for mode in MODES]
    assert max(leave_one_out(MODELS["mooney_rivlin"], curves)) < 1e-4
    assert leave_one_out(MODELS["neo_hooke"], curves)[2] > 0.2


@pytest.mark.slow
def test_predictions_have_the_interval_of_many_draws():
    truth, rng, draws = [0.2, -0.01, 0.001], np.random.default_rng(2), []
    at = principal_stretches("equibiaxial", np.array([1.8]))
    for _ in range(200):
        curves = [curve("yeoh", truth, mode, noise=0.01, rng=rng) for mode in MODES[:2]]
        found = fit(MODELS["yeoh"], curves)
        draws.append((*predicted(MODELS["yeoh"], found, at),))
    stress, half = np.array(draws)[:, :, 0].T
    assert np.median(half) == pytest.approx(1.96 * stress.std(), rel=0.12)


def test_spread_is_that_of_the_guesses():
    """Two neo-Hookean moduli that differ by ± 10 % of their mean differ so in every mode."""
    curves = [curve("neo_hooke", [0.2], "uniaxial")]
    none = np.zeros((1, 1))
    guesses = [Guess(MODELS["neo_hooke"], np.array([c]), none) for c in (0.18, 0.22)]
    for one in spread_of(guesses, curves):
        assert one.percent == pytest.approx(10.0)
    assert next(one.stretch for one in spread_of(guesses, curves)) == pytest.approx(2.4)


def test_spread_is_at_the_same_invariant_in_all_modes():
    curves = [Curve("", "uniaxial", principal_stretches("uniaxial", np.array([2.0])), np.array([0.5]))]
    for one in spread_of([Guess(MODELS["neo_hooke"], np.array([0.2]), np.zeros((1, 1)))], curves):
        stretches = principal_stretches(one.mode, np.array([one.stretch]))
        assert (stretches**2).sum() == pytest.approx(5.0, abs=0.02)
        assert (
            one.least == one.most == pytest.approx(nominal_stress(MODELS["neo_hooke"], np.array([0.2]), stretches)[0])
        )
