"""The deformation gradient against known fields, and its σ against the scatter of noisy ones."""

import numpy as np
import pytest

from dicflow.core.cameras.camera import rotation_matrix
from dicflow.core.strain.deformation_gradient import (
    ErrorShare,
    measured_surface,
    pixel_size_mm,
)
from dicflow.core.strain.degree_choice import chosen_gradient
from dicflow.core.strain.gauge import vsg_px
from dicflow.core.strain.gradient_response import gradient_and_response
from dicflow.core.strain.measures import GradientMeasures, deformation_measures
from dicflow.core.strain.remaining_bias import WindowFit
from dicflow.core.strain.surface_strain import deformation_gradient, tangent_basis
from dicflow.core.uncertainty.covariance import MeasuredPoints, joint_covariance
from dicflow.core.uncertainty.overlap import Derivative, independent, overlap
from tests.noise import point_errors

SHAPE = (40, 30)
STEP = 5
MM_PX = 0.05
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]] * STEP * MM_PX
PLANE = np.stack([X, Y, 500.0 + 0.0 * X], axis=-1)
TILTED = np.stack([X, Y, 500.0 + 0.6 * X - 0.4 * Y], axis=-1)
FIT = WindowFit((7, 7), 1)
EXACT = np.broadcast_to(1e-6 * np.eye(6), (*SHAPE, 6, 6))


def gradient_of(reference, deformed, window=(7, 7), degree=1, covariance=EXACT, rho=None, **options):
    surface = measured_surface(reference, deformed, [ErrorShare(covariance, rho or independent())], **options)
    return chosen_gradient(surface, [WindowFit(window, degree)]).surface


def stretched(reference, gradient):
    """A plane sheet deformed homogeneously within its own plane."""
    basis = tangent_basis(np.stack([reference[0, 1] - reference[0, 0], reference[1, 0] - reference[0, 0]], axis=-1))
    flat = (reference - reference[0, 0]) @ basis
    return reference[0, 0] + flat @ np.asarray(gradient).T @ basis.T


@pytest.mark.parametrize(("degree", "side"), [(1, 7), (2, 7), (5, 11)])
@pytest.mark.parametrize("reference", [PLANE, TILTED], ids=["plane", "tilted"])
@pytest.mark.parametrize(
    "truth", [np.diag([2.3**-0.5, 2.3]), [[1.0, 0.4], [0.0, 1.0]], [[0.9, -0.2], [0.3, 1.4]]], ids=str
)
def test_perfect_homogeneous_deformation(truth, reference, degree, side):
    found = gradient_of(reference, stretched(reference, truth), (side, side), degree).gradient
    assert np.abs(found - truth).max() < 1e-9


@pytest.mark.parametrize(("degree", "side"), [(1, 7), (2, 7), (5, 11)])
def test_rigid_motion_gives_no_strain(degree, side):
    curved = PLANE + np.stack([0 * X, 0 * X, 0.03 * (X - 4) ** 2], axis=-1)
    moved = (curved - [4, 5, 500]) @ rotation_matrix([0.2, -0.3, 0.5]).T + [14, -5, 520]
    result = deformation_measures(gradient_of(curved, moved, (side, side), degree).gradient)
    for name in ("exx", "eyy", "gxy", "e1", "e2", "von_mises", "area_change"):
        assert np.abs(getattr(result, name)).max() < 1e-9


def test_bending_gives_the_fibres_of_the_surface_their_length_back():
    """A sheet rolled up to a radius R and stretched by 1.1 along it; the parabola's bias is of order h² / R²."""
    radius, stretch = 15.0, 1.1
    around = (X - X.mean()) * stretch / radius
    rolled = np.stack([radius * np.sin(around), Y, 500 + radius * (1 - np.cos(around))], axis=-1)
    result = deformation_measures(gradient_of(PLANE, rolled, window=(5, 5), degree=2).gradient)
    assert np.abs(result.exx - 0.1).max() < (0.5 / radius) ** 2
    assert np.abs(result.eyy).max() < 1e-9


def test_plane_fields_in_pixels():
    reference = np.stack([X, Y, 0 * X], axis=-1) / MM_PX
    truth = np.array([[1.2, 0.1], [-0.3, 0.8]])
    deformed = np.concatenate([reference[..., :2] @ truth.T, 0 * reference[..., :1]], axis=-1)
    assert np.abs(gradient_of(reference, deformed).gradient - truth).max() < 1e-9


