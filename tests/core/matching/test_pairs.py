import numpy as np
import pytest
from blobs import Pattern

from dicflow.core.matching.features import Features, detect
from dicflow.core.matching.pairs import (
    agreeing_matches,
    consistent_matches,
    guided_matches,
    local_motion,
    match_features,
)

RNG = np.random.default_rng(0)
COUNT = 300


def features(xy, descriptors):
    none = np.zeros(len(xy), dtype=np.float32)
    return Features(np.asarray(xy, dtype=np.float32), none, none, none, descriptors)


def described(kind, count=COUNT, seed=0):
    rng = np.random.default_rng(seed)
    if kind == "binary":
        return rng.integers(0, 256, (count, 32), dtype=np.uint8)
    return rng.normal(size=(count, 64)).astype(np.float32)


PLACES = RNG.uniform(0, 500, (COUNT, 2))
ORDER = RNG.permutation(COUNT)


@pytest.mark.parametrize("kind", ["binary", "float"])
def test_shuffled_features_find_their_partners(kind):
    descriptors = described(kind)
    pairs = match_features(features(PLACES, descriptors), features(PLACES[ORDER], descriptors[ORDER]))
    np.testing.assert_array_equal(pairs[:, 0], np.arange(COUNT))
    np.testing.assert_array_equal(ORDER[pairs[:, 1]], np.arange(COUNT))


@pytest.mark.parametrize("kind", ["binary", "float"])
def test_a_partner_that_exists_twice_is_no_partner(kind):
    descriptors = described(kind)
    twice = np.concatenate([descriptors, descriptors[:10]])
    pairs = match_features(features(PLACES, descriptors), features(np.zeros((COUNT + 10, 2)), twice))
    np.testing.assert_array_equal(pairs[:, 0], np.arange(10, COUNT))


def test_mutual_keeps_one_of_two_with_the_same_partner():
    descriptors = described("float")
    near = descriptors[:1] + np.float32(0.01)
    reference = features(np.zeros((COUNT + 1, 2)), np.concatenate([descriptors, near]))
    deformed = features(PLACES, descriptors)
    assert len(match_features(reference, deformed, mutual=False)) == COUNT + 1
    pairs = match_features(reference, deformed)
    np.testing.assert_array_equal(pairs[:, 0], np.arange(COUNT))


@pytest.mark.parametrize("counts", [(0, 9), (9, 0), (9, 1)])
def test_without_features_there_are_no_matches(counts):
    sides = [features(PLACES[:n], described("float", n)) for n in counts]
    assert match_features(*sides).shape == (0, 2)


