import cv2
import numpy as np
import pytest

from dicflow.core.parts import Parts
from dicflow.core.surfaces.shape_bias import PlacesOfSubsets, affine_suffices, as_of_affine, shape_bias
from tests.noise import subset_kernel

SUBSET, STEP, SIGMA = 31, 7, 0.006
X, Y = np.meshgrid(*(STEP * np.arange(count, dtype=float) for count in (100, 110)))
OFFSETS = np.arange(SUBSET) - SUBSET // 2
INSIDE = (slice(20, -20), slice(20, -20), 0)
VARIANCE = np.full((*X.shape, 2), SIGMA**2)
NO_NOISE = np.zeros((*X.shape, 2))


def left_out(shape_function, length):
    """Share of a wave of this length [px] that a subset leaves out, by a least-squares fit to it at its crest."""
    degree = {"affine": 1, "quadratic": 2}[shape_function]
    return 1.0 - np.polynomial.Polynomial.fit(OFFSETS, np.cos(2.0 * np.pi * OFFSETS / length), degree)(0.0)


def suffices(found):
    return affine_suffices(shape_bias(found, SUBSET, STEP, "affine"), found.variance)


def measured(motion):
    return np.stack([X + motion, Y], axis=-1)


@pytest.mark.parametrize("shape_function", ["affine", "quadratic"])
@pytest.mark.parametrize(("length", "tolerance"), [(800.0, 0.12), (400.0, 0.12), (200.0, 0.15)])
def test_the_bias_of_a_wave(shape_function, length, tolerance):
    share = left_out(shape_function, length)
    places = measured((1.0 - share) * 0.5 * np.sin(2.0 * np.pi * X / length))
    found = shape_bias(PlacesOfSubsets(places, NO_NOISE), SUBSET, STEP, shape_function).deviation[INSIDE]
    assert np.sqrt(np.mean(found**2)) == pytest.approx(0.5 * share / np.sqrt(2.0), rel=tolerance)


@pytest.mark.parametrize("shape_function", ["affine", "quadratic"])
def test_an_affine_motion_has_no_bias(shape_function):
    found = shape_bias(
        PlacesOfSubsets(measured(3.0 + 0.2 * X - 0.1 * Y), NO_NOISE), SUBSET, STEP, shape_function
    ).deviation
    assert np.nanmax(found) < 1e-6


def noise(seed, shape_function="affine"):
    """Noise of places of overlapping subsets, of variance SIGMA² for affine ones."""
    white = np.random.default_rng(seed).standard_normal((2, STEP * len(X) + 40, STEP * len(X[0]) + 40))
    kernel = subset_kernel(SUBSET, shape_function, normalised=False)
    fields = [cv2.filter2D(part, -1, kernel)[20:-20:STEP, 20:-20:STEP] for part in white]
    return SIGMA * SUBSET * np.stack(fields, axis=-1)


@pytest.mark.parametrize("seed", range(5))
def test_noise_alone_asks_for_nothing(seed):
    found = PlacesOfSubsets(measured(0.01 * X) + noise(seed), VARIANCE)
    assert np.median(shape_bias(found, SUBSET, STEP, "affine").deviation) < 0.15 * SIGMA
    assert suffices(found)


@pytest.mark.parametrize("seed", range(5))
def test_noise_of_quadratic_subsets_asks_for_nothing(seed):
    found = PlacesOfSubsets(measured(0.01 * X) + noise(seed, "quadratic"), 3.5 * VARIANCE)
    assert suffices(as_of_affine(found, SUBSET, STEP))


@pytest.mark.parametrize(("over_sigma", "enough"), [(0.15, True), (0.3, True), (0.6, False)])
def test_a_curved_motion_asks_for_quadratic_subsets(over_sigma, enough):
    """A constant curvature c gives affine subsets a bias of c (h² − 1) / 24."""
    curvature = over_sigma * SIGMA * 24.0 / (SUBSET**2 - 1)
    found = PlacesOfSubsets(measured(0.5 * curvature * X**2) + noise(0), VARIANCE)
    assert suffices(found) is enough
    quadratic = PlacesOfSubsets(measured(0.5 * curvature * X**2) + noise(0, "quadratic"), 3.5 * VARIANCE)
    assert suffices(as_of_affine(quadratic, SUBSET, STEP)) is enough


def test_lost_points_have_no_bias_and_leave_the_others_theirs():
    places = measured(0.5 * 1e-5 * X**2)
    places[40:60, 50:52] = np.nan
    found = shape_bias(PlacesOfSubsets(places, NO_NOISE), SUBSET, STEP, "affine").deviation
    assert np.array_equal(np.isnan(found), np.isnan(places))
    np.testing.assert_allclose(found[20:-20, 20:30, 0], 1e-5 * (SUBSET**2 - 1) / 24.0, rtol=1e-3)
    assert suffices(PlacesOfSubsets(np.full_like(places, np.nan), NO_NOISE))


def test_a_crack_says_nothing_of_the_shape_of_other_subsets():
    opened = PlacesOfSubsets(measured(np.where(X > 350.0, 0.5, 0.0)) + noise(0), VARIANCE)
    beside = np.abs(X - 353.5) < STEP
    assert affine_suffices(shape_bias(opened, SUBSET, STEP, "affine", jumps=beside), VARIANCE)
    assert not affine_suffices(shape_bias(opened, SUBSET, STEP, "affine"), VARIANCE)


def test_parts_are_asked_one_by_one():
    number = np.where(X > 350.0, 2, 1).astype(np.int32)
    opened = PlacesOfSubsets(measured(np.where(number == 2, 0.5, 0.0)) + noise(0), VARIANCE)
    parts = Parts(number, np.stack([X, Y], axis=-1), np.zeros((0, 4)))
    assert affine_suffices(shape_bias(opened, SUBSET, STEP, "affine", parts), VARIANCE)


def test_a_bias_is_known_where_a_place_is_even_without_its_variance():
    places, variance = measured(0.02 * X) + noise(3), VARIANCE.copy()
    variance[40:44, 50:53] = np.nan
    found = shape_bias(PlacesOfSubsets(places, variance), SUBSET, STEP, "affine")
    assert np.isfinite(found.nearest).all()
    number = np.where(np.arange(len(X))[:, None] < 60, 1, 2) * np.ones(X.shape, dtype=int)
    parts = Parts(number, np.stack([X, Y], axis=-1), np.zeros((0, 4)))
    assert shape_bias(PlacesOfSubsets(places, VARIANCE), SUBSET, STEP, "affine", parts).nearest.dtype == np.float32
