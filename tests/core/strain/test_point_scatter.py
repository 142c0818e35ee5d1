"""Scatter of points over their σ, with the noise of overlapping subsets."""

import numpy as np
import pytest

from dicflow.core.strain.deformation_gradient import ErrorShare, measured_surface
from dicflow.core.strain.point_scatter import scatter_over_stated
from dicflow.core.strain.small_jumps import GridOfSubsets
from dicflow.core.uncertainty.overlap import overlap
from tests.noise import point_errors

STEP, SUBSET, SIGMA_PX = 7, 31, 0.01
SHAPE = (60, 70)
ROW, COL = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
SUBSETS = GridOfSubsets(SUBSET, STEP, "affine")


def measured(true_px, displacement=0.0, shape=SHAPE, seed=2):
    """Points of a plane [px] with errors of given sizes along x and y, of which σ is stated alike."""
    rows, cols = shape
    reference = STEP * np.stack([COL, ROW, 0.0 * ROW], axis=-1)
    deformed = reference.copy()
    deformed[..., 0] += displacement
    deformed[..., :2] += point_errors(np.random.default_rng(seed), SHAPE, np.diag(np.square(true_px)), SUBSET, STEP)
    covariance = np.broadcast_to(SIGMA_PX**2 * np.diag([1.0, 1.0, 0.0, 0.0, 0.0, 0.0]), (*SHAPE, 6, 6))
    share = ErrorShare(covariance[:rows, :cols], overlap(SUBSET, STEP))
    return measured_surface(reference[:rows, :cols], deformed[:rows, :cols], [share])


def test_errors_as_stated_count_for_nothing():
    """Exactly 1, also where fewer points scatter more by chance, and along an axis without errors."""
    for seed in range(3):
        for shape in (SHAPE, (20, 15), (4, 4)):
            assert (
                scatter_over_stated(measured((SIGMA_PX, SIGMA_PX), shape=shape, seed=seed), SUBSETS).tolist()
                == [1.0] * 3
            )


def test_larger_errors_show_on_their_axis():
    found = scatter_over_stated(measured((1.5 * SIGMA_PX, 0.5 * SIGMA_PX)), SUBSETS)
    assert found[0] == pytest.approx(1.5, rel=0.1)
    assert found[1:].tolist() == [1.0, 1.0]


def test_smaller_errors_show_as_far_as_misfit_is_stated():
    surface = measured((SIGMA_PX, 0.5 * SIGMA_PX))
    assert scatter_over_stated(surface, SUBSETS, misfit_share=1.0)[:2] == pytest.approx([1.0, 0.5], rel=0.15)
    assert scatter_over_stated(surface, SUBSETS, misfit_share=0.5)[1] >= 0.5**0.5
    assert scatter_over_stated(surface, SUBSETS)[1] == 1.0


def test_a_bias_that_is_known_is_no_scatter():
    bias = np.broadcast_to([SIGMA_PX * 1.25**0.5, 0.0, 0.0], (*SHAPE, 3))
    surface = measured((1.5 * SIGMA_PX, SIGMA_PX))
    assert scatter_over_stated(surface, SUBSETS, bias)[0] == pytest.approx(1.0, abs=0.06)


def test_no_threshold_decides():
    """Each tenth of more scatter makes the ratio larger by less than three of them."""
    sizes = SIGMA_PX * np.arange(1.0, 1.6, 0.1)
    found = [scatter_over_stated(measured((size, SIGMA_PX)), SUBSETS)[0] for size in sizes]
    assert found[0] == 1.0
    assert np.diff(found).min() >= 0.0
    assert np.diff(found).max() < 0.3


@pytest.mark.parametrize("length", [600.0, 200.0])
def test_waves_are_no_scatter(length):
    """Of 10 % strain: the widest window does not follow the shorter one, the smallest does."""
    wave = 0.1 * length / (2.0 * np.pi) * np.sin(2.0 * np.pi * STEP * COL / length)
    assert scatter_over_stated(measured((SIGMA_PX, SIGMA_PX), wave), SUBSETS).tolist() == [1.0, 1.0, 1.0]
