import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.strain.surface_strain import (
    deformation_gradient,
    engineering_strain,
    jacobian,
    tangent_basis,
    thesis_strain,
)
from dicflow.core.tensors import cross

ROW, COL = np.mgrid[:30, :14].astype(float)
X, Y = 0.5 * COL - 3.0, 0.5 * ROW - 7.0


def test_vector_products_are_those_of_numpy():
    first, second = np.random.default_rng(0).normal(size=(2, 4, 5, 3))
    assert np.array_equal(cross(first, second), np.cross(first, second))


def sheet(x=X, y=Y, z=500.0):
    return np.stack(np.broadcast_arrays(x, y, z), axis=-1)


def strain_between(before, after, window=(7, 5), degree=2):
    gradient = deformation_gradient(jacobian(before, window, degree), jacobian(after, window, degree))
    return gradient, engineering_strain(gradient)


def test_jacobian_of_a_regular_sheet():
    tilted = sheet(z=500.0 + 0.2 * X - 0.1 * Y)
    expected = np.array([[0.5, 0.0], [0.0, 0.5], [0.1, -0.05]])
    assert np.abs(jacobian(tilted, (5, 5), 1) - expected).max() < 1e-10


def test_jacobian_is_missing_where_the_point_is():
    holed = sheet()
    holed[10, 5] = np.nan
    found = np.isfinite(jacobian(holed, (5, 5), 1)).all(axis=(-1, -2))
    assert not found[10, 5]
    assert found.sum() == found.size - 1


@given(angles=st.tuples(*[st.floats(-1.0, 1.0)] * 3), spin=st.floats(-0.5, 0.5))
def test_basis_is_orthonormal_and_follows_the_world(angles, spin):
    rotation = rotation_matrix(np.array(angles) * 0.6)
    turn = np.array([[np.cos(spin), -np.sin(spin)], [np.sin(spin), np.cos(spin)], [0, 0]])
    basis = tangent_basis(rotation @ turn * np.array([0.3, 2.0]))
    assert np.abs(basis.T @ basis - np.eye(2)).max() < 1e-12
    assert abs(basis[:, 0] @ np.cross(rotation[:, 2], [1.0, 0.0, 0.0])) < 1e-12
    assert basis[0, 0] > 0.0
    assert basis[1, 1] > 0.0


def test_basis_of_parallel_directions_is_missing():
    assert np.isnan(tangent_basis(np.array([[1.0, 2.0], [0.0, 0.0], [1.0, 2.0]]))).all()


def test_basis_of_the_image_plane_is_the_world():
    assert np.array_equal(tangent_basis(np.array([[0.5, 0.1], [0.2, 0.7], [0.0, 0.0]])), np.eye(3)[:, :2])


@given(
    axis=st.tuples(*[st.floats(-1.0, 1.0)] * 3),
    angle_deg=st.floats(0.0, 59.0),
    shift=st.tuples(*[st.floats(-500.0, 500.0)] * 3),
)
@settings(max_examples=40)
def test_rigid_motion_gives_no_strain(axis, angle_deg, shift):
    length = np.linalg.norm(axis)
    rotation = rotation_matrix(np.radians(angle_deg) * np.array(axis) / length if length > 0.1 else np.zeros(3))
    before = sheet(z=500.0 + 0.3 * X + 0.02 * Y**2)
    _, strain = strain_between(before, (before - [0, 0, 500]) @ rotation.T + np.array(shift) + [0, 0, 500])
    assert np.abs(np.stack(strain)).max() < 1e-9


@given(st.floats(0.4, 2.5), st.floats(0.4, 2.5), st.floats(-0.8, 0.8), st.floats(-0.7, 0.7), st.floats(-0.7, 0.7))
@settings(max_examples=40)
def test_perfect_homogeneous_deformation_of_a_tilted_sheet(a, d, b, slope_x, slope_y):
    """A gradient [[a, b], [0, d]] in the sheet's own plane comes back for every tilt of the sheet."""
    basis = tangent_basis(np.array([[1.0, 0.0], [0.0, 1.0], [slope_x, slope_y]]))
    truth = np.array([[a, b], [0.0, d]])
    plane = np.stack([X, Y], axis=-1)
    gradient, strain = strain_between(plane @ basis.T, plane @ truth.T @ basis.T)
    assert np.abs(gradient - truth).max() < 1e-8
    assert np.abs(strain.exx - (a - 1)).max() < 1e-8
    assert np.abs(strain.eyy - (np.hypot(b, d) - 1)).max() < 1e-8
    assert np.abs(strain.gxy - np.arctan2(b, d)).max() < 1e-8


