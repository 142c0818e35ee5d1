"""Rigs refined from matched points: exact points with noise, so the motion of the cameras is always known."""

import numpy as np
import pytest
from boards import calibration_covariance, verged_rig

from dicflow.core.cameras.camera import project, rotation_angle_deg, to_right, undistort
from dicflow.core.cameras.relative_orientation import (
    MIN_POINTS,
    MatchedPoints,
    motion_since,
    refine_rig,
    unseen_motions,
)
from dicflow.core.cameras.rig_parameters import error_modes, rig_after_step
from dicflow.core.cameras.triangulate import triangulate

pytestmark = pytest.mark.slow

RIG = verged_rig()
COVARIANCE = calibration_covariance(RIG)
NOISE = 0.02
STEPS = {"flat": lambda x: 400.0 + 0.0 * x, "curved": lambda x: 400.0 + 8.0 * np.cos(400.0 * x / 20.0)}
TURN = np.radians(0.1)


def surface(generator, shape="curved", count=200):
    """Places (count, 3) in the left camera's frame that fill four fifths of its photograph."""
    pixels = generator.uniform([64.0, 48.0], [576.0, 432.0], (count, 2))
    x, y = undistort(RIG.left, pixels).T
    depth = STEPS[shape](x)
    return np.stack([x * depth, y * depth, depth], axis=-1)


def matched(places, generator, noise=NOISE, wrong=0.0):
    """What both cameras see of places (n, 3), with noise [px]; a share of the points is matched wrongly."""
    left, right = project(RIG.left, places), project(RIG.right, to_right(RIG, places))
    left, right = (xy + generator.normal(0.0, noise, xy.shape) for xy in (left, right))
    count = round(wrong * len(places))
    right[:count] += generator.uniform(-20.0, 20.0, (count, 2))
    covariance = np.tile([noise**2, 0.0, noise**2], (len(places), 1))
    return MatchedPoints(left, right, covariance, covariance)


def bumped(generator, rig=RIG, size=1.0):
    """The rig that was calibrated before the cameras moved: by 0.1° and by what moves the picture as far, each way."""
    step = np.zeros(24)
    step[18:21], step[21:] = size * TURN * generator.normal(size=(2, 3)) * [[1.0], [400.0]]
    return rig_after_step(rig, step)


def calibrated(generator):
    """The rig with errors of its calibration."""
    modes = error_modes(COVARIANCE)
    return rig_after_step(RIG, modes @ generator.normal(size=modes.shape[1]))


def measured(rig, places, motion=(1.0, 0.5, 1.5)):
    """X, Y, Z, U, V, W (n, 6) of places, and of a motion, as a rig measures them without noise."""
    before, after = (
        triangulate(rig, project(RIG.left, points), project(RIG.right, to_right(RIG, points))).xyz
        for points in (places, places + motion)
    )
    return np.concatenate([before - places, after - before - motion], axis=-1)


def over_sigma(refined, places):
    """Errors of X, Y, Z, U, V, W (n, 6) over the standard deviation by the covariance of the rig."""
    errors = measured(refined.rig, places)
    changes = [
        measured(rig_after_step(refined.rig, mode), places) - errors for mode in error_modes(refined.covariance).T
    ]
    return errors / np.sqrt(np.sum(np.square(changes), axis=0))


def draws(count, shape="curved", points=200, size=1.0, **options):
    """Normalised errors (count, n, 6) at 25 places after bumps of any direction."""
    found = []
    for seed in range(count):
        generator = np.random.default_rng(seed)
        places, before = surface(generator, shape, points), bumped(generator, calibrated(generator), size)
        refined = refine_rig(before, COVARIANCE, matched(places, generator, **options))
        found.append(over_sigma(refined, places[-25:]))
    return np.abs(np.array(found))


def test_exact_points_lead_back_to_the_rig_but_for_the_length_of_the_baseline():
    generator = np.random.default_rng(1)
    before, places = bumped(generator), surface(generator)
    refined = refine_rig(before, None, matched(places, generator, noise=1e-7))
    assert rotation_angle_deg(refined.rig.rotation, RIG.rotation) < 1e-3
    ratio = refined.rig.translation / RIG.translation
    np.testing.assert_allclose(ratio, ratio[0], atol=1e-4)
    assert np.linalg.norm(refined.rig.translation) == pytest.approx(np.linalg.norm(before.translation), abs=0.01)
    found = triangulate(refined.rig, *matched(places, generator, noise=1e-7)).xyz
    np.testing.assert_allclose(found / places, ratio[0], atol=1e-4)


def test_the_length_of_the_baseline_stays_as_uncertain_as_the_motion_across_it():
    generator = np.random.default_rng(2)
    refined = refine_rig(bumped(generator), None, matched(surface(generator), generator))
    along = refined.rig.translation / np.linalg.norm(refined.rig.translation)
    sigma = np.sqrt(along @ refined.covariance[21:, 21:] @ along)
    assert sigma == pytest.approx(refined.motion * 400.0, rel=0.03)
    assert 0.5 < sigma < 1.5


@pytest.mark.parametrize(
    ("shape", "options"),
    [
        ("curved", {}),
        ("flat", {}),
        ("curved", {"size": 5.0}),
        ("curved", {"wrong": 0.05}),
        ("curved", {"points": 30}),
        ("flat", {"points": 30}),
    ],
    ids=["curved", "flat", "larger bumps", "wrong matches", "few points", "few on a plane"],
)
def test_errors_of_places_and_motions_have_their_stated_size(shape, options):
    """Over bumps in any direction. Places of one draw share their error, so 32 draws scatter by 8 %."""
    found = draws(32, shape, **options)
    within = (found < 1.0).mean(axis=(0, 1)), (found < 2.0).mean(axis=(0, 1))
    assert (within[0] > 0.48).all()
    assert (within[1] > 0.85).all()
    assert (within[0] < 0.93).all()


