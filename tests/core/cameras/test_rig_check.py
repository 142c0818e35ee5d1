"""Whether a rig is still calibrated: rigs with errors as their covariance says fit, rigs that were bumped do not."""

from __future__ import annotations

import numpy as np
import pytest

from dicflow.core.cameras.rig_check import check_rig
from tests.core.cameras.test_relative_orientation import COVARIANCE, RIG, bumped, calibrated, matched, surface

pytestmark = pytest.mark.slow


def checked(seed, rig=None, **how):
    """Exact places with noise of 0.02 px, checked with a rig; None for one with an error of its calibration."""
    generator = np.random.default_rng(seed)
    points = matched(surface(generator), generator, **how)
    return check_rig(calibrated(generator) if rig is None else rig, COVARIANCE, points)


def test_without_errors_the_distance_is_that_of_the_noise():
    """In the right photograph, √2 of the noise of one place."""
    exact = check_rig(RIG, np.zeros((24, 24)), matched(surface(np.random.default_rng(1)), np.random.default_rng(2)))
    assert exact is not None
    assert exact.distance_px == pytest.approx(np.sqrt(2.0) * 0.02, rel=0.15)
    assert exact.fits


def test_a_calibrated_rig_fits_whatever_its_error():
    found = [checked(seed) for seed in range(40)]
    assert sum(one.fits for one in found) >= 37
    ratios = np.array([one.distance_px / one.expected_px for one in found])
    assert 0.5 < np.sqrt(np.mean(ratios**2)) < 1.5
    assert found[0].sentence.startswith("Yes, the rig is still calibrated: the points of the first step lie 0.0")
    assert f"{found[0].expected_px:.2g} px are expected" in found[0].sentence


def test_a_bumped_rig_does_not_fit_and_the_sentence_says_what_to_do():
    found = [checked(seed, bumped(np.random.default_rng(100 + seed))) for seed in range(20)]
    assert not any(one.fits for one in found)
    assert found[0].sentence.startswith("No, the rig is not calibrated any more: the points of the first step lie")
    assert "Add a stage 'refine'" in found[0].sentence


def test_wrong_matches_do_not_decide():
    assert checked(3, wrong=0.1).fits


def test_too_few_points_tell_nothing():
    generator = np.random.default_rng(4)
    assert check_rig(RIG, COVARIANCE, matched(surface(generator, count=10), generator)) is None