def test_too_few_neighbours():
    sparse = PLANE.copy()
    sparse[10:, 12:] = np.nan
    sparse[30, 20] = PLANE[30, 20]
    found = gradient_of(PLANE, sparse).gradient
    assert np.isnan(found[30, 20]).all()
    assert np.isfinite(found[0, 0]).all()
    assert np.isnan(gradient_of(PLANE, sparse, min_share=0.5).gradient[0, 0]).all()
    assert np.array_equal(
        np.isnan(found).any(axis=(-1, -2)),
        np.isnan(sparse).any(axis=-1) | (np.arange(30) == 20) & (np.arange(40)[:, None] == 30),
    )


def test_uncertain_points_count_less():
    """A point that is off by 1 mm and says so does not move the fit."""
    rough = PLANE.copy()
    rough[20, 15] += 1.0
    covariance = EXACT.copy()
    covariance[20, 15] *= 1e12
    error = np.abs(gradient_of(PLANE, rough, covariance=covariance).gradient[18, 15] - np.eye(2)).max()
    assert error < 1e-9 < np.abs(gradient_of(PLANE, rough).gradient[18, 15] - np.eye(2)).max()


def test_a_point_that_is_uncertain_along_one_axis_has_the_noise_of_its_window():
    """Its own weight is small, so that σ across that axis is at least that of the whole window with one point less."""
    covariance = EXACT.copy()
    covariance[20, 15, 0, 0] *= 1e6
    plain = gradient_of(PLANE, PLANE).covariance[20, 15]
    found = gradient_of(PLANE, PLANE, covariance=covariance).covariance[20, 15]
    assert (np.diagonal(found) > 0.999 * np.diagonal(plain)).all()
    assert (np.diagonal(found) < 1.3 * np.diagonal(plain)).all()


