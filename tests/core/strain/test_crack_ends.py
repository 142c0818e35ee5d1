"""Bias around the end of a crack: Williams' field on points with the noise of overlapping subsets."""

import numpy as np
import pytest

from dicflow.core.strain.crack_ends import with_crack_ends
from dicflow.core.strain.deformation_gradient import ErrorShare, measured_surface
from dicflow.core.strain.degree_choice import candidate_fits, chosen_gradient
from dicflow.core.uncertainty.overlap import overlap
from tests.noise import point_errors

STEP, SUBSET, WINDOW, NOISE_PX = 7, 31, 7, 0.005
SHAPE = (50, 60)
ROW, COL = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
TIP = np.array([210.0, 171.0])
"""Column and row of the crack's end [px]; the crack comes from the left."""
X, Y = STEP * COL - TIP[0], STEP * ROW - TIP[1]
LOST = (np.abs(Y) < 0.5 * SUBSET) & (X < 0.25 * SUBSET)
NEAR = (np.hypot(X, Y) < 1.5 * SUBSET) & ~LOST
FITS = candidate_fits((WINDOW, WINDOW), "auto")
_STEP_PX = 1e-3


def williams(x, y, opening=0.05, sliding=0.03, kappa=2.08):
    """Displacement (…, 2) around a crack's end at the origin that comes from −x; factors of √px."""
    angle, root = np.arctan2(y, x), np.hypot(x, y) ** 0.5
    sin, cos = np.sin(0.5 * angle), np.cos(0.5 * angle)
    along = opening * cos * (kappa - 1.0 + 2.0 * sin**2) + sliding * sin * (kappa + 1.0 + 2.0 * cos**2)
    across = opening * sin * (kappa + 1.0 - 2.0 * cos**2) - sliding * cos * (kappa - 1.0 - 2.0 * sin**2)
    return np.stack([root * along, root * across], axis=-1)


def stretched(x, y):
    """A plate with 1 % strain and a little shear."""
    return np.stack([0.01 * x + 0.002 * y, -0.003 * y], axis=-1)


def gradient_of(motion):
    """Exact gradient (row, col, 2, 2) by differences over a thousandth of a pixel."""
    along_x = (motion(X + _STEP_PX, Y) - motion(X - _STEP_PX, Y)) / (2.0 * _STEP_PX)
    along_y = (motion(X, Y + _STEP_PX) - motion(X, Y - _STEP_PX)) / (2.0 * _STEP_PX)
    return np.eye(2) + np.stack([along_x, along_y], axis=-1)


def measured(motion, seed, lost):
    reference = np.stack([X, Y, 0.0 * X], axis=-1)
    deformed = reference.copy()
    deformed[..., :2] += motion(X, Y)
    deformed[..., :2] += point_errors(np.random.default_rng(seed), SHAPE, NOISE_PX**2 * np.eye(2), SUBSET, STEP)
    deformed[lost] = np.nan
    covariance = np.diag([NOISE_PX**2, NOISE_PX**2, 1e-12, 0.0, 0.0, 0.0])
    share = ErrorShare(np.broadcast_to(covariance, (*SHAPE, 6, 6)), overlap(SUBSET, STEP))
    return measured_surface(reference, deformed, [share])


def over_stated(found, truth):
    """Errors (row, col, 4) of the gradient over their uncertainty."""
    errors = (found.surface.gradient - truth).reshape(*SHAPE, 4)
    noise, bias = (np.diagonal(moments, axis1=-2, axis2=-1) for moments in (found.surface.covariance, found.bias))
    return np.abs(errors) / np.sqrt(noise + bias)


@pytest.mark.parametrize("factors", [(0.05, 0.03), (0.15, 0.0), (0.0, 0.15)])
def test_strains_around_the_end_are_covered(factors):
    """Nearer than one and a half subsets to the end, where by the polynomials alone twice as many are beyond 3u."""
    truth = gradient_of(lambda x, y: williams(x, y, *factors))
    alone, stated = [], []
    for seed in range(3):
        surface = measured(lambda x, y: williams(x, y, *factors), seed, LOST)
        found = chosen_gradient(surface, FITS)
        alone.append(over_stated(found, truth)[NEAR])
        stated.append(over_stated(with_crack_ends(found, surface, LOST, FITS[0]), truth)[NEAR])
    beyond_alone, beyond = (np.mean(np.array(scores) > 3.0) for scores in (alone, stated))
    assert beyond < 0.02
    assert beyond < 0.6 * beyond_alone


def test_only_windows_on_both_sides_of_lost_points_change():
    """Where the motion is one that degree 1 follows, what is stated of them grows by noise alone."""
    across = np.abs(Y) < 0.5 * SUBSET
    for lost, is_end in ((LOST, True), (across, False), (np.zeros(SHAPE, dtype=bool), False)):
        surface = measured(stretched, 5, lost)
        found = chosen_gradient(surface, FITS)
        more = np.trace(with_crack_ends(found, surface, lost, FITS[0]).bias - found.bias, axis1=-2, axis2=-1)
        assert (np.nan_to_num(more) > 0.0).any() == is_end
        assert not (more[np.hypot(X, Y) > 1.5 * WINDOW * STEP] > 0.0).any()
