import numpy as np
import pytest
from scenes import texture

from dicflow.core.correlation.misfit import misfit_covariance, place_covariances
from dicflow.core.correlation.subsets import Subset, correlate, template
from dicflow.core.correlation.warp import identity
from dicflow.core.photographs.interpolate import spline

SHAPE, NOISE = (330, 330), 3.0
AXIS = np.arange(30.0, 301.0, 10.0)
GRID = np.stack(np.meshgrid(AXIS, AXIS), axis=-1)
CENTRES = GRID.reshape(-1, 2)


def photographs(grain=0.0, seed=0):
    """The texture twice, with noise that is alike over a few pixels where grain, in px, is not 0."""
    generator, (y, x) = np.random.default_rng(seed), np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
    for _ in range(2):
        noise = generator.normal(0.0, NOISE, SHAPE)
        if grain:
            reach = np.exp(-0.5 * (np.arange(-6, 7) / grain) ** 2)
            for axis in (0, 1):
                noise = np.apply_along_axis(np.convolve, axis, noise, reach / np.sqrt((reach**2).sum()), mode="same")
        yield spline((texture(x, y) + noise).astype(np.float32))


def matched(images, subset):
    first, second = images
    reference = template(first)
    return reference, second, correlate(reference, second, CENTRES, identity(CENTRES, subset.shape_function), subset)


@pytest.mark.parametrize(
    "subset", [Subset(21), Subset(21, "quadratic"), Subset(31, gaussian=7.0)], ids=["affine", "quadratic", "weighted"]
)
def test_white_noise_moves_subsets_as_the_hessian_says(subset):
    reference, target, found = matched(photographs(), subset)
    covariances = place_covariances(reference, target, CENTRES.astype(int), found.warp, subset)
    hessian = found.covariance[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
    np.testing.assert_allclose(2.0 * covariances.noise, hessian, rtol=0.02, atol=0.02 * hessian.max())
    told, white = (np.trace(part, axis1=1, axis2=2).mean() for part in (covariances.residual, NOISE**2 * hessian))
    assert told == pytest.approx(white, rel=0.04)


def test_noise_that_is_alike_over_a_few_pixels_is_seen():
    """It moves the subsets further than white noise of its strength would; windows cut off some of what is alike."""
    subset, errors, told, white = Subset(31), [], [], []
    for seed in range(4):
        reference, target, found = matched(photographs(1.0, seed), subset)
        covariances = place_covariances(reference, target, CENTRES.astype(int), found.warp, subset)
        errors.append(found.warp[..., 0] - CENTRES)
        told.append(covariances.residual[:, [0, 1], [0, 1]])
        white.append(2.0 * NOISE**2 * covariances.noise[:, [0, 1], [0, 1]])
    true = np.mean(np.square(errors))
    assert true > 3.0 * np.mean(white)
    assert np.mean(told) == pytest.approx(true, rel=0.15)


def test_what_noise_explains_is_no_misfit():
    subset = Subset(21)
    for grain, least, most in ((0.0, 0.0, 0.12), (1.0, 1.0, 9.0)):
        reference, target, found = matched(photographs(grain), subset)
        warp = found.warp.reshape(*GRID.shape[:2], 2, 3).copy()
        warp[:3, :3] = np.nan
        level = np.full(GRID.shape[:2], 2.0 * NOISE**2)
        unit = 0.5 * found.covariance.reshape(*GRID.shape[:2], 3)
        more = misfit_covariance(reference, target, GRID, warp, subset, unit, level)
        assert more.shape == (*GRID.shape[:2], 3)
        assert np.isfinite(more).all()
        share = more.mean(axis=(0, 1)) / (NOISE**2 * found.covariance.mean(axis=0))
        assert least <= share[0] <= most
        assert least <= share[2] <= most


def test_subsets_that_leave_the_image_or_were_not_found_say_nothing():
    subset = Subset(21)
    reference, target, found = matched(photographs(), subset)
    centres, warp = np.array([[5, 100], [100, 100], [100, 100]]), found.warp[:3].copy()
    warp[:, :, 0] = 100.0
    warp[2] = np.nan
    covariances = place_covariances(reference, target, centres, warp, subset)
    np.testing.assert_array_equal(np.isnan(covariances.residual[:, 0, 0]), [True, False, True])
