"""Scatter and reach of errors of points beside what is stated, with the noise of overlapping subsets."""

import numpy as np
import pytest
from scipy.optimize import nnls
from scipy.signal import fftconvolve

from dicflow.core.strain import point_scatter
from dicflow.core.strain.deformation_gradient import ErrorShare, measured_surface
from dicflow.core.strain.point_scatter import scatter_of_points
from dicflow.core.strain.small_jumps import GridOfSubsets
from dicflow.core.uncertainty.overlap import overlap
from tests.noise import point_errors, subset_kernel

STEP, SUBSET, SIGMA_PX = 7, 31, 0.01
SHAPE = (60, 70)
ROW, COL = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
SUBSETS = GridOfSubsets(SUBSET, STEP, "affine")


def surface_of(errors, displacement=0.0, shape=SHAPE):
    """Points of a plane [px] with errors (row, col, 2), of which σ is stated alike along x and y."""
    rows, cols = shape
    reference = STEP * np.stack([COL, ROW, 0.0 * ROW], axis=-1)
    deformed = reference.copy()
    deformed[..., 0] += displacement
    deformed[..., :2] += errors
    covariance = np.broadcast_to(SIGMA_PX**2 * np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]), (*SHAPE, 6, 6))
    share = ErrorShare(covariance[:rows, :cols], overlap(SUBSET, STEP))
    return measured_surface(reference[:rows, :cols], deformed[:rows, :cols], [share])


def plain(sizes_px, seed=2):
    """Errors (row, col, 2) of given sizes along x and y, as subsets average noise."""
    return point_errors(np.random.default_rng(seed), SHAPE, np.diag(np.square(sizes_px)), SUBSET, STEP)


def derived(seed=4):
    """Errors (row, col) of σ = 1, of which subsets average the derivative along x."""
    kernel = np.diff(np.pad(subset_kernel(SUBSET, normalised=False), 1), axis=1)
    edge = np.exp(-0.5 * (np.arange(-9, 10) / 3.0) ** 2)[None]
    kernel = fftconvolve(kernel, edge)
    pixels = [(n - 1) * STEP + side for n, side in zip(SHAPE, kernel.shape, strict=True)]
    noise = np.random.default_rng(seed).normal(size=pixels)
    return fftconvolve(noise, kernel, mode="valid")[::STEP, ::STEP] / np.sqrt((kernel**2).sum())


def found(surface, bias=None, misfit_share=0.0):
    return scatter_of_points(surface, SUBSETS, ["affine"], bias, misfit_share)


def deviations(scatter):
    """Ratio of the scatter to σ along each axis, the median over the points."""
    return np.array([np.median(axis.variance) ** 0.5 for axis in scatter])


def test_errors_as_stated_count_for_nothing():
    """Without misfit exactly, also where few points scatter more by chance, and along an axis without errors."""
    for seed in range(3):
        for shape in (SHAPE, (20, 15), (4, 4)):
            assert all(axis.is_as_stated for axis in found(surface_of(plain((SIGMA_PX, SIGMA_PX), seed), shape=shape)))


def test_errors_as_stated_hardly_count_where_half_of_them_is_misfit():
    for seed in range(3):
        scatter = found(surface_of(plain((SIGMA_PX, SIGMA_PX), seed)), misfit_share=0.5)
        assert deviations(scatter) == pytest.approx([1.0, 1.0, 1.0], abs=0.06)


def test_larger_errors_show_on_their_axis():
    scatter = found(surface_of(plain((1.5 * SIGMA_PX, 0.5 * SIGMA_PX))))
    assert deviations(scatter)[0] == pytest.approx(1.5, rel=0.1)
    assert all(axis.is_as_stated for axis in scatter[1:])


def test_smaller_errors_show_as_far_as_misfit_is_stated():
    surface = surface_of(plain((SIGMA_PX, 0.5 * SIGMA_PX)))
    assert deviations(found(surface, misfit_share=1.0))[:2] == pytest.approx([1.0, 0.5], rel=0.15)
    assert deviations(found(surface, misfit_share=0.5))[1] >= 0.5**0.5
    assert found(surface)[1].is_as_stated


