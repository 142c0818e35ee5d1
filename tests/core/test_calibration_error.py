import numpy as np
import pytest

from dicflow.core.calibration_error import (
    error_modes,
    mode_displacement_sigma,
    mode_gradient_covariance,
    spread_out,
    thinned,
)
from dicflow.core.deformation_gradient import gradient_response

SHAPE = (30, 20)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]] * 0.4


def test_modes_make_up_the_covariance():
    root = np.random.default_rng(0).normal(size=(6, 3)) * np.array([1e3, 1, 1e-4, 0, 1, 1e2])[:, None]
    modes = error_modes(root @ root.T)
    assert modes.shape == (6, 3)
    assert np.allclose(modes @ modes.T, root @ root.T, rtol=1e-9, atol=1e-12)
    assert error_modes(np.zeros((4, 4))).shape == (4, 0)


def test_modes_of_scale_and_shift():
    """A mode that magnifies by 0.1 % at both states gives the displacement 0.1 % and no strain, a shift nothing."""
    flat = np.stack([X, Y, np.zeros(SHAPE)], axis=-1)
    stretched = flat * [1.0, 1.5, 1.0] + [3.0, 0.0, 0.0]
    shift = np.broadcast_to([0.2, 0.3, 0.4], flat.shape)
    after, before = (np.stack([1e-3 * state, shift], axis=-1) for state in (stretched, flat))
    assert np.allclose(mode_displacement_sigma(after, before), 1e-3 * np.abs(stretched - flat))
    slopes = [np.stack([np.gradient(state, axis=axis) for axis in (1, 0)], axis=-1) for state in (flat, stretched)]
    assert np.abs(mode_gradient_covariance(after, before, gradient_response(*slopes))).max() < 1e-18
    only = mode_gradient_covariance(after, 0 * before, gradient_response(*slopes))
    assert np.allclose(np.sqrt(only[5, 5, [0, 3], [0, 3]]), [1e-3, 1.5e-3])


def test_a_thinned_grid_tells_the_same_strain():
    """A mode that stretches by 1e-4 along Y, on all points and on every third."""
    flat = np.stack([X, Y, np.zeros(SHAPE)], axis=-1)
    after, before = 1e-4 * (flat * [0.0, 1.0, 0.0])[..., None], np.zeros((*SHAPE, 3, 1))
    slopes = [np.stack([np.gradient(flat, axis=axis) for axis in (1, 0)], axis=-1)] * 2
    response = gradient_response(*slopes)
    whole = mode_gradient_covariance(after, before, response)
    part = (slice(1, None, 3), slice(1, None, 3))
    few = mode_gradient_covariance(after[part], before[part], response[part], stride=3)
    assert np.allclose(whole[..., 3, 3], 1e-8)
    assert np.allclose(few, whole[part], atol=1e-20)


@pytest.mark.parametrize("shape", [(30, 20), (150, 80), (401, 395), (40, 300), (5, 900)])
def test_a_thinned_field_comes_back(shape):
    field = np.add.outer(np.arange(shape[0]), 0.3 * np.arange(shape[1])).astype(float)
    part = thinned(shape)
    assert field[part].size <= max(4 * 2000, field.size / 4)
    coarse = field[part].copy()
    whole = spread_out(coarse, shape)
    assert whole.shape == shape
    assert np.abs(whole - field).max() <= 1.3 * part[0].step
    assert np.array_equal(whole[part], coarse)


def test_holes_of_a_thinned_field_take_the_nearest():
    field = np.ones(SHAPE)
    field[:, 10:] = 2.0
    field[3:6, 2:4] = np.nan
    assert np.array_equal(spread_out(field, SHAPE), np.where(np.arange(20) >= 10, 2.0, np.ones(SHAPE)))
    assert np.isnan(spread_out(np.nan * field, SHAPE)).all()
