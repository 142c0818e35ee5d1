"""The blur between two photographs, against Gaussians of known width and motion during the exposure."""

import cv2
import numpy as np
import pytest

from dicflow.core.photographs.footprint import blurred
from dicflow.core.photographs.sharpness import blur_difference

ROUND = np.eye(2)
LONG = np.array([[3.0, 1.6], [1.6, 1.2]])


def windows(covariance, gain=1.0, noise=1.0, seed=0, shift=0):
    """Windows of a random pattern with a smooth spectrum, blurred by a Gaussian [px²]."""
    rng = np.random.default_rng(7)
    grey = cv2.GaussianBlur(rng.normal(0.0, 300.0, (400, 400)), (0, 0), 1.3)
    grey = blurred(grey.astype(np.float32), covariance)
    return photographed(grey, gain, noise, seed, shift)


def photographed(grey, gain=1.0, noise=1.0, seed=0, shift=0):
    grey = gain * grey + np.random.default_rng(seed).normal(0.0, noise, grey.shape)
    corners = [(y, x) for y in range(8, 340, 40) for x in range(8, 340, 40)]
    return np.stack([grey[y : y + 48, x + shift : x + shift + 48] for y, x in corners])


@pytest.mark.parametrize("covariance", [0.36 * ROUND, ROUND, 4.0 * ROUND, LONG])
@pytest.mark.parametrize("gain", [0.5, 1.3])
def test_the_covariance_of_a_gaussian_is_found(covariance, gain):
    """A change of contrast, noise and a shift of two pixels do not matter."""
    sharp, soft = windows(None, seed=1), windows(covariance, gain, seed=2, shift=2)
    for found, sign in ((blur_difference(sharp, soft, soft), 1.0), (blur_difference(soft, sharp, sharp), -1.0)):
        size = np.linalg.norm(covariance, 2)
        np.testing.assert_allclose((found.axes * found.variances) @ found.axes.T, sign * covariance, atol=0.12 * size)
        assert np.abs(found.variances).max() > 10.0 * found.errors.max()


def test_equally_sharp_photographs_have_none():
    found = blur_difference(windows(None, seed=1), windows(None, 0.7, seed=2, shift=1), windows(None, 0.7, seed=2))
    assert np.abs(found.variances).max() < 0.03


def test_noise_that_resampling_made_stronger_is_no_pattern():
    """A photograph that is enlarged four times has its noise at fewer frequencies; what a blur leaves lies beneath."""
    covariance = 12.0 * ROUND
    sharp, noise = windows(None, seed=1), np.random.default_rng(3).normal(0.0, 10.0, (200, 200)).astype(np.float32)
    wide = cv2.resize(noise, (400, 400), interpolation=cv2.INTER_LANCZOS4)
    soft = windows(covariance, noise=0.0) + photographed(wide, noise=0.0)
    beside = np.stack([noise[y : y + 48, x : x + 48] for y in range(0, 150, 25) for x in range(0, 150, 25)])
    known, taken_for_white = (blur_difference(sharp, soft, beside, power) for power in (4.0, 1.0))
    assert known.variances.min() > 0.6 * 12.0
    assert known.variances.min() > taken_for_white.variances.min()


def test_noise_alone_tells_nothing():
    rng = np.random.default_rng(0)
    one, other = rng.normal(0.0, 3.0, (2, 30, 48, 48))
    assert not np.isfinite(blur_difference(one, other, other).errors).any()
