"""The right photographs of a series whose truth is known exactly: matched at every step, or followed in time."""

from unittest.mock import patch

import numpy as np
import pytest
import stereo_scene
from stereo_scene import LENGTH, REST, WIDTH, State, photographs, right_truth, space_truth
from test_stereo_correlation import MATERIAL, MOVED, NOISE, images, measured, rig_product, scaled_errors, tracked

from dicflow.core.correlation.subsets import Subset
from dicflow.core.status import Status
from dicflow.core.synthetic.render import add_noise_and_round
from dicflow.core.synthetic.speckle import scatter_speckles
from dicflow.engine.product import Product
from dicflow.errors import StageError
from dicflow.stages.stereo import Stereo

pytestmark = pytest.mark.slow

HALFWAY = State(stretch=1.02, bulge=-0.1, curl=0.3, turn=(0.02, 0.05, 0.01), shift=(0.2, 0.1, -0.5))
STATES = (REST, HALFWAY, MOVED)


@pytest.fixture(scope="module")
def pairs():
    return [photographs(state, NOISE, seed) for seed, state in enumerate(STATES)]


@pytest.fixture(scope="module")
def left(pairs):
    return tracked(pairs, states=STATES)


@pytest.fixture(scope="module")
def ways(pairs, left):
    """The steps by either way."""
    return {match: measured(pairs, left, match=match) for match in ("every_step", "first_step")}


def test_the_first_step_is_matched_in_either_case(ways):
    matched, followed = (ways[match][0][0] for match in ("every_step", "first_step"))
    for name, variable in matched.variables.items():
        np.testing.assert_array_equal(followed[name], variable.values)


@pytest.mark.parametrize("match", ["every_step", "first_step"])
def test_either_way_meets_the_truth(ways, match):
    for (stereo, points), state in zip(ways[match], STATES, strict=True):
        assert not stereo["status"].any()
        assert stereo.attrs["match"] == match
        error = stereo["xy"] - right_truth(MATERIAL, state)
        assert np.abs(error.mean(axis=(0, 1))).max() < 5e-4
        assert error.std() < 0.004
        assert (np.abs((points["xyz"] - space_truth(MATERIAL, state)).mean(axis=(0, 1))) < [2e-5, 2e-5, 1e-4]).all()
        assert points["epipolar"].max() < 0.02


def test_what_the_first_match_gets_wrong_stays_with_a_point(pairs, left, ways):
    """A first place that is off by a fifth of a pixel moves on with the surface there."""
    first, wrong = ways["first_step"][0][0], np.array([0.2, -0.1])
    moved = {name: first.variables[name] for name in first.variables}
    for name in ("xy", "warp"):
        values = first[name].copy()
        (values if name == "xy" else values[..., 0])[...] += wrong
        moved[name] = first.variables[name]._replace(values=values)
    off = Product("stereo", moved, first.attrs)
    photographs = [images(*pair) for pair in pairs]
    stereo = Stereo(match="first_step").run(
        images=photographs[1],
        images_first=photographs[0],
        images_before=photographs[0],
        rig=rig_product(),
        correlation=left[1],
        correlation_first=left[0],
        correlation_before=left[0],
        stereo_first=off,
        stereo_before=off,
    )
    right = ways["first_step"][1][0]
    slope = right["gradient"] @ np.linalg.inv(first["gradient"])
    np.testing.assert_allclose(stereo["xy"] - right["xy"], slope @ wrong, atol=6e-3)


@pytest.mark.parametrize(
    ("subset", "states"),
    [(Subset(31, "quadratic"), (REST, MOVED)), (Subset(31, "affine"), (State(), MOVED._replace(bulge=0.0, curl=0.0)))],
    ids=["one shape function", "another one on the left"],
)
def test_sigma_covers_the_errors_of_followed_points(subset, states):
    """Of X, Y, Z at both steps, and of U, V, W: that the first match is common to all steps included."""
    size = scaled_errors(subset, states, match="first_step")
    np.testing.assert_allclose((size < 1.0).mean(axis=1), 0.683, atol=0.03)
    np.testing.assert_allclose((size < 2.0).mean(axis=1), 0.954, atol=0.02)


