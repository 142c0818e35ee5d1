import numpy as np
import pytest
from scenes import texture

from dicflow.core.correlation.misfit import misfit_covariance, misfit_stride, place_covariances, sampled_misfit
from dicflow.core.correlation.subsets import Subset, correlate
from dicflow.core.correlation.template import template
from dicflow.core.correlation.warp import identity
from dicflow.core.photographs.interpolate import spline

pytestmark = pytest.mark.slow

SHAPE, NOISE = (330, 330), 3.0
AXIS = np.arange(30.0, 301.0, 10.0)
GRID = np.stack(np.meshgrid(AXIS, AXIS), axis=-1)
CENTRES = GRID.reshape(-1, 2)


def photographs(grain=0.0, seed=0):
    """The texture twice, with white noise, or noise that is correlated over ``grain`` pixels."""
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
def test_white_noise_has_the_covariance_of_the_hessian(subset):
    by_residual, white = [], []
    for seed in range(2):
        reference, target, found = matched(photographs(seed=seed), subset)
        covariances = place_covariances(reference, target, CENTRES.astype(int), found.warp, subset)
        hessian = found.covariance[:, [0, 1, 1, 2]].reshape(-1, 2, 2)
        np.testing.assert_allclose(2.0 * covariances.noise, hessian, rtol=0.02, atol=0.02 * hessian.max())
        by_residual.append(np.trace(covariances.residual, axis1=1, axis2=2))
        white.append(NOISE**2 * np.trace(hessian, axis1=1, axis2=2))
    assert np.mean(by_residual) == pytest.approx(np.mean(white), rel=0.04)


def test_correlated_noise_moves_subsets_as_their_residuals_show():
    """The subsets scatter more than by white noise of the same variance."""
    subset, errors, by_residual, white = Subset(31), [], [], []
    for seed in range(4):
        reference, target, found = matched(photographs(1.0, seed), subset)
        covariances = place_covariances(reference, target, CENTRES.astype(int), found.warp, subset)
        errors.append(found.warp[..., 0] - CENTRES)
        by_residual.append(covariances.residual[:, [0, 1], [0, 1]])
        white.append(2.0 * NOISE**2 * covariances.noise[:, [0, 1], [0, 1]])
    true = np.mean(np.square(errors))
    assert true > 3.0 * np.mean(white)
    assert np.mean(by_residual) == pytest.approx(true, rel=0.15)


def test_white_noise_is_not_misfit_and_correlated_noise_is():
    subset = Subset(21)
    for grain, min_share, max_share in ((0.0, 0.0, 0.12), (1.0, 1.0, 9.0)):
        reference, target, found = matched(photographs(grain), subset)
        warp = found.warp.reshape(*GRID.shape[:2], 2, 3).copy()
        warp[:3, :3] = np.nan
        level = np.full(GRID.shape[:2], 2.0 * NOISE**2)
        unit = 0.5 * found.covariance.reshape(*GRID.shape[:2], 3)
        stride = misfit_stride(np.isfinite(warp[..., 0, 0]))
        some = slice(None, None, stride), slice(None, None, stride)
        samples = sampled_misfit(reference, target, GRID[some], warp[some], subset, level[some])
        misfit = misfit_covariance(samples, stride, unit)
        assert misfit.shape == (*GRID.shape[:2], 3)
        assert np.isfinite(misfit).all()
        share = misfit.mean(axis=(0, 1)) / (NOISE**2 * found.covariance.mean(axis=0))
        assert min_share <= share[0] <= max_share
        assert min_share <= share[2] <= max_share


def test_subsets_outside_the_image_or_not_found_have_no_covariance():
    subset = Subset(21)
    reference, target, found = matched(photographs(), subset)
    centres, warp = np.array([[5, 100], [100, 100], [100, 100]]), found.warp[:3].copy()
    warp[:, :, 0] = 100.0
    warp[2] = np.nan
    covariances = place_covariances(reference, target, centres, warp, subset)
    np.testing.assert_array_equal(np.isnan(covariances.residual[:, 0, 0]), [True, False, True])
