import numpy as np
import pytest

from dicflow.core.cameras.frames import axes_frame
from dicflow.core.tensors import product, symmetric, upper_triangle
from dicflow.core.uncertainty.covariance import (
    MeasuredPoints,
    derivative,
    displacement_covariance,
    displacement_variances,
    joint_covariance,
    points_in_frame,
    sigma_along,
)

RNG = np.random.default_rng(0)


def definite(size):
    root = RNG.normal(size=(4, size, size))
    return root @ np.swapaxes(root, -1, -2)


AFTER, BEFORE = (MeasuredPoints(RNG.normal(size=(4, 3)), definite(3), RNG.normal(size=(4, 3, 2))) for _ in range(2))
TEMPLATE = definite(2)


def test_triangles_and_matrices():
    matrices = definite(6)
    assert upper_triangle(matrices).shape == (4, 21)
    assert np.array_equal(symmetric(upper_triangle(matrices)), np.maximum(matrices, np.swapaxes(matrices, -1, -2)))


@pytest.mark.parametrize("columns", [1, 2, 5])
def test_products_are_those_of_matrices(columns):
    first, second = RNG.normal(size=(4, 1, 2, 2)), RNG.normal(size=(3, 2, columns))
    np.testing.assert_allclose(product(first, second), first @ second, rtol=1e-12, atol=1e-12)


def test_displacement_sees_only_the_difference_of_the_template_shares():
    joint = joint_covariance(AFTER, BEFORE, TEMPLATE)
    found = displacement_covariance(joint)
    assert np.allclose(displacement_variances(joint), np.diagonal(found, axis1=-2, axis2=-1))
    change = AFTER.sensitivity - BEFORE.sensitivity
    assert np.allclose(
        found, AFTER.step_covariance + BEFORE.step_covariance + change @ TEMPLATE @ np.swapaxes(change, -1, -2)
    )


def test_joint_covariance_is_that_of_the_errors():
    count = 200_000
    own, first, common = (
        RNG.normal(size=(count, len(part[0]))) @ np.linalg.cholesky(part[0]).T
        for part in (AFTER.step_covariance, BEFORE.step_covariance, TEMPLATE)
    )
    after, before = own - common @ AFTER.sensitivity[0].T, first - common @ BEFORE.sensitivity[0].T
    expected = joint_covariance(AFTER, BEFORE, TEMPLATE)[0]
    found = np.cov(np.concatenate([after, before], axis=1).T)
    scale = np.sqrt(np.outer(expected.diagonal(), expected.diagonal()))
    assert np.abs((found - expected) / scale).max() < 5 / np.sqrt(count)


def test_another_frame_changes_no_uncertainty_along_a_direction():
    frame, direction = axes_frame([1, 2, 0.5], [0, 1, -3], [10, 20, 30]), np.array([0.3, -0.5, 0.8])
    turned = points_in_frame(AFTER, frame)
    assert sigma_along(turned.step_covariance, frame.rotation @ direction) == pytest.approx(
        sigma_along(AFTER.step_covariance, direction)
    )
    assert np.allclose(turned.sensitivity, frame.rotation @ AFTER.sensitivity)
    assert np.allclose(turned.xyz, (AFTER.xyz - [10, 20, 30]) @ frame.rotation.T)


def test_propagation_of_a_product():
    values, covariance = np.array([2.0, 5.0]), np.array([[0.04, 0.01], [0.01, 0.09]])
    product = sigma_along(covariance, derivative(lambda v: v[..., :1] * v[..., 1:], values))
    assert product == pytest.approx([np.sqrt(25 * 0.04 + 4 * 0.09 + 2 * 10 * 0.01)])
    assert np.allclose(
        derivative(lambda v: np.stack([v[..., 0] ** 2, v.sum(axis=-1)], axis=-1), values), [[4, 0], [1, 1]]
    )