def test_the_template_has_the_noise_measured_at_a_later_step(pairs, left):
    """The first photograph alone gives twice as much."""
    steps = [left[0], tracked(pairs[:2], states=STATES, noise=0.25)[1]]
    matched, followed = (measured(pairs[:2], steps, match=match)[1][0] for match in ("every_step", "first_step"))
    ratio = followed["template"][..., [0, 2]] / matched["template"][..., [0, 2]]
    np.testing.assert_allclose(ratio, 1.0, atol=0.05)


def test_points_that_are_not_matched_at_first_are_never_followed(pairs, left):
    covered = pairs[0][1].copy()
    covered[:, :220] = 90
    steps = measured([(pairs[0][0], covered), *pairs[1:]], left, match="first_step")
    lost = steps[0][0]["status"] != Status.VALID
    assert 0.1 < lost.mean() < 0.9
    for stereo, _ in steps[1:]:
        np.testing.assert_array_equal(stereo["status"][lost], steps[0][0]["status"][lost])
        assert np.isnan(stereo["xy"][lost]).all()
        assert (stereo["status"][~lost] == Status.VALID).mean() > 0.95


def test_points_return_after_a_step_that_does_not_show_them(pairs, left, ways):
    dark = np.full_like(pairs[1][1], 30)
    steps = measured([pairs[0], (pairs[1][0], dark), pairs[2]], left, match="first_step")
    assert not (steps[1][0]["status"] == Status.VALID).any()
    assert not steps[2][0]["status"].any()
    np.testing.assert_allclose(steps[2][0]["xy"], ways["first_step"][2][0]["xy"], atol=2e-3)


def test_a_right_view_that_changes_is_followed_through_references(left):
    """From step to step little of the pattern is another one; in the end hardly any of it is as at first."""
    states, shares = (REST, HALFWAY, MOVED, MOVED), (0.0, 0.25, 0.5, 0.75)
    with patch.object(stereo_scene, "SPECKLES", scatter_speckles((WIDTH, LENGTH), (0.2, 0.32), 0.11, seed=9)):
        other = [stereo_scene.clean.__wrapped__(state)[1] for state in states]
    pairs = []
    for step, (state, share) in enumerate(zip(states, shares, strict=True)):
        one, two = stereo_scene.clean(state)
        mixed = (1.0 - share) * two + share * other[step]
        pairs.append((add_noise_and_round(one, NOISE, [step, 0]), add_noise_and_round(mixed, NOISE, [step, 1])))
    left = tracked(pairs, states=states)
    assert (measured(pairs, left)[3][0]["status"] != Status.VALID).mean() > 0.9
    stereo, _ = measured(pairs, left, match="first_step")[3]
    valid = stereo["status"] == Status.VALID
    assert valid.mean() > 0.5
    assert (stereo["way"][valid] == 2).mean() > 0.9
    error = stereo["xy"] - right_truth(MATERIAL, states[3])
    assert np.nanstd(error) < 0.5


@pytest.fixture(scope="module")
def first(pairs):
    return pairs[0]


def bright(image, gain):
    return np.clip(gain * image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("gain", [1.3, 1.6])
def test_overexposed_points_of_the_right_photograph_are_counted(first, left, gain):
    right = bright(first[1], gain)
    stereo, _ = measured([(first[0], right)], left[:1])[0]
    x, y = np.rint(stereo["xy"][stereo["status"] == 0]).astype(int).T
    assert stereo.attrs["summary"]["overexposed_share"] == pytest.approx((right[y, x] == 255).mean(), abs=0.01)


def test_an_overexposed_first_right_photograph_is_refused(first, left):
    with pytest.raises(StageError, match=r"overexposed .*first right photograph"):
        measured([(first[0], bright(first[1], 2.5))], left[:1])


def test_a_first_right_photograph_without_contrast_is_refused(first, left):
    dull = np.rint(100.0 + 0.05 * first[1]).astype(np.uint8)
    with pytest.raises(StageError, match=r"texture .*first right photograph"):
        measured([(first[0], dull)], left[:1])
