import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import logm, sqrtm

from dicflow.core.strain import measures as module
from dicflow.core.strain.measures import (
    GradientMeasures,
    almansi_strain,
    biot_strain,
    green_lagrange_strain,
    hencky_strain,
    principal_stretches,
)

FUNCTIONS = {
    "engineering": None,
    "green_lagrange": green_lagrange_strain,
    "hencky": hencky_strain,
    "euler_almansi": almansi_strain,
    "biot": biot_strain,
}
MEASURES = tuple(FUNCTIONS)
TENSORS = MEASURES[1:]
number = st.floats(-0.6, 0.6)
GRADIENTS = st.tuples(number, number, number, number).map(
    lambda m: np.eye(2) * 1.5 + np.array([[m[0], m[1]], [m[2], m[3]]])
)


def deformation_measures(gradient, measure="engineering", directions="material"):
    return module.deformation_measures(gradient, FUNCTIONS[measure], directions)


def strain_components(gradient, measure, directions):
    return module.strain_components(gradient, FUNCTIONS[measure], directions)


def turn(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return np.array([[c, -s], [s, c]])


def tensor(gradient, measure, directions):
    """The measure by matrix functions of scipy."""
    square = gradient.T @ gradient if directions == "material" else gradient @ gradient.T
    one = np.eye(2)
    return {
        "green_lagrange": lambda: (square - one) / 2,
        "hencky": lambda: np.real(logm(square)) / 2,
        "euler_almansi": lambda: (one - np.linalg.inv(square)) / 2,
        "biot": lambda: np.real(sqrtm(square)) - one,
    }[measure]()


@given(gradient=GRADIENTS, measure=st.sampled_from(TENSORS), directions=st.sampled_from(["material", "global"]))
@settings(max_examples=60)
def test_tensors_are_the_matrix_functions(gradient, measure, directions):
    expected = tensor(gradient, measure, directions)
    found = np.array(strain_components(gradient, measure, directions))
    assert np.abs(found - [expected[0, 0], expected[1, 1], 2 * expected[0, 1]]).max() < 1e-9
    values, vectors = np.linalg.eigh(expected)
    result = deformation_measures(gradient, measure, directions)
    assert np.abs(np.array([result.e2, result.e1]) - values).max() < 1e-9
    if values[1] - values[0] > 1e-3:
        along = np.radians(result.angle)
        assert abs(vectors[:, 1] @ [np.cos(along), np.sin(along)]) == pytest.approx(1.0, abs=1e-9)


@given(gradient=GRADIENTS, degrees=st.floats(-170.0, 170.0), measure=st.sampled_from(MEASURES))
@settings(max_examples=60)
def test_a_rotation_after_the_deformation_changes_no_material_strain(gradient, degrees, measure):
    before, after = deformation_measures(gradient, measure), deformation_measures(turn(degrees) @ gradient, measure)
    for name in ("exx", "eyy", "gxy", "e1", "e2", "von_mises", "area_change"):
        assert getattr(after, name) == pytest.approx(getattr(before, name), abs=1e-9)
    around = (after.rotation - before.rotation - degrees + 180.0) % 360.0 - 180.0
    assert around == pytest.approx(0.0, abs=1e-7)


@given(gradient=GRADIENTS, degrees=st.floats(-170.0, 170.0), measure=st.sampled_from(MEASURES))
@settings(max_examples=60)
def test_a_rotation_before_the_deformation_changes_no_global_strain(gradient, degrees, measure):
    before = strain_components(gradient, measure, "global")
    after = strain_components(gradient @ turn(degrees), measure, "global")
    assert np.abs(np.array(after) - np.array(before)).max() < 1e-9


@pytest.mark.parametrize("directions", ["material", "global"])
@pytest.mark.parametrize("measure", MEASURES)
def test_all_agree_where_strains_are_small(measure, directions):
    small = 1e-5 * np.array([[3.0, -1.0], [2.0, -1.5]])
    strain = strain_components(np.eye(2) + small, measure, directions)
    assert np.abs(np.array(strain) - 1e-5 * np.array([3.0, -1.5, 1.0])).max() < 2 * 3e-5**2


@pytest.mark.parametrize(
    ("measure", "along", "across"),
    [
        ("engineering", 1.3, 2.3**-0.5 - 1),
        ("biot", 1.3, 2.3**-0.5 - 1),
        ("hencky", np.log(2.3), -np.log(2.3) / 2),
        ("green_lagrange", (2.3**2 - 1) / 2, (1 / 2.3 - 1) / 2),
        ("euler_almansi", (1 - 2.3**-2) / 2, (1 - 2.3) / 2),
    ],
)
def test_uniaxial_stretch_of_2_3(measure, along, across):
    result = deformation_measures(turn(20) @ np.diag([2.3**-0.5, 2.3]), measure)
    assert result.eyy == pytest.approx(along)
    assert result.exx == pytest.approx(across)
    assert result.e1 == pytest.approx(along)
    assert result.e2 == pytest.approx(across)
    assert result.gxy == pytest.approx(0.0, abs=1e-12)
    assert abs(result.angle) == pytest.approx(90.0)
    assert result.rotation == pytest.approx(20.0)
    assert result.von_mises == pytest.approx(np.log(2.3))
    assert result.area_change == pytest.approx(2.3**0.5 - 1)


def test_simple_shear():
    gradient = np.array([[1.0, 0.7], [0.0, 1.0]])
    material, present = (
        strain_components(gradient, "engineering", directions) for directions in ("material", "global")
    )
    assert np.allclose(material, [0.0, np.hypot(0.7, 1.0) - 1.0, np.arctan(0.7)])
    assert np.allclose(present, [0.0, 1.0 / np.hypot(0.7, 1.0) - 1.0, np.arctan(0.7)])
    assert np.allclose(strain_components(gradient, "green_lagrange", "material"), [0.0, 0.245, 0.7])
    assert np.allclose(strain_components(gradient, "euler_almansi", "global"), [0.0, -0.245, 0.7])
    assert deformation_measures(gradient).rotation == pytest.approx(-np.degrees(np.arctan(0.35)))


def test_a_fold_has_no_strain():
    assert np.isnan(principal_stretches(np.diag([1.0, -1.0]), "material")[0])


@pytest.mark.parametrize("directions", ["material", "global"])
@pytest.mark.parametrize("measure", MEASURES)
def test_sigma_is_the_scatter(measure, directions):
    rng = np.random.default_rng(3)
    gradient = turn(25) @ np.array([[0.8, 0.2], [-0.1, 1.9]])
    root = 1e-4 * rng.normal(size=(4, 4))
    noisy = gradient + (rng.normal(size=(40_000, 4)) @ root.T).reshape(-1, 2, 2)
    measures = GradientMeasures(FUNCTIONS[measure], directions, {"trace": lambda f: np.trace(f, axis1=-2, axis2=-1)})
    predicted = measures.sigmas(gradient, root @ root.T)
    found = measures.values(noisy)
    assert tuple(predicted) == tuple(found) == measures.names
    for name, expected in predicted.items():
        assert found[name].std() == pytest.approx(expected, rel=0.02)
