"""The rig refined from photographs of a specimen with exact truth, and from those of a real one."""

import re

import numpy as np
import pytest
from boards import calibration_covariance
from left_camera import correlation, grid
from stereo_scene import REGION, REST, RIG, State, left_truth, material, photographs, right_truth, space_truth

from dicflow.core.cameras.camera import Rig
from dicflow.core.cameras.rig_parameters import error_modes, rig_after_step
from dicflow.core.cameras.triangulate import triangulate
from dicflow.errors import StageError
from dicflow.kinds.images import Images
from dicflow.kinds.rig import CalibratedRig
from dicflow.stages.refine import Refine
from dicflow.stages.stereo import Stereo

pytestmark = pytest.mark.slow

MOVED = State(stretch=1.05, bulge=-0.2, curl=0.3, turn=(0.05, 0.1, 0.03), shift=(0.5, 0.3, -1.0))
COVARIANCE = calibration_covariance(RIG, scale=0.25)
POINTS = grid(REGION, 12).astype(float)
MATERIAL = material(POINTS)
TURN = np.radians(0.1)


def images(state):
    return Images.write(*photographs(state))


def bumped(turn=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)):
    """The rig before its right camera turned about its own centre [rad], and was shifted [mm]."""
    step = np.concatenate([np.zeros(18), turn, np.cross(turn, RIG.translation) + shift])
    return rig_after_step(RIG, -step)


def product(rig, covariance=COVARIANCE):
    return CalibratedRig.write(rig, "", {"baseline_mm": 1.0, "angle_deg": 1.0}, covariance=covariance)


def refined(rig, states=(REST, MOVED), covariance=COVARIANCE, **parameters):
    first, *early = map(images, states)
    return CalibratedRig.read(
        Refine(**parameters).run(rig=product(rig, covariance), images=first, images_early=tuple(early) or None)
    )


def places_and_motions(rig: Rig):
    """X, Y, Z at rest and U, V, W (row, col, 6) of the points as a rig measures them, less the true ones."""
    at_rest, moved = (
        triangulate(rig, left_truth(MATERIAL, state), right_truth(MATERIAL, state)).xyz for state in (REST, MOVED)
    )
    true = space_truth(MATERIAL, REST), space_truth(MATERIAL, MOVED)
    return np.concatenate([at_rest - true[0], moved - at_rest - (true[1] - true[0])], axis=-1)


def over_sigma(found: CalibratedRig):
    """The same over the standard deviations by the covariance of the rig."""
    errors = places_and_motions(found.cameras)
    modes = error_modes(found.covariance).T
    changes = [places_and_motions(rig_after_step(found.cameras, mode)) - errors for mode in modes]
    return errors / np.sqrt(np.sum(np.square(changes), axis=0))


@pytest.mark.parametrize(
    ("turn", "shift"),
    [
        ((TURN, 0, 0), (0, 0, 0)),
        ((0, TURN, 0), (0, 0, 0)),
        ((0, 0, TURN), (0, 0, 0)),
        ((0, 0, 0), (0.5, 0, 0)),
        ((0, 0, 0), (0, 0.5, 0)),
        ((0, 0, 0), (0, 0, 0.5)),
        (TURN * np.array([0.5, -0.6, 0.6]), (0.3, 0.3, -0.3)),
    ],
    ids=["about x", "about y", "about z", "along x", "along y", "along z", "both"],
)
def test_places_and_motions_are_within_their_uncertainty_after_a_bump(turn, shift):
    found = refined(bumped(np.array(turn, dtype=float), np.array(shift, dtype=float)))
    assert np.abs(over_sigma(found)).max() < 3.0
    assert found.summary["distance_px"] < 0.05


def test_it_says_how_far_a_camera_has_turned_and_what_does_not_show():
    found = refined(bumped(turn=(TURN, 0, 0)))
    figures = found.summary
    assert figures["turn_deg"] == pytest.approx(0.1, abs=2.0 * figures["sigma_turn_deg"])
    assert figures["apparent_turn_deg"] == pytest.approx(0.1, abs=0.01)
    assert "as after a turn of the right camera by 0.1°" in found.verdict
    assert "do not show" in found.verdict
    assert "along the baseline" in found.verdict
    assert figures["distance_before_px"] > 3.0
    assert figures["baseline_mm"] == pytest.approx(100.0, abs=2.0)


def test_cameras_that_stand_as_calibrated_stay():
    found = refined(RIG, turn=0.0)
    assert "no motion of the cameras" in found.verdict
    assert np.abs(over_sigma(found)).max() < 3.0
    before, after = np.diag(COVARIANCE), np.diag(found.covariance)
    estimated = before > 0.0  # what was not, as a further term of the distortion, is allowed for
    assert (after[estimated] <= before[estimated]).all()


def test_without_an_uncertainty_of_the_calibration_that_of_the_orientation_is_stated():
    found = refined(bumped(turn=(TURN, 0, 0)), covariance=None)
    assert np.abs(over_sigma(found)).max() < 3.0
    assert any("without its uncertainty" in warning for warning in found.warnings)


def test_photographs_of_different_things_refine_nothing():
    noise = np.random.default_rng(0).integers(0, 255, (2, 500, 600), dtype=np.uint8)
    with pytest.raises(StageError, match="points of the left photographs are found in the right ones"):
        Refine().run(rig=product(RIG), images=Images.write(*noise))


def stereo(rig):
    left, right = photographs(REST)
    points = correlation(left, None, POINTS, left_truth(MATERIAL, REST))
    first = Images.write(left, right)
    return Stereo().run(
        images=first, images_first=first, rig=product(rig), correlation=points, correlation_first=points
    )


def test_the_stereo_stage_says_that_a_camera_was_bumped():
    with pytest.raises(StageError, match=r"turn of the right camera by 0\.1° .*stage: refine"):
        stereo(bumped(turn=(TURN, 0, 0)))
    product = stereo(bumped(turn=(0.03 * TURN, 0, 0)))
    (warning,) = product.warnings
    found = re.search(r"as after a turn of the right camera by (\d\.\d+)°", warning)
    assert found is not None
    assert float(found[1]) == pytest.approx(0.003, abs=0.00025)
    assert "{stage: refine, images: photos, rig: rig}" in warning
    assert not stereo(RIG).warnings
