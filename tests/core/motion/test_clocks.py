"""Clocks of two cameras, joined by motions whose offset is known."""

import numpy as np
import pytest

from dicflow.core.motion.clocks import Signal, join_clocks, principal_motions

OFFSET = 0.37


def pull(t):
    """A pull with a start and an end, and the swaying of the machine."""
    return 30.0 * np.clip((t - 2.0) / 14.0, 0.0, 1.0) ** 1.5 + 0.5 * np.sin(8.0 * t + 0.4 * t**1.5)


def flash(t):
    """Brighter for 0.4 s."""
    return 90.0 * np.clip(1.0 - np.abs(t - 5.0) / 0.2, 0.0, 1.0)


def seen(course, noise=0.0, seed=0, rates=(30.0, 25.0), seconds=20.0):
    """What two cameras see of a course over time; the right one another scale, bent, and with a slow drift."""
    rng = np.random.default_rng(seed)
    left, right = (np.arange(round(rate * seconds)) / rate for rate in rates)
    one, other = course(left), course(right + OFFSET)
    bent = 0.8 * other + 0.002 * other**2 + 0.01 * right + 3.0
    values = (np.stack([one, 0.1 * one], axis=1), bent[:, None])
    noisy = [value + noise * rng.standard_normal(value.shape) for value in values]
    return Signal(left, noisy[0]), Signal(right, noisy[1])


@pytest.mark.parametrize(("course", "noise"), [(pull, 0.0), (pull, 0.02), (flash, 0.5)])
def test_the_offset_of_a_pull_and_of_a_flash(course, noise):
    found = join_clocks(*seen(course, noise))
    assert found.offset == pytest.approx(OFFSET, abs=0.003)
    assert found.is_unique


@pytest.mark.slow
def test_the_uncertainty_covers_the_errors():
    found = [join_clocks(*seen(pull, 0.05, seed)) for seed in range(20)]
    errors = np.array([one.offset - OFFSET for one in found])
    u = np.array([one.u for one in found])
    assert np.abs(errors).max() < 0.01
    assert (np.abs(errors) <= 2.0 * u).mean() >= 0.9


def test_exchanging_the_cameras_changes_the_sign():
    left, right = seen(pull, 0.01)
    assert join_clocks(right, left).offset == pytest.approx(-join_clocks(left, right).offset, abs=0.002)


def test_a_steady_motion_and_rest_say_nothing():
    assert join_clocks(*seen(lambda t: 1.5 * t)) is None or join_clocks(*seen(lambda t: 1.5 * t, 0.01)).u > 0.1
    assert join_clocks(*seen(np.zeros_like)) is None


def test_a_motion_that_repeats_itself_is_not_unique():
    assert not join_clocks(*seen(lambda t: 5.0 * np.sin(np.pi * t), 0.01)).is_unique


def swaying(times, mix, rng):
    """A pull, and a specimen that sways with three frequencies, as cells of a camera see it."""
    pull = 12.0 * np.clip((times - 1.5) / 16.0, 0.0, 1.0) ** 1.5
    sways = [np.sin(2.0 * np.pi * f * times + f) for f in (0.31, 0.83, 0.47)]
    motions = np.stack([pull, pull**2 / 60.0, pull * sways[0] / 12.0, *sways], axis=1)
    cells = motions @ mix + rng.normal(0.0, 0.05, (times.size, 24))
    return Signal(times - times[0], principal_motions(cells.reshape(times.size, 12, 2)))


def found_in_a_part(seed):
    """How two cameras are joined that saw parts of such a test, and the truth."""
    rng = np.random.default_rng(seed)
    mixes = rng.normal(size=(2, 6, 24))
    mixes[:, 0] += 2.0
    mixes[1] = 0.8 * mixes[0] + 0.5 * mixes[1]
    length = rng.uniform(7.0, 20.0)
    start = rng.uniform(0.0, 20.0 - length)
    other = float(np.clip(start + rng.uniform(-0.3, 0.3) * length, 0.0, 20.0 - 0.9 * length))
    left, right = (
        swaying(begin + np.arange(int(seconds * rate)) / rate, mix, rng)
        for begin, seconds, rate, mix in zip(
            (start, other), (length, min(0.8 * length, 20.0 - other)), (30.0, 25.0), mixes, strict=True
        )
    )
    return join_clocks(left, right), other - start


@pytest.mark.slow
def test_few_frames_that_happen_to_fit_do_not_win_over_many():
    """An offset by some periods of one motion fits where both saw little of the pull; if it is found, it is refused."""
    found = [found_in_a_part(seed) for seed in range(12)]
    errors = [joined.offset - truth for joined, truth in found if joined is not None and joined.is_unique]
    right = sum(abs(error) < 0.012 for error in errors)
    assert right >= 5
    assert len(errors) == right


def test_principal_motions_are_the_independent_ones_of_all_cells():
    t = np.linspace(0.0, 10.0, 200)
    two = np.stack([np.sin(t), t**2], axis=1)
    cells = (two @ np.random.default_rng(0).normal(size=(2, 24))).reshape(200, 12, 2)
    found = principal_motions(cells)
    assert found.shape == (200, 3)
    assert np.abs(found[:, 2]).max() < 1e-9
    rest = np.linalg.lstsq(np.c_[np.ones(200), found[:, :2]], two, rcond=None)[1]
    assert (rest < 1e-9).all()
