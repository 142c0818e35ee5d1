import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.synthetic.deformation import (
    Deformation,
    gradient,
    moved_rigidly,
    position,
    strain,
    surface_kernel,
    tangents_kernel,
)

GENERAL = Deformation(
    60.0, 20.0, 1.8, 0.5, 0.08, 0.05, -0.7, 0.3, rotation_matrix([0.1, 0.2, -0.3]), np.array([5.0, -40.0, 400.0])
)


def material_points(count: int = 200) -> np.ndarray:
    return np.random.default_rng(3).uniform([-10.0, -4.0], [10.0, 64.0], (count, 2))


def test_at_rest_the_strip_is_flat_and_in_place():
    points = material_points()
    assert position(Deformation(60.0, 20.0), points) == pytest.approx(np.column_stack([points, np.zeros(200)]))


def test_gradient_is_the_slope_of_position():
    points, h = material_points(), 1e-5
    slopes = np.stack(
        [(position(GENERAL, points + e) - position(GENERAL, points - e)) / (2 * h) for e in h * np.eye(2)], axis=-1
    )
    assert np.abs(gradient(GENERAL, points) - slopes).max() < 1e-8


@given(st.floats(1.0, 2.5), st.floats(-0.3, 0.3), st.floats(-2.0, 2.0))
def test_the_length_does_not_depend_on_the_inhomogeneity(stretch, inhomogeneity, bulge):
    state = Deformation(60.0, 20.0, stretch, inhomogeneity=inhomogeneity, bulge=bulge)
    top, bottom = position(state, [[0.0, 0.0], [0.0, 60.0]])
    assert np.linalg.norm(bottom - top) == pytest.approx(60.0 * stretch, rel=1e-12)


def test_the_local_stretch_integrates_to_the_imposed_length():
    nodes, weights = np.polynomial.legendre.leggauss(20)
    middle = np.column_stack([np.zeros(20), 30.0 + 30.0 * nodes])
    state = Deformation(60.0, 20.0, 2.2, inhomogeneity=0.2)
    assert 30.0 * weights @ gradient(state, middle)[:, 1, 1] == pytest.approx(132.0, rel=1e-12)


def test_an_incompressible_strip_narrows_by_the_root_of_its_stretch():
    exx, eyy, gxy = strain(Deformation(60.0, 20.0), Deformation(60.0, 20.0, 2.25), material_points())
    assert exx == pytest.approx(np.full(200, 1.0 / 1.5 - 1.0))
    assert eyy == pytest.approx(np.full(200, 1.25))
    assert gxy == pytest.approx(np.zeros(200), abs=1e-12)


@given(st.floats(-0.5, 0.5))
def test_simple_shear_turns_the_fibre_by_its_arctangent(shear):
    exx, eyy, gxy = strain(Deformation(60.0, 20.0), Deformation(60.0, 20.0, shear=shear), [1.0, 2.0])
    assert gxy == pytest.approx(np.arctan(shear), abs=1e-12)
    assert exx == pytest.approx(0.0, abs=1e-12)
    assert eyy == pytest.approx(np.hypot(1.0, shear) - 1.0, abs=1e-12)


@settings(max_examples=30)
@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.tuples(*[st.floats(-50.0, 50.0)] * 3))
def test_rigid_motion_gives_no_strain(vector, shift):
    moved = moved_rigidly(GENERAL, rotation_matrix(vector), shift)
    assert max(np.abs(part).max() for part in strain(GENERAL, moved, material_points(20))) < 1e-12


def test_a_rigid_motion_moves_every_point():
    rotation, shift = rotation_matrix([0.3, -0.2, 0.1]), np.array([1.0, 2.0, 3.0])
    expected = position(GENERAL, material_points()) @ rotation.T + shift
    assert position(moved_rigidly(GENERAL, rotation, shift), material_points()) == pytest.approx(expected, abs=1e-10)


def test_kernels_agree_with_arrays():
    place = GENERAL._replace(rotation=np.eye(3), translation=np.zeros(3))
    for x, y in material_points(20):
        assert surface_kernel(place, x, y) == pytest.approx(tuple(position(place, [x, y])), abs=1e-12)
        x_x, x_y, y_y, z_x, z_y = tangents_kernel(place, x, y)
        assert np.array([[x_x, x_y], [0.0, y_y], [z_x, z_y]]) == pytest.approx(gradient(place, [x, y]), abs=1e-12)