def test_guided_matches_distinguish_equal_features_by_position():
    descriptors = np.repeat(described("float", COUNT // 2), 2, axis=0)
    moved = PLACES + np.array([30.0, -12.0])
    reference, deformed = features(PLACES, descriptors), features(moved, descriptors)
    assert len(match_features(reference, deformed)) == 0
    pairs = guided_matches(reference, deformed, moved + RNG.normal(0, 0.3, moved.shape), radius_px=4)
    assert len(pairs) > 0.95 * COUNT
    np.testing.assert_array_equal(pairs[:, 0], pairs[:, 1])


def test_guided_matches_keep_to_the_radius():
    both = features(PLACES, described("float"))
    assert len(guided_matches(both, both, PLACES + 5.0, radius_px=4)) <= 0.1 * COUNT
    assert len(guided_matches(both, both, PLACES + 2.0, radius_px=4)) > 0.9 * COUNT


@pytest.mark.parametrize("detector", ["KAZE", "AKAZE", "ORB", "SIFT"])
def test_a_quarter_turn_needs_features_with_an_orientation(detector):
    image = Pattern((20, 20, 130, 130)).photograph((150, 150), seed=1)
    turned = np.ascontiguousarray(np.rot90(image))
    upright, oriented = (
        len(match_features(detect(image, detector, upright=flag), detect(turned, detector, upright=flag)))
        for flag in (True, False)
    )
    assert oriented > 100
    assert upright < 0.1 * oriented


def test_no_deformed_feature_is_matched_twice():
    reference, deformed = features(PLACES, described("float")), features(PLACES / 4, described("float", seed=4))
    pairs = guided_matches(reference, deformed, PLACES / 4, radius_px=9, ratio=1.0)
    assert len(pairs) > 20
    assert len(np.unique(pairs[:, 1])) == len(pairs)


def quadratic(points):
    x, y = (points / 500).T
    return points + 20 * np.stack([x * y, y**2 - x], axis=1)


def test_consistent_finds_the_false_matches():
    target = quadratic(PLACES)
    target[:90] += np.random.default_rng(3).uniform(8, 60, (90, 2)) * np.random.default_rng(4).choice([-1, 1], (90, 2))
    keep = consistent_matches(PLACES, target)
    assert not keep[:90].any()
    assert keep[90:].mean() > 0.98


def test_few_matches_cannot_be_judged():
    assert consistent_matches(PLACES[:10], PLACES[::-1][:10]).all()


def test_local_motion_is_exact_for_affine_motion():
    linear, shift = np.array([[0.85, 0.02], [-0.03, 1.4]]), [7.0, -3.0]
    points = RNG.uniform(0, 500, (50, 2))
    found = local_motion(PLACES, PLACES @ linear.T + shift, points)
    np.testing.assert_allclose(found.position, points @ linear.T + shift, atol=1e-9)
    np.testing.assert_allclose(found.gradient, np.broadcast_to(linear, (50, 2, 2)), atol=1e-9)


def test_local_motion_converges_with_the_square_of_the_spacing():
    errors = []
    for spacing in (20.0, 10.0):
        grid = np.stack(np.meshgrid(np.arange(0, 401, spacing), np.arange(0, 401, spacing)), axis=-1).reshape(-1, 2)
        points = np.random.default_rng(5).uniform(150, 250, (200, 2))
        found = local_motion(grid, quadratic(grid), points)
        errors.append(np.sqrt(np.mean((found.position - quadratic(points)) ** 2)))
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.3)


def test_local_motion_has_no_jumps():
    line = np.stack([np.linspace(100, 400, 20001), np.full(20001, 237.0)], axis=1)
    motion = local_motion(PLACES, PLACES + RNG.normal(0, 1.0, PLACES.shape), line).position - line
    assert np.abs(np.diff(motion, axis=0)).max() < 0.02


def test_collinear_neighbours_give_their_mean_motion():
    source = np.stack([np.arange(30.0), np.zeros(30)], axis=1)
    found = local_motion(source, source + np.array([3.0, 4.0]), np.array([[15.0, 50.0]]))
    np.testing.assert_allclose(found.position, [[18.0, 54.0]], atol=1e-9)


@pytest.mark.parametrize(("count", "false"), [(12, 3), (300, 120)])
def test_agreeing_matches_of_a_half_turn(count, false):
    """False matches are recognised among few and among many, at any rotation."""
    rng = np.random.default_rng(1)
    angle = np.radians(170.0)
    source = rng.uniform(0.0, 300.0, (count, 2))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    target = (source - 150.0) @ turn.T + 150.0 + rng.normal(0.0, 0.2, source.shape)
    target[:false] += rng.choice([-1.0, 1.0], (false, 2)) * rng.uniform(40.0, 90.0, (false, 2))
    keep = agreeing_matches(source, target)
    assert not keep[:false].any()
    assert keep[false:].mean() > 0.97


def test_a_feature_of_unknown_place_has_no_guided_match():
    both = features(PLACES, described("float"))
    predicted = PLACES.copy()
    predicted[::3] = np.nan
    pairs = guided_matches(both, both, predicted, radius_px=4)
    np.testing.assert_array_equal(pairs[:, 0], np.flatnonzero(np.arange(COUNT) % 3))


def test_a_point_that_sees_too_few_matches_has_no_place_and_no_turn():
    def seen(points, others):
        return (points > 0) & (others >= 0) | (others < 2)

    motion = local_motion(PLACES, 1.1 * PLACES, PLACES[:2], seen)
    assert np.isnan(motion.position[0]).all()
    np.testing.assert_array_equal(motion.gradient[0], np.eye(2))
    np.testing.assert_allclose(motion.gradient[1], 1.1 * np.eye(2), atol=1e-9)
