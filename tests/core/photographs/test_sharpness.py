"""The blur between two photographs, against Gaussians of known width."""

import cv2
import numpy as np
import pytest

from dicflow.core.photographs.footprint import blurred
from dicflow.core.photographs.sharpness import blur_difference


def windows(sigma_px, gain=1.0, noise=1.0, seed=0, shift=0):
    """Windows of a random pattern with a smooth spectrum, blurred by a Gaussian [px]."""
    rng = np.random.default_rng(7)
    grey = cv2.GaussianBlur(rng.normal(0.0, 300.0, (400, 400)), (0, 0), 1.3)
    grey = blurred(grey.astype(np.float32), sigma_px**2 * np.eye(2)) if sigma_px else grey
    grey = gain * grey + np.random.default_rng(seed).normal(0.0, noise, grey.shape)
    corners = [(y, x) for y in range(8, 340, 40) for x in range(8, 340, 40)]
    return np.stack([grey[y : y + 48, x + shift : x + shift + 48] for y, x in corners])


@pytest.mark.parametrize("sigma_px", [0.6, 1.0, 2.0])
@pytest.mark.parametrize("gain", [0.5, 1.3])
def test_the_variance_of_a_gaussian_is_found(sigma_px, gain):
    """A change of contrast, noise and a shift of two pixels do not matter."""
    sharp, soft = windows(0.0, seed=1), windows(sigma_px, gain, seed=2, shift=2)
    found = blur_difference(sharp, soft, soft)
    assert found.variance == pytest.approx(sigma_px**2, rel=0.1)
    assert found.variance > 10.0 * found.error
    assert blur_difference(soft, sharp, sharp).variance == pytest.approx(-(sigma_px**2), rel=0.1)


def test_equally_sharp_photographs_have_none():
    found = blur_difference(windows(0.0, seed=1), windows(0.0, 0.7, seed=2, shift=1), windows(0.0, 0.7, seed=2))
    assert abs(found.variance) < 0.03


def test_noise_alone_tells_nothing():
    rng = np.random.default_rng(0)
    one, other = rng.normal(0.0, 3.0, (2, 30, 48, 48))
    assert not blur_difference(one, other, other).error < np.inf
