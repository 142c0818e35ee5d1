import numpy as np
import pytest

from dicflow.core.material.membrane import sheet_stress, sheet_stress_by_constants
from dicflow.core.material.models import MODELS
from dicflow.core.material.modes import MODES, principal_stretches
from dicflow.core.material.response import stress_in_mode
from dicflow.core.material.virtual_fields import (
    Sheet,
    balance,
    constants_of,
    piecewise_fields,
    uniform,
)
from dicflow.synth.equilibrium import equilibrium
from tests.accuracy_sheets import GAUGE_POINTS, window_noise
from tests.core.material.test_models import CONSTANTS

MOONEY, TRUTH = MODELS["mooney_rivlin"], np.array([0.18, 0.03])
SIZES = {"strip": (20.0, 60.0), "square": (60.0, 60.0), "wide": (60.0, 20.0)}
STRETCHES = np.array([1.15, 1.4, 1.8])
STRESSES = np.array([0.15, 0.35, 0.6])
THICKNESS = 0.21


def rotation(angle):
    return np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])


@pytest.mark.parametrize("name", MODELS)
@pytest.mark.parametrize("mode", MODES)
def test_a_sheet_has_the_nominal_stress_of_its_mode(name, mode):
    model, c, stretch = MODELS[name], np.array(CONSTANTS[name]), np.array([0.9, 1.3, 1.9])
    gradient = np.zeros((3, 2, 2))
    gradient[:, 1, 1], gradient[:, 0, 0] = principal_stretches(mode, stretch).T[:2]
    stress = sheet_stress(model, c, gradient)
    np.testing.assert_allclose(stress[:, 1, 1], stress_in_mode(model, c, mode, stretch), rtol=1e-10)
    np.testing.assert_allclose(stress[:, [0, 1], [1, 0]], 0.0, atol=1e-14)
    if mode == "uniaxial":
        np.testing.assert_allclose(stress[:, 0, 0], 0.0, atol=1e-12)


@pytest.mark.parametrize("name", MODELS)
def test_stress_is_the_derivative_of_the_energy_by_the_gradient(name):
    model, c = MODELS[name], np.array(CONSTANTS[name])
    gradient = np.array([[1.2, 0.3], [-0.1, 1.5]])

    def energy(f):
        both = np.linalg.svd(f, compute_uv=False)
        return model.energy(c, np.append(both, 1 / both.prod()))

    slope = [
        [(energy(gradient + 1e-6 * unit) - energy(gradient - 1e-6 * unit)) / 2e-6 for unit in row]
        for row in np.eye(4).reshape(2, 2, 2, 2)
    ]
    np.testing.assert_allclose(sheet_stress(model, c, gradient), slope, rtol=1e-6, atol=1e-9)


def test_stress_turns_with_the_sheet():
    gradient, turn = np.array([[1.2, 0.3], [-0.1, 1.5]]), rotation(0.7)
    stress = sheet_stress(MOONEY, TRUTH, gradient)
    np.testing.assert_allclose(sheet_stress(MOONEY, TRUTH, turn @ gradient), turn @ stress)
    np.testing.assert_allclose(sheet_stress(MOONEY, TRUTH, gradient @ turn), stress @ turn)


def test_stress_is_linear_in_mooney_and_rivlins_constants():
    gradient = np.array([[1.2, 0.3], [-0.1, 1.5]])
    by_constants = sheet_stress_by_constants(MOONEY, TRUTH, gradient)
    np.testing.assert_allclose(np.tensordot(TRUTH, by_constants, 1), sheet_stress(MOONEY, TRUTH, gradient))


def homogeneous(mode, model=MOONEY, c=TRUTH):
    """A sheet with the same gradient at 6 × 6 points."""
    x, y = np.meshgrid((np.arange(6) + 0.5) * 10, (np.arange(6) + 0.5) * 10)
    gradients = np.zeros((3, 36, 2, 2))
    gradients[..., 1, 1], gradients[..., 0, 0] = principal_stretches(mode, STRETCHES).T[:2, :, None]
    forces = stress_in_mode(model, c, mode, STRETCHES) * 60.0 * THICKNESS
    return Sheet(
        np.stack([x.ravel(), y.ravel()], axis=-1), np.full(36, 100.0), gradients, forces, 60.0, 60.0, THICKNESS
    )


@pytest.mark.parametrize("name", ["neo_hooke", "mooney_rivlin", "yeoh", "ogden_1", "gent"])
def test_homogeneous_sheets_give_the_constants(name):
    model, c = MODELS[name], np.array(CONSTANTS[name])
    sheets = [homogeneous(mode, model, c) for mode in ("uniaxial", "planar")]
    for sheet in sheets:
        np.testing.assert_allclose(balance(model, c, sheet), 1.0, rtol=1e-12)
    found = constants_of(model, sheets, [[uniform(sheet)] for sheet in sheets], 1.2 * c)
    np.testing.assert_allclose(found.constants, c, rtol=1e-6)


@pytest.fixture(scope="module")
def sheets():
    """Exact fields of the three shapes, each of 24 elements along its longer side."""
    found = {}
    for name, (width, length) in SIZES.items():
        side = max(width, length) / 24
        mesh = tuple(np.linspace(0.0, extent, round(extent / side) + 1) for extent in (width, length))
        solved = equilibrium(MOONEY, TRUTH, mesh, width * STRESSES)
        found[name] = Sheet(
            solved.places, solved.areas, solved.gradients, solved.forces * THICKNESS, width, length, THICKNESS
        )
    return found


def lines(sheet, columns, rows):
    """Lines of a mesh of equal cells."""
    return np.linspace(0.0, sheet.width, columns + 1), np.linspace(0.0, sheet.length, rows + 1)