def test_the_response_is_the_derivative():
    """Against differences of the gradient itself, for a surface that tilts and stretches much."""
    before = np.array([[1.0, 0.1], [0.2, 0.9], [0.5, -0.3]]) * 0.25
    after = np.array([[1.5, 0.4], [0.1, 1.9], [0.9, 0.6]]) * 0.25
    h, expected = 1e-6, np.zeros((4, 2, 6))
    for column in range(2):
        for axis in range(6):
            change = np.zeros((2, 3, 2))
            change[axis // 3, axis % 3, column] = h
            high, low = (deformation_gradient(before + s * change[1], after + s * change[0]) for s in (1, -1))
            expected[:, column, axis] = ((high - low) / (2 * h)).ravel()
    gradient, response = gradient_and_response(before, after)
    np.testing.assert_allclose(gradient, deformation_gradient(before, after), rtol=1e-14)
    assert np.allclose(response, expected, rtol=1e-6, atol=1e-7)


OWN = 1e-6 * np.array([[1.0, 0.2, -0.5], [0.2, 1.5, 0.4], [-0.5, 0.4, 9.0]])
FIRST = 1e-6 * np.array([[0.8, 0.0, 0.3], [0.0, 0.8, 0.0], [0.3, 0.0, 6.0]])
SENSITIVITY = MM_PX * np.array([[1.0, 0.1], [0.0, 1.2], [0.9, -0.3]])
SENSITIVITY_FIRST = MM_PX * np.array([[0.6, 0.0], [0.0, 0.5], [1.5, 0.0]])
TEMPLATE = 0.02**2 * np.array([[1.0, 0.1], [0.1, 0.8]])


def noisy_pair(rng, reference, deformed, subset_size, shape_function):
    """Both states with errors of the step's, the reference's and the template's noise."""
    own, first, common = (
        point_errors(rng, SHAPE, part, subset_size, STEP, shape_function) for part in (OWN, FIRST, TEMPLATE)
    )
    return reference + first - common @ SENSITIVITY_FIRST.T, deformed + own - common @ SENSITIVITY.T


@pytest.mark.slow
@pytest.mark.parametrize(
    ("shape_function", "degree", "stretch"),
    [("affine", 1, 1.0), ("affine", 2, 2.3), ("quadratic", 1, 2.3), ("quadratic", 3, 1.0)],
)
def test_one_sigma_covers_68_percent(shape_function, degree, stretch):
    """exx, eyy and gxy of a tilted surface, edges and corners included, with errors as overlapping subsets have."""
    truth = np.array([[stretch**-0.5, 0.2 * (stretch - 1)], [0.0, stretch]])
    deformed = stretched(TILTED, truth) @ rotation_matrix([0.0, -0.25, 0.1]).T
    joint = joint_covariance(
        MeasuredPoints(deformed, OWN, SENSITIVITY), MeasuredPoints(TILTED, FIRST, SENSITIVITY_FIRST), TEMPLATE
    )
    covariance, rho = np.broadcast_to(joint, (*SHAPE, 6, 6)), overlap(21, STEP, shape_function)
    perfect = deformation_measures(gradient_of(TILTED, deformed, (7, 7), degree, covariance, rho).gradient)
    rng, scores = np.random.default_rng(11), []
    for _ in range(60):
        pair = noisy_pair(rng, TILTED, deformed, 21, shape_function)
        result = gradient_of(*pair, (7, 7), degree, covariance, rho)
        error = np.stack(deformation_measures(result.gradient)[:3]) - np.stack(perfect[:3])
        scores.append(error / np.stack([*GradientMeasures().sigmas(result.gradient, result.covariance).values()][:3]))
    inside = np.abs(np.stack(scores))
    for strain in range(3):
        assert (inside[:, strain] < 1).mean() == pytest.approx(0.683, abs=0.03)
        assert (inside[:, strain] < 2).mean() == pytest.approx(0.954, abs=0.02)


def test_shares_of_either_shape_function_add_up():
    rng = np.random.default_rng(7)
    root = rng.normal(size=(6, 6))
    shares = [
        ErrorShare(np.broadcast_to(part, (*SHAPE, 6, 6)), overlap(21, STEP, shape_function))
        for part, shape_function in ((1e-6 * root @ root.T, "affine"), (1e-6 * np.eye(6), "quadratic"))
    ]
    both, first, second = (
        chosen_gradient(measured_surface(TILTED, 1.1 * TILTED, part), [FIT]).surface.covariance
        for part in (shares, shares[:1], shares[1:])
    )
    assert np.allclose(both, first + second, rtol=1e-9, equal_nan=True)
    joint = gradient_of(TILTED, 1.1 * TILTED, covariance=sum(share.covariance for share in shares), rho=shares[0].rho)
    assert not np.allclose(both, joint.covariance, rtol=0.05, equal_nan=True)


@pytest.mark.parametrize("degree", [1, 2])
def test_errors_of_another_reach_along_each_axis(degree):
    """As if this were their overlap: exactly in whole windows, and nearly in those at rims."""
    covariance, plain = np.broadcast_to(1e-6 * np.eye(6), (*SHAPE, 6, 6)), overlap(21, STEP)
    other = overlap(21, STEP, "affine", Derivative("across", 2.0))
    by_overlap, along, expected = (
        chosen_gradient(measured_surface(TILTED, 1.1 * TILTED, [share]), [WindowFit((7, 7), degree)]).surface.covariance
        for share in (
            ErrorShare(covariance, plain),
            ErrorShare(covariance, plain, (other, other, other)),
            ErrorShare(covariance, other),
        )
    )
    inside = np.s_[3:-3, 3:-3]
    np.testing.assert_allclose(along[inside], expected[inside], rtol=1e-6, atol=1e-15)
    ratio = np.divide(*(np.diagonal(one, axis1=-2, axis2=-1) for one in (along, expected)))
    assert np.abs(np.log(ratio)).max() < 0.5
    assert np.abs(np.log(ratio)).mean() < 0.1
    assert not np.allclose(by_overlap[inside], expected[inside], rtol=0.2)


def test_gauge_and_scale():
    assert vsg_px(15, 7.0, 31) == 14 * 7 + 31
    assert np.allclose(pixel_size_mm(PLANE, STEP), MM_PX)
    area = np.sqrt(1 + 0.6**2 + 0.4**2)
    assert np.allclose(pixel_size_mm(TILTED, STEP), MM_PX * np.sqrt(area))
