import numpy as np
import pytest
from blobs import Pattern, stretched

from dicflow.core.matching.refine import refinable, refine_matches

SHAPE = (200, 220)
PATTERN = Pattern((-20, -20, 240, 220))
REFERENCE = PATTERN.photograph(SHAPE)
GRID = np.stack(np.meshgrid(np.arange(30.0, 190, 12), np.arange(30.0, 170, 12)), axis=-1).reshape(-1, 2)
IDENTITY = np.tile(np.eye(2), (len(GRID), 1, 1))


def start(true, seed=0):
    return true + np.random.default_rng(seed).uniform(-0.7, 0.7, true.shape)


@pytest.mark.parametrize("shift", [0.0, 0.1, 0.25, 0.5, 0.73])
def test_perfect_shift(shift):
    true = GRID + np.array([shift, -shift])
    image = PATTERN.photograph(SHAPE, lambda p: p + np.array([shift, -shift]))
    found = refine_matches(refinable(REFERENCE, image), GRID, start(true), IDENTITY)
    error = found.deformed - true
    assert np.abs(error.mean(axis=0)).max() < 1e-3
    assert np.sqrt(np.mean(error**2)) < 4e-3  # what rounding to whole grey levels leaves
    assert found.correlation.min() > 0.9995


def test_noise_scatters_as_the_gradients_predict():
    sigma = 4.0
    images = [PATTERN.photograph(SHAPE, lambda p: p + 0.3, seed=seed, noise=sigma) for seed in range(1, 9)]
    reference = PATTERN.photograph(SHAPE, seed=99, noise=sigma)
    errors = np.array(
        [refine_matches(refinable(reference, image), GRID, GRID + 0.3, IDENTITY).deformed for image in images]
    )
    gx = np.gradient(REFERENCE.astype(float), axis=1)
    predicted = [
        sigma / np.sqrt((gx[int(y) - 10 : int(y) + 11, int(x) - 10 : int(x) + 11] ** 2).sum()) for x, y in GRID
    ]
    scatter = errors[..., 0].std(axis=0, ddof=1)  # the noise of the reference is common to all, so one image's remains
    assert np.sqrt(np.mean(scatter**2)) == pytest.approx(np.sqrt(np.mean(np.square(predicted))), rel=0.35)


def test_brightness_and_contrast_do_not_matter():
    image = PATTERN.photograph(SHAPE, lambda p: p + 0.4)
    dim = np.rint(image * 100.0 + 3000).astype(np.uint16)
    bright, dark = (refine_matches(refinable(REFERENCE, i), GRID, start(GRID + 0.4), IDENTITY) for i in (image, dim))
    np.testing.assert_allclose(dark.deformed, bright.deformed, atol=1e-3)


@pytest.mark.parametrize("stretch", [0.72, 1.39])
def test_large_stretch_with_its_gradient(stretch):
    mapping = stretched(stretch, fixed=np.array([110.0, 40.0]))
    image = PATTERN.photograph((300, 220), mapping)
    true = mapping(GRID)
    gradient = np.tile(np.diag([stretch**-0.5, stretch]), (len(GRID), 1, 1))
    found = refine_matches(refinable(REFERENCE, image), GRID, start(true), gradient)
    settled = np.isfinite(found.correlation)
    assert settled.mean() > 0.95
    assert np.sqrt(np.mean((found.deformed - true)[settled] ** 2)) < 0.02
    assert np.abs((found.deformed - true)[settled].mean(axis=0)).max() < 0.005


def test_the_pair_stands_at_whole_pixels_of_the_reference():
    image = PATTERN.photograph(SHAPE, lambda p: p + 0.2)
    found = refine_matches(refinable(REFERENCE, image), GRID + 0.4, GRID + 0.6, IDENTITY)
    np.testing.assert_array_equal(found.reference, GRID)
    np.testing.assert_allclose(found.deformed, GRID + 0.2, atol=0.02)


def test_a_false_match_does_not_correlate():
    found = refine_matches(refinable(REFERENCE, REFERENCE), GRID, GRID[::-1] + 7.0, IDENTITY)
    assert np.mean(found.correlation > 0.6) < 0.02


def test_windows_beyond_the_image_do_not_converge():
    edge = np.array([[5.0, 100.0], [100.0, 196.0], [215.0, 60.0]])
    found = refine_matches(refinable(REFERENCE, REFERENCE), edge, edge, IDENTITY[:3])
    assert np.isnan(found.deformed).all()
    inside = np.full((3, 2), 100.0)
    assert np.isnan(refine_matches(refinable(REFERENCE, REFERENCE), inside, edge, IDENTITY[:3]).correlation).all()


def test_a_plain_image_does_not_converge():
    plain = np.full(SHAPE, 100, dtype=np.uint8)
    for images in ((plain, REFERENCE), (REFERENCE, plain)):
        assert np.isnan(refine_matches(refinable(*images), GRID, GRID, IDENTITY).deformed).all()
