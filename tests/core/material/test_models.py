import numpy as np
import pytest

from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import MODES, principal_stretches
from dicflow.core.material.response import nominal_stress, stress_by_constants, stress_by_stretch, stress_in_mode

CONSTANTS = {
    "neo_hooke": [0.21],
    "mooney_rivlin": [0.18, 0.03],
    "yeoh": [0.2, -0.012, 0.0015],
    "ogden_1": [0.6, 1.3],
    "ogden_2": [0.5, 1.7, -0.02, -2.3],
    "ogden_3": [0.63, 1.3, 0.0012, 5.0, -0.01, -2.0],
    "gent": [0.4, 30.0],
    "arruda_boyce": [0.35, 3.2],
}
STRETCH = np.array([0.7, 1.0, 1.2, 1.9, 2.6])
GENERAL = principal_stretches("biaxial", np.array([1.4, 0.8, 2.0]), np.array([1.1, 1.3, 0.9]))

every_model = pytest.mark.parametrize("name", MODELS)
every_mode = pytest.mark.parametrize("mode", MODES)


def model_of(name):
    return MODELS[name], np.array(CONSTANTS[name])


def derivative(function, x, step=1e-6):
    return (function(x + step) - function(x - step)) / (2 * step)


@every_mode
def test_volume_is_kept(mode):
    np.testing.assert_allclose(principal_stretches(mode, STRETCH).prod(axis=-1), 1.0)


def test_the_modes_stretch_across_the_load_as_they_are_named():
    two = np.array([2.0])
    np.testing.assert_allclose(principal_stretches("uniaxial", two), [[2.0, 0.5**0.5, 0.5**0.5]])
    np.testing.assert_allclose(principal_stretches("planar", two), [[2.0, 1.0, 0.5]])
    np.testing.assert_allclose(principal_stretches("equibiaxial", two), [[2.0, 2.0, 0.25]])
    np.testing.assert_allclose(principal_stretches("biaxial", two, np.array([1.25])), [[2.0, 1.25, 0.4]])
    with pytest.raises(ValueError, match="'biaxial'"):
        principal_stretches("biaxial", two)


@pytest.mark.parametrize(
    ("mode", "expected"),
    [
        ("uniaxial", lambda x: x - x**-2),
        ("planar", lambda x: x - x**-3),
        ("equibiaxial", lambda x: x - x**-5),
    ],
)
def test_neo_hooke_has_the_closed_form(mode, expected):
    found = stress_in_mode(MODELS["neo_hooke"], np.array([0.21]), mode, STRETCH)
    np.testing.assert_allclose(found, 2 * 0.21 * expected(STRETCH), atol=1e-15)


def test_mooney_rivlin_has_the_closed_forms():
    """P = 2 (λ − λ⁻²)(C10 + C01/λ), 2 (λ − λ⁻⁵)(C10 + λ² C01), 2 (λ − λ⁻³)(C10 + C01)."""
    (model, c), x = model_of("mooney_rivlin"), STRETCH
    forms = {
        "uniaxial": 2 * (x - x**-2) * (c[0] + c[1] / x),
        "equibiaxial": 2 * (x - x**-5) * (c[0] + x**2 * c[1]),
        "planar": 2 * (x - x**-3) * c.sum(),
    }
    for mode, expected in forms.items():
        np.testing.assert_allclose(stress_in_mode(model, c, mode, x), expected, atol=1e-15)


def test_ogden_has_the_closed_forms():
    """P = Σ μ (λ^(α−1) − λ^e) with e = −α/2 − 1, −2α − 1, −α − 1."""
    (model, c), x = model_of("ogden_2"), STRETCH
    for mode, exponent in (("uniaxial", -0.5), ("equibiaxial", -2.0), ("planar", -1.0)):
        expected = sum(m * (x ** (a - 1) - x ** (exponent * a - 1)) for m, a in c.reshape(2, 2))
        np.testing.assert_allclose(stress_in_mode(model, c, mode, x), expected, atol=1e-15)


def test_ogden_with_2_and_minus_2_is_mooney_rivlin():
    mooney = np.array([0.18, 0.03])
    ogden = np.array([2 * 0.18, 2.0, -2 * 0.03, -2.0])
    for function in ("energy", "slopes", "curvatures"):
        one, other = (
            getattr(MODELS[name], function)(c, GENERAL) for name, c in (("mooney_rivlin", mooney), ("ogden_2", ogden))
        )
        np.testing.assert_allclose(one, other, atol=1e-14)