@pytest.mark.parametrize("name", SIZES)
def test_the_mean_stress_carries_the_force_whatever_the_section_does(sheets, name):
    assert np.ptp(sheets[name].gradients[-1, :, 0, 0]) > 0.05
    np.testing.assert_allclose(balance(MOONEY, TRUTH, sheets[name]), 1.0, rtol=1e-8)


@pytest.mark.parametrize("name", SIZES)
def test_virtual_fields_on_the_elements_mesh_give_the_constants(sheets, name):
    """The mesh of the virtual fields is one of the elements', so that equilibrium holds for them exactly."""
    sheet = sheets[name]
    cells = {"strip": (2, 6), "square": (4, 4), "wide": (6, 2)}[name]
    found = constants_of(MOONEY, [sheet], [piecewise_fields(sheet, *lines(sheet, *cells))], np.array([0.1, 0.1]))
    np.testing.assert_allclose(found.constants, TRUTH, rtol=1e-5)


def noisy(sheet, rng, thickness=1.0):
    """The sheet with noise of gradients and forces, and another thickness than is stated."""
    u_gradient, u_force = 2e-3, 1e-3
    gradients = sheet.gradients + u_gradient * rng.standard_normal(sheet.gradients.shape)
    forces = sheet.forces * thickness + u_force * rng.standard_normal(len(sheet.forces))
    return sheet._replace(gradients=gradients, forces=forces, u_gradient=u_gradient, u_force=u_force, u_thickness=0.024)


U_GRADIENT, U_FORCE = np.array([1e-3, 2e-3, 4e-3]), 1e-3


def with_window_noise(sheet, rng, thickness):
    """Noise of strain windows over elements of 2.5 mm; that of the photograph at rest is in all steps."""
    first, (rows, cols) = U_GRADIENT[0] / np.sqrt(2), (round(side / 2.5) for side in (sheet.length, sheet.width))
    noise = np.repeat(window_noise(4, rows, cols, rng).reshape(4, -1, 2, 2), 4, axis=1)
    gradients = sheet.gradients + first * noise[0]
    gradients = gradients + np.sqrt(U_GRADIENT**2 - first**2)[:, None, None, None] * noise[1:]
    forces = sheet.forces * thickness + U_FORCE * rng.standard_normal(3)
    return sheet._replace(
        gradients=gradients, forces=forces, u_gradient=U_GRADIENT, shared=4.0 * GAUGE_POINTS, u_force=U_FORCE,
        u_thickness=0.024,
    )  # fmt: skip


@pytest.mark.slow
def test_intervals_and_residuals_are_those_of_the_noise_of_windows(sheets):
    """100 draws: of a share of 95 %, 99.7 % are within 6.5 %, and of a standard deviation within 21 %."""
    rng, listed = np.random.default_rng(3), [sheets["strip"], sheets["wide"]]
    fields = [
        piecewise_fields(listed[0], *lines(listed[0], 1, 3)),
        piecewise_fields(listed[1], *lines(listed[1], 1, 2)),
    ]
    found = [
        constants_of(MOONEY, [with_window_noise(sheet, rng, thickness) for sheet in listed], fields, TRUTH)
        for thickness in 1.0 + 0.024 * rng.standard_normal(100)
    ]
    values, sigma = np.array([one.constants for one in found]), [np.sqrt(np.diag(one.covariance)) for one in found]
    np.testing.assert_allclose(np.mean(np.abs(values - TRUTH) <= 1.96 * np.array(sigma), axis=0), 0.95, atol=0.065)
    ratio, slope = values[:, 1] / values[:, 0], np.array([-TRUTH[1] / TRUTH[0], 1.0]) / TRUTH[0]
    stated = np.sqrt(np.mean([slope @ one.independent @ slope for one in found]))
    np.testing.assert_allclose(ratio.std(), stated, rtol=0.25)
    np.testing.assert_allclose(np.mean([one.misfit_ratio for one in found]), 1.0, atol=0.2)


def test_the_thickness_scales_all_constants_alike(sheets):
    sheet = noisy(sheets["square"], np.random.default_rng(1))
    found = constants_of(MOONEY, [sheet], [piecewise_fields(sheet, *lines(sheet, 2, 2))], np.array([0.15, 0.05]))
    np.testing.assert_allclose(np.sqrt(np.diag(found.common)), 0.024 * np.abs(found.constants), rtol=0.02)


def test_the_bias_of_the_fields_does_not_average_out_over_steps(sheets):
    """Every step four times: the variance by noise is a quarter, that by the bias what it was."""
    sheet = noisy(sheets["square"], np.random.default_rng(1))._replace(u_bias=1e-3, u_thickness=0.0, u_force=0.0)
    often = sheet._replace(
        gradients=np.repeat(sheet.gradients, 4, axis=0), forces=np.repeat(sheet.forces, 4), u_gradient=1e-2
    )
    once, repeated = (
        constants_of(MOONEY, [one], [piecewise_fields(one, *lines(one, 2, 2))], TRUTH).common for one in (sheet, often)
    )
    assert np.all(np.diag(once) > 0.0)
    np.testing.assert_allclose(repeated, once, rtol=1e-6)
    unbiased = sheet._replace(u_bias=0.0)
    assert not constants_of(MOONEY, [unbiased], [piecewise_fields(unbiased, *lines(sheet, 2, 2))], TRUTH).common.any()


def test_fewer_equations_than_constants_are_refused():
    sheet = homogeneous("uniaxial")
    one = sheet._replace(gradients=sheet.gradients[:1], forces=sheet.forces[:1])
    with pytest.raises(ValueError, match="1 equations for 2 constants"):
        constants_of(MOONEY, [one], [[uniform(one)]], TRUTH)