def test_shear_is_the_change_of_the_angle():
    for shear in (-0.9, -1e-3, 1e-3, 0.9):
        strain = engineering_strain(np.array([[1.0, shear], [0.0, 1.0]]))
        assert strain.gxy == pytest.approx(np.arctan(shear), rel=1e-12)
    assert engineering_strain(np.array([[1.0, 0.004], [0.003, 1.0]])).gxy == pytest.approx(0.007, rel=1e-4)


def test_two_half_steps_make_the_whole():
    before = sheet(z=500 + 0.1 * X)
    middle = sheet(0.9 * X + 0.002 * X * Y, 1.4 * Y + 0.01 * Y**2, 490 + 0.15 * X)
    after = sheet(0.8 * X + 0.003 * X * Y, 2.1 * Y + 0.02 * Y**2, 495 + 0.2 * X - 0.05 * Y)
    first, _ = strain_between(before, middle)
    second, _ = strain_between(middle, after)
    whole, _ = strain_between(before, after)
    assert np.abs(second @ first - whole).max() < 1e-12


def test_bending_without_stretch_gives_little_strain_that_vanishes_with_the_window():
    """A sheet rolled on a cylinder of radius 20 mm; what remains is the bias of the local parabola, of order h²."""
    errors = []
    for fine in (1, 2):
        row, col = np.mgrid[: 30 * fine, : 28 * fine] / (2.0 * fine)
        angle = (col - 7.0) / 20.0
        rolled = np.stack([20 * np.sin(angle), row, 500 + 20 * (1 - np.cos(angle))], axis=-1)
        flat = np.stack([col, row, np.full_like(row, 500.0)], axis=-1)
        _, strain = strain_between(flat, rolled, window=(5, 9))
        inner = slice(4 * fine, -4 * fine)
        errors.append(max(np.abs(measure[inner, inner]).max() for measure in strain))
    assert errors[0] < 2e-3
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.2)


def test_noisy_strain_has_the_predicted_deviation():
    """In a full window of a degree-1 fit σ(ε) = σ √(2 / Σ u²) / spacing: both states carry noise."""
    sigma, rng = 1e-3, np.random.default_rng(1)
    row, col = np.mgrid[:350, :200] * 0.5
    flat = np.stack([col, row, np.full_like(row, 500.0)], axis=-1)
    noisy = [flat + rng.normal(0, sigma, flat.shape) * [1, 1, 0] for _ in range(2)]
    _, strain = strain_between(*noisy, window=(7, 5), degree=1)
    apart = (slice(3, -3, 7), slice(2, -2, 5))
    n = strain.eyy[apart].size
    assert strain.eyy[apart].std() == pytest.approx(sigma * np.sqrt(2 / (5 * 28)) / 0.5, rel=4 / np.sqrt(2 * n))
    assert strain.exx[apart].std() == pytest.approx(sigma * np.sqrt(2 / (7 * 10)) / 0.5, rel=4 / np.sqrt(2 * n))


def test_perfect_thesis_strain_of_a_flat_sheet():
    displacement = np.stack([0.02 * X - 0.004 * Y, 0.003 * X + 0.1 * Y, 0 * X], axis=-1)
    displacement[10:13, 4:6] = np.nan
    strain = thesis_strain(displacement, sheet(), (9, 7), 2)
    known = np.isfinite(displacement[..., 0])
    for measure, truth in zip(strain, (0.02, 0.1, 0.003 - 0.004), strict=True):
        assert np.array_equal(np.isfinite(measure), known)
        assert np.abs(measure[known] - truth).max() < 1e-9


def test_thesis_strain_takes_a_plane_for_the_spacing():
    rough = sheet(X, Y + np.random.default_rng(0).normal(0, 0.05, Y.shape))
    strain = thesis_strain(np.stack([0 * X, 0.1 * Y, 0 * X], axis=-1), rough, (9, 7), 2)
    assert np.abs(strain.eyy - 0.1).max() < 0.05
    assert np.ptp(strain.eyy, axis=1).max() < 0.05