def test_a_rig_that_has_not_moved_keeps_its_calibration():
    gains, shrunk = [], []
    for seed in range(20):
        generator = np.random.default_rng(seed)
        refined = refine_rig(calibrated(generator), COVARIANCE, matched(surface(generator), generator), turn_deg=0.0)
        gains.append(refined.gain)
        shrunk.append(np.sqrt(np.diag(refined.covariance)[18:] / np.diag(COVARIANCE)[18:]))
    assert max(gains) < 4.0
    assert np.median(shrunk) < 1.0
    assert np.max(shrunk) < 1.5


def test_the_covariance_is_the_scatter_over_noise():
    """Of one motion and noise drawn anew: what the noise leaves of the directions that the points show."""
    generator = np.random.default_rng(3)
    places, before = surface(generator), bumped(generator)
    found = [refine_rig(before, None, matched(places, generator)) for _ in range(30)]
    directions = np.linalg.eigh(found[0].covariance[18:, 18:] / np.outer(*2 * [[1e-3] * 3 + [0.4] * 3]))[1][:, :3]
    scaled = directions / np.array([1e-3] * 3 + [0.4] * 3)[:, None]
    turns = [motion_vector(before, one.rig) @ scaled for one in found]
    stated = np.sqrt(np.diag(scaled.T @ found[0].covariance[18:, 18:] @ scaled))
    np.testing.assert_allclose(np.std(turns, axis=0), stated, rtol=0.35)


def motion_vector(before, after):
    """Turn and shift (6,) from one rig to another."""
    from dicflow.core.cameras.camera import rotation_vector

    return np.concatenate([rotation_vector(after.rotation @ before.rotation.T), after.translation - before.translation])


def test_wrong_matches_do_not_count():
    """The same points with and without a twentieth that lies anywhere."""
    clean, wrong = (
        refine_rig(
            bumped(np.random.default_rng(5)),
            COVARIANCE,
            matched(surface(np.random.default_rng(6)), np.random.default_rng(7), wrong=share),
        )
        for share in (0.0, 0.05)
    )
    sigma = np.sqrt(np.diag(clean.covariance)[18:])
    assert (np.abs(motion_vector(clean.rig, wrong.rig)) < sigma).all()
    far = np.abs(wrong.residual) > 5.0
    assert far[:10].mean() > 0.8
    assert not far[10:].any()


def test_errors_in_common_to_neighbours_count_once():
    """Points in groups of four with one error each are a quarter as many."""
    generator = np.random.default_rng(8)
    places, before = np.repeat(surface(generator, count=300), 4, axis=0), bumped(generator)
    points = matched(places, generator)
    noise = np.repeat(generator.normal(0.0, NOISE, (300, 2)), 4, axis=0)
    common = points._replace(left=project(RIG.left, places) + noise, right=project(RIG.right, to_right(RIG, places)))
    single = refine_rig(before, None, points)
    grouped = refine_rig(before, None, common._replace(covariance_right=1e-6 * points.covariance_right))
    assert single.noise == pytest.approx(1.0, abs=0.2)
    assert grouped.noise == pytest.approx(2.0, abs=0.4)


def test_what_the_points_do_not_show():
    generator = np.random.default_rng(9)
    refined = refine_rig(bumped(generator), COVARIANCE, matched(surface(generator), generator))
    named = unseen_motions(refined)
    assert any("along the baseline" in name for name in named)
    assert not any("about X" in name or "about Z" in name for name in named)


@pytest.mark.parametrize("axis", [0, 2])
def test_the_motion_is_that_of_the_right_camera(axis):
    turn = TURN * np.eye(3)[axis]
    step = np.concatenate([np.zeros(18), turn, np.cross(turn, RIG.translation)])  # about its own centre
    generator = np.random.default_rng(10)
    refined = refine_rig(rig_after_step(RIG, -step), COVARIANCE, matched(surface(generator), generator))
    motion = motion_since(rig_after_step(RIG, -step), refined)
    assert motion.turn_deg == pytest.approx(0.1, abs=2.0 * motion.sigma_turn_deg)
    assert motion.shift_mm < 2.0 * motion.sigma_shift_mm
    assert refined.apparent_turn_deg == pytest.approx(0.1, abs=0.02)


def test_a_focal_length_is_estimated_on_request():
    """Of a camera that was refocused: places and motions are within their uncertainty."""
    step = np.zeros(24)
    step[[9, 10]] = 0.01 * RIG.right.matrix[0, 0]
    generator = np.random.default_rng(11)
    places = surface(generator)
    freed = refine_rig(rig_after_step(RIG, step), COVARIANCE, matched(places, generator), 0.0, ("focal_length",))
    sigma = np.sqrt(freed.covariance[9, 9])
    assert abs(freed.rig.right.matrix[0, 0] - RIG.right.matrix[0, 0]) < 2.0 * sigma
    assert sigma < 0.5 * step[9]
    assert np.abs(over_sigma(freed, places[:25])).max() < 3.0


def test_too_few_points():
    generator = np.random.default_rng(12)
    with pytest.raises(ValueError, match=f"needs {MIN_POINTS} matched points, found 19"):
        refine_rig(RIG, None, matched(surface(generator, count=19), generator))
