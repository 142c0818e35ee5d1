"""Deformation gradients beside a crack: each side moves and stretches on its own."""

import numpy as np

from dicflow.core.parts import Parts, cut_segments, single_part
from dicflow.core.strain.deformation_gradient import ErrorShare, measured_surface
from dicflow.core.strain.degree_choice import chosen_gradient
from dicflow.core.strain.remaining_bias import WindowFit
from dicflow.core.uncertainty.overlap import overlap

STEP = 5.0
COL, ROW = np.meshgrid(np.arange(16.0), np.arange(14.0))
PLACES = STEP * np.stack([COL, ROW], axis=-1)
REFERENCE = np.pad(PLACES, [(0, 0), (0, 0), (0, 1)])
BELOW = ROW >= 7
ERRORS = [ErrorShare(np.broadcast_to(np.eye(6) * 1e-4, (*ROW.shape, 6, 6)), overlap(11, STEP, "affine"))]


def opened(stretches, gap):
    """Both sides of a crack between rows 6 and 7, stretched along x each on its own, moved apart by a gap."""
    moved = REFERENCE.copy()
    moved[..., 0] *= np.where(BELOW, *stretches[::-1])
    moved[..., 1] += np.where(BELOW, gap, 0.0)
    return moved


def gradient_of(reference, deformed, parts=None):
    return chosen_gradient(measured_surface(reference, deformed, ERRORS, parts), [WindowFit((5, 5), 1)]).surface


def exact(gradient, xx, yy=1.0):
    np.testing.assert_allclose(gradient[..., 0, 0], xx, atol=1e-9)
    np.testing.assert_allclose(gradient[..., 1, 1], yy, atol=1e-9)


def test_parts_are_measured_each_on_its_own():
    parts = Parts(np.where(BELOW, 2, 1).astype(np.int32), PLACES, np.zeros((0, 4)))
    found = gradient_of(REFERENCE, opened((1.02, 0.97), 4.0), parts)
    exact(found.gradient[~BELOW], 1.02)
    exact(found.gradient[BELOW], 0.97)
    mixed = gradient_of(REFERENCE, opened((1.02, 0.97), 4.0))
    assert mixed.gradient[6, :, 1, 1].min() > 1.1
    upper = gradient_of(np.where(BELOW[..., None], np.nan, REFERENCE), REFERENCE)
    np.testing.assert_allclose(found.covariance[6, 8], upper.covariance[6, 8], rtol=0.1, atol=1e-12)


def test_a_cut_that_ends_inside():
    """Left of its tip each side has a window of its own; far right of it the windows are whole."""
    cut = cut_segments([np.array([[-10.0, 32.5], [37.5, 32.5]])])
    parts = single_part(PLACES)._replace(cuts=cut)
    found = gradient_of(REFERENCE, opened((1.0, 1.0), 4.0), parts)
    exact(found.gradient[:, :5], 1.0)
    whole = gradient_of(REFERENCE, opened((1.0, 1.0), 4.0))
    np.testing.assert_allclose(found.gradient[:, 12:], whole.gradient[:, 12:], atol=1e-9)


def test_a_single_part_is_measured_as_ever():
    one = gradient_of(REFERENCE, opened((1.0, 1.0), 4.0), single_part(PLACES))
    other = gradient_of(REFERENCE, opened((1.0, 1.0), 4.0))
    for a, b in zip(one, other, strict=True):
        np.testing.assert_array_equal(a, b)