def test_a_bias_that_is_known_is_no_scatter():
    bias = np.broadcast_to([SIGMA_PX * 1.25**0.5, 0.0, 0.0], (*SHAPE, 3))
    surface = surface_of(plain((1.5 * SIGMA_PX, SIGMA_PX)))
    assert deviations(found(surface, bias))[0] == pytest.approx(1.0, abs=0.06)


def test_points_where_motion_is_steep_tell_nothing_about_misfit():
    """A band of errors that are as large as their known bias does not hide that misfit is overstated elsewhere."""
    band = np.abs(COL - 34.5) < 7.0
    surface = surface_of(np.where(band, 2.5, 0.7)[..., None] * plain((SIGMA_PX, SIGMA_PX)))
    bias = np.where(band, 2.5 * SIGMA_PX, 0.0)[..., None] * [1.0, 1.0, 0.0]
    assert deviations(found(surface, bias, misfit_share=0.8))[:2] == pytest.approx([0.7, 0.7], abs=0.1)
    assert deviations(found(surface, misfit_share=0.8))[0] > 0.95


def test_no_threshold_decides():
    """Each tenth of more scatter makes the ratio larger by less than three of them."""
    sizes = SIGMA_PX * np.arange(1.0, 1.6, 0.1)
    ratios = [deviations(found(surface_of(plain((size, SIGMA_PX)))))[0] for size in sizes]
    assert ratios[0] == 1.0
    assert np.diff(ratios).min() >= 0.0
    assert np.diff(ratios).max() < 0.3


@pytest.mark.parametrize("length", [600.0, 200.0])
def test_waves_are_no_scatter(length):
    """Of 10 % strain: the widest window does not follow the shorter one, the smallest does."""
    wave = 0.1 * length / (2.0 * np.pi) * np.sin(2.0 * np.pi * STEP * COL / length)
    surface = surface_of(plain((SIGMA_PX, SIGMA_PX)), wave)
    assert all(axis.is_as_stated for axis in found(surface))
    assert deviations(found(surface, misfit_share=0.2)) == pytest.approx([1.0, 1.0, 1.0], abs=0.06)


def test_derivatives_reach_less_far():
    """Half of the variance by noise, half by a derivative: σ of slopes along x and y, of those that are seen."""
    errors = plain((SIGMA_PX * 0.5**0.5, SIGMA_PX))
    errors[..., 0] += SIGMA_PX * 0.5**0.5 * derived()
    axis = found(surface_of(errors), misfit_share=0.5)[0]
    rho = axis.correlation(SUBSET, STEP, "affine")
    slope = np.broadcast_to(np.arange(-3.0, 4.0), (7, 7))
    for weights in (slope, slope.T):
        seen = fftconvolve(errors[..., 0], weights[::-1, ::-1], mode="valid").std()
        ratio = (np.median(axis.variance) * rho.variance(weights)) ** 0.5 * SIGMA_PX / seen
        assert ratio == pytest.approx(1.0, abs=0.1)
    assert SIGMA_PX * overlap(SUBSET, STEP).variance(slope.T) ** 0.5 > 1.15 * seen


def test_misfit_of_a_region_counts_there():
    """Twice the σ in the left half: regions differ as the errors do, some subsets away from the border."""
    growth = np.where(COL < 35, 2.0, 1.0)
    for seed in range(3):
        axis = found(surface_of(growth[..., None] * plain((SIGMA_PX, SIGMA_PX), seed)), misfit_share=0.5)[0]
        left, right = (np.median(axis.variance[:, part]) ** 0.5 for part in (slice(0, 15), slice(55, 70)))
        assert left / right == pytest.approx(2.0, rel=0.2)
        assert 1.5 < left < 2.3


def test_coefficients_that_must_not_be_negative_are_those_of_scipy():
    rng = np.random.default_rng(0)
    for _ in range(50):
        terms, wanted = np.abs(rng.normal(size=(7, 5))), rng.normal(size=7)
        np.testing.assert_allclose(point_scatter._none_negative(terms, wanted), nnls(terms, wanted)[0], atol=1e-9)
