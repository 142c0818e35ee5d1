import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dicflow.core.matching.transform import (
    MINIMUM_PAIRS,
    apply_transform,
    estimate_transform,
    jacobian,
    msac,
    transfer_error,
)

SIMILARITY = np.array([[1.1, -0.2, 30.0], [0.2, 1.1, -7.0], [0, 0, 1]])
AFFINE = np.array([[0.85, 0.03, 12.0], [-0.02, 1.39, -40.0], [0, 0, 1]])
PROJECTIVE = np.array([[1.2, 0.05, 5.0], [-0.04, 0.9, 8.0], [4e-5, -7e-5, 1]])
TRUTH = {"similarity": SIMILARITY, "affine": AFFINE, "projective": PROJECTIVE}
KINDS = list(TRUTH)


def points(count, seed=0):
    return np.random.default_rng(seed).uniform(0, 1000, (count, 2))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("extra", [0, 1, 50])
def test_perfect_pairs(kind, extra):
    source = points(MINIMUM_PAIRS[kind] + extra)
    found = estimate_transform(kind, source, apply_transform(TRUTH[kind], source))
    corners = np.array([[0.0, 0], [1000, 0], [1000, 1000], [0, 1000]])
    assert transfer_error(found, corners, apply_transform(TRUTH[kind], corners)).max() < 1e-9


@pytest.mark.parametrize("kind", KINDS)
def test_a_batch_is_each_alone(kind):
    source = np.stack([points(9, seed) for seed in range(4)])
    target = apply_transform(TRUTH[kind], source) + 0.1 * points(9)
    together = estimate_transform(kind, source, target)
    alone = [estimate_transform(kind, a, b) for a, b in zip(source, target, strict=True)]
    np.testing.assert_allclose(together, alone, rtol=0, atol=1e-9)


@pytest.mark.parametrize(("kind", "unknowns"), [("similarity", 4), ("affine", 6), ("projective", 8)])
def test_noise_leaves_the_residual_that_the_degrees_of_freedom_predict(kind, unknowns):
    count, sigma = 40, 0.2
    source = points(count)
    noise = np.random.default_rng(1).normal(0, sigma, (200, count, 2))
    target = apply_transform(TRUTH[kind], source) + noise
    found = estimate_transform(kind, np.broadcast_to(source, target.shape), target)
    squares = (transfer_error(found, source, target) ** 2).sum(axis=1)
    assert squares.mean() == pytest.approx(sigma**2 * (2 * count - unknowns), rel=0.03)


@pytest.mark.parametrize("kind", ["affine", "projective"])
def test_collinear_points_give_nan(kind):
    line = np.arange(6.0)[:, None] * [1.0, 2.0]
    assert np.isnan(estimate_transform(kind, line, line + 3)).all()


def test_coincident_points_give_nan():
    assert np.isnan(estimate_transform("similarity", np.ones((3, 2)), points(3))).all()


@pytest.mark.parametrize("kind", KINDS)
def test_too_few_pairs_are_refused(kind):
    few = points(MINIMUM_PAIRS[kind] - 1)
    with pytest.raises(ValueError, match="at least"):
        estimate_transform(kind, few, few)


def test_jacobian_is_the_derivative():
    place, step = points(5), 1e-4
    differences = [
        (apply_transform(PROJECTIVE, place + d) - apply_transform(PROJECTIVE, place - d)) / (2 * step)
        for d in step * np.eye(2)
    ]
    np.testing.assert_allclose(jacobian(PROJECTIVE, place), np.stack(differences, axis=-1), atol=1e-7)


def test_points_beyond_the_horizon_give_nan():
    steep = np.array([[1.0, 0, 0], [0, 1, 0], [-0.01, 0, 1]])
    carried = apply_transform(steep, np.array([[50.0, 0], [150.0, 0]]))
    np.testing.assert_allclose(carried[0], [100.0, 0.0])
    assert np.isnan(carried[1]).all()
    assert transfer_error(steep, np.array([[150.0, 0]]), np.zeros((1, 2))) == np.inf


@pytest.mark.parametrize("kind", KINDS)
def test_msac_finds_the_transform_among_forty_percent_outliers(kind):
    source = points(300)
    target = apply_transform(TRUTH[kind], source)
    target[:120] = points(120, seed=7)
    found = msac(kind, source, target)
    assert not found.inliers[:120].any()
    assert found.inliers[120:].all()
    assert transfer_error(found.transform, source[120:], target[120:]).max() < 1e-9
    assert found.residual_px < 1e-9


def test_msac_residual_is_the_noise():
    source = points(500)
    target = apply_transform(PROJECTIVE, source) + np.random.default_rng(3).normal(0, 0.2, (500, 2))
    found = msac("projective", source, target)
    assert found.inliers.all()
    assert found.residual_px == pytest.approx(0.2 * np.sqrt(2), rel=0.05)


def test_msac_gives_equal_bytes_for_equal_seeds():
    source = points(200)
    target = apply_transform(AFFINE, source) + np.random.default_rng(5).normal(0, 0.8, (200, 2))
    target[:60] += 40
    one, two = (msac("projective", source, target, seed=(4, 2)) for _ in range(2))
    assert one.transform.tobytes() == two.transform.tobytes()
    assert one.inliers.tobytes() == two.inliers.tobytes()


def test_msac_tries_more_when_more_is_wrong():
    source = points(100)
    clean, dirty = apply_transform(AFFINE, source), apply_transform(AFFINE, source)
    dirty[:70] = points(70, seed=9)
    tried = [msac("affine", source, target).trials for target in (clean, dirty)]
    assert tried[0] < 40 < np.log(0.01) / np.log(1 - 0.3**3) <= tried[1] + 32


@pytest.mark.parametrize("kind", KINDS)
def test_msac_without_enough_pairs_finds_nothing(kind):
    few = points(MINIMUM_PAIRS[kind] - 1)
    found = msac(kind, few, few)
    assert np.isnan(found.transform).all()
    assert np.isnan(found.residual_px)
    assert found.trials == 0


@settings(max_examples=25)
@given(angle=st.floats(-3, 3), scale=st.floats(0.2, 5), shift=st.floats(-1e3, 1e3), kind=st.sampled_from(KINDS))
def test_a_change_of_coordinates_changes_only_the_coordinates(angle, scale, shift, kind):
    c, s = scale * np.cos(angle), scale * np.sin(angle)
    change = np.array([[c, -s, shift], [s, c, -shift], [0, 0, 1]])
    source = points(12)
    target = apply_transform(TRUTH[kind], source) + 0.3 * points(12, seed=2) / 1000
    direct = apply_transform(change, apply_transform(estimate_transform(kind, source, target), source))
    moved = [apply_transform(change, p) for p in (source, target)]
    np.testing.assert_allclose(apply_transform(estimate_transform(kind, *moved), moved[0]), direct, atol=1e-6)
