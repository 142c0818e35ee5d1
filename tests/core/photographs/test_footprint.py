import numpy as np
import pytest

from dicflow.core.photographs.footprint import blurred, missing_blurs

MIDDLE = np.stack(np.meshgrid(*[np.arange(-25.0, 26.0)] * 2), axis=-1)


def test_unchanged_or_turned_material_needs_no_blur():
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    for slope in (np.eye(2), turn, 1.05 * turn):
        assert missing_blurs(slope) == (None, None)


@pytest.mark.parametrize("smoothing", [0.0, 0.8])
def test_both_photographs_have_the_same_blur_of_the_material(smoothing):
    """Template's and target's pixel, and what is laid over them, in pixels of the template."""
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])
    slope = turn @ np.diag([1.9, 0.6])
    blurs, back = missing_blurs(slope, smoothing), np.linalg.inv(slope)
    pixel = (1.0 / 12.0 + smoothing**2) * np.eye(2)
    template, target = (pixel + part for part in blurs)
    np.testing.assert_allclose(back @ target @ back.T, template, atol=1e-12)
    assert min(np.linalg.eigvalsh(part).min() for part in blurs) > -1e-12


@pytest.mark.parametrize("covariance", [np.diag([0.4, 0.1]), np.array([[0.8, 0.3], [0.3, 0.5]])])
def test_a_blurred_bell_is_a_wider_bell(covariance):
    own = 1.5 * np.eye(2)

    def bell(spread):
        exponent = np.einsum("ijk,kl,ijl->ij", MIDDLE, np.linalg.inv(spread), MIDDLE)
        return np.exp(-0.5 * exponent) / np.sqrt(np.linalg.det(spread))

    found = blurred(bell(own).astype(np.float32), covariance)
    np.testing.assert_allclose(found, bell(own + covariance), atol=4e-3)
    np.testing.assert_allclose(blurred(np.full((30, 30), 7.0, dtype=np.float32), covariance), 7.0, rtol=1e-5)


def test_no_blur_is_the_same_image():
    image = np.ones((4, 4), dtype=np.float32)
    assert blurred(image, None) is image
