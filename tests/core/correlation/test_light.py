"""Residuals of slow changes of the light, and how far these moved a place."""

import numpy as np
import pytest

from dicflow.core.correlation.light import light_shift
from dicflow.core.correlation.subsets import Subset, residuals
from dicflow.core.correlation.template import template
from dicflow.core.correlation.warp import identity
from dicflow.core.photographs.interpolate import spline

SIDE, SIZE = 61, 31
Y, X = np.mgrid[:SIDE, :SIDE] - SIDE // 2
PATTERN = 120.0 + 40.0 * np.sin(0.9 * X + 0.4 * Y) + 30.0 * np.cos(0.5 * X - 0.8 * Y)
CENTRE = np.array([[SIDE // 2, SIDE // 2]])
SUBSET = Subset(SIZE, "quadratic")


def fitted(target, shift=0.0):
    """The residuals of the middle of the pattern in a target, placed ``shift`` too far right [px]."""
    warp = identity(CENTRE + np.array([shift, 0.0]), SUBSET.shape_function)
    return residuals(template(spline(PATTERN)), spline(target), CENTRE, warp, SUBSET)


def test_the_same_photograph_leaves_nothing():
    fit = fitted(1.2 * PATTERN + 7.0)
    assert np.abs(fit.residual).max() < 1e-3
    assert fit.f.std() == pytest.approx(PATTERN[15:46, 15:46].std(), rel=1e-6)


def test_slow_light_explains_its_residuals_and_moves_nothing_more():
    fit = fitted(PATTERN * (1.0 + 0.002 * X) + 0.01 * Y**2)
    shift, share = light_shift(fit, np.array([True]), SIZE)
    assert share[0] == pytest.approx(1.0, abs=0.02)
    assert shift[0] < 0.01


@pytest.mark.parametrize("shift", [0.05, -0.1])
def test_the_shift_of_the_place_beside_the_light(shift):
    """Gauss-Newton leads back to the true place, under any light."""
    fit = fitted(PATTERN * (1.0 + 0.002 * X) + 0.01 * Y**2, shift)
    found, _ = light_shift(fit, np.array([True]), SIZE)
    assert found[0] == pytest.approx(abs(shift), rel=0.1)


def test_only_chosen_subsets_are_computed():
    shift, share = light_shift(fitted(PATTERN + X), np.array([False]), SIZE)
    assert shift[0] == share[0] == 0.0