@every_model
@every_mode
def test_stress_is_the_slope_of_the_energy(name, mode):
    model, c = model_of(name)
    stretch = STRETCH[STRETCH != 1.0]
    slope = derivative(lambda x: model.energy(c, principal_stretches(mode, x)), stretch)
    # an equibiaxial sheet is pulled along two axes
    share = 2.0 if mode == "equibiaxial" else 1.0
    np.testing.assert_allclose(stress_in_mode(model, c, mode, stretch), slope / share, rtol=1e-7)


@every_model
def test_no_deformation_no_energy_no_stress(name):
    model, c = model_of(name)
    rest = np.ones((1, 3))
    assert model.energy(c, rest) == pytest.approx(0.0, abs=1e-14)
    assert nominal_stress(model, c, rest) == pytest.approx(0.0, abs=1e-14)


@every_model
def test_slopes_and_curvatures_are_derivatives_of_the_energy(name):
    model, c = model_of(name)
    for axis in range(3):
        unit = np.eye(3)[axis]
        moved = [GENERAL * np.exp(sign * 1e-5 * unit) for sign in (1, -1)]
        by_energy = (model.energy(c, moved[0]) - model.energy(c, moved[1])) / 2e-5
        np.testing.assert_allclose(model.slopes(c, GENERAL)[..., axis], by_energy, rtol=1e-7)
        by_slope = (model.slopes(c, moved[0]) - model.slopes(c, moved[1])) / 2e-5
        np.testing.assert_allclose(model.curvatures(c, GENERAL)[..., axis], by_slope, rtol=1e-6, atol=1e-9)


@every_model
def test_derivatives_by_the_constants(name):
    model, c = model_of(name)
    found = stress_by_constants(model, c, GENERAL)
    for index in range(len(c)):
        step = 1e-6 * abs(c[index]) * np.eye(len(c))[index]
        slope = (nominal_stress(model, c + step, GENERAL) - nominal_stress(model, c - step, GENERAL)) / (2 * step.sum())
        np.testing.assert_allclose(found[:, index], slope, rtol=2e-6, atol=1e-10)


@every_model
@every_mode
def test_derivative_by_the_stretch(name, mode):
    model, c = model_of(name)
    found = stress_by_stretch(model, c, mode, principal_stretches(mode, STRETCH))
    np.testing.assert_allclose(found, derivative(lambda x: stress_in_mode(model, c, mode, x), STRETCH), rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("neo_hooke", 2 * 0.21),
        ("mooney_rivlin", 2 * (0.18 + 0.03)),
        ("yeoh", 2 * 0.2),
        ("ogden_2", (0.5 * 1.7 + 0.02 * 2.3) / 2),
        ("ogden_3", (0.63 * 1.3 + 0.0012 * 5.0 + 0.01 * 2.0) / 2),
        ("gent", 0.4),
    ],
)
def test_initial_shear_modulus_of_each_convention(name, expected):
    model, c = model_of(name)
    assert model.shear_modulus(c) == pytest.approx(expected)


def test_initial_modulus_of_arruda_boyce_is_the_published_series():
    mu, limit = CONSTANTS["arruda_boyce"]
    terms = [1, 3 / 5, 99 / 175, 513 / 875, 42039 / 67375]
    expected = mu * sum(a / limit ** (2 * i) for i, a in enumerate(terms))
    assert MODELS["arruda_boyce"].shear_modulus(np.array([mu, limit])) == pytest.approx(expected)


@every_model
@pytest.mark.parametrize(("mode", "factor"), [("uniaxial", 3.0), ("planar", 4.0), ("equibiaxial", 6.0)])
def test_small_strains_follow_hooke(name, mode, factor):
    """dP/dλ at rest is E = 3 μ in uniaxial, 4 μ in planar and 2 E = 6 μ in equibiaxial tension."""
    model, c = model_of(name)
    slope = stress_by_stretch(model, c, mode, principal_stretches(mode, np.ones(1)))
    assert slope[0] == pytest.approx(factor * model.shear_modulus(c))


def test_gent_and_arruda_boyce_with_a_far_limit_are_neo_hooke():
    expected = stress_in_mode(MODELS["neo_hooke"], np.array([0.2]), "uniaxial", STRETCH)
    for name, far in (("gent", 1e8), ("arruda_boyce", 1e5)):
        np.testing.assert_allclose(stress_in_mode(MODELS[name], np.array([0.4, far]), "uniaxial", STRETCH), expected)
