"""The offset of two clocks by the motion that both saw."""

import numpy as np
import pytest

from dicflow.core.channels.offset import change, find_offset

SECONDS = np.arange(0.0, 150.0, 0.1)
AT = np.arange(0.0, 60.0)


def ramp(t):
    """Rest, loading, rest, a slower unloading, by the clock of the pictures."""
    return np.interp(t, [8.0, 28.0, 36.0, 50.0], [0.0, 30.0, 30.0, 9.0])


def seen(motion, rng, noise=0.1):
    """What a picture's change tells of a motion: bounded, with noise."""
    moved = np.abs(np.diff(motion))
    return 10.0 * moved / (moved + 1.0) + 1.0 + rng.normal(0.0, noise, moved.size)


@pytest.mark.slow
def test_errors_of_the_offset_agree_with_its_uncertainty():
    rng = np.random.default_rng(2)
    errors, predicted = [], []
    for true in rng.uniform(0.0, 60.0, 40):
        log = ramp(SECONDS - true) + rng.normal(0.0, 0.003, SECONDS.size)
        found = find_offset(AT, seen(ramp(AT), rng), SECONDS, log)
        assert found.is_clear
        errors.append(found.seconds - true)
        predicted.append(found.u)
    assert np.abs(errors).max() < 0.2
    ratio = np.sqrt(np.mean(np.square(errors))) / np.sqrt(np.mean(np.square(predicted)))
    assert 0.5 < ratio < 1.5


def test_equal_cycles_are_told_apart_by_their_first_and_last():
    def cycles(t):
        return np.where((t > 5.0) & (t < 45.0), 5.0 * np.sin((t - 5.0) * np.pi / 8.0) ** 2, 0.0)

    at = np.arange(0.0, 55.0, 0.4)
    found = find_offset(at, seen(cycles(at), np.random.default_rng(1)), SECONDS, cycles(SECONDS - 12.4))
    assert found.is_clear
    assert found.seconds == pytest.approx(12.4, abs=0.1)


def test_what_has_nothing_in_common_is_not_clear():
    rng = np.random.default_rng(3)
    assert not find_offset(AT, rng.random(AT.size - 1), SECONDS, ramp(SECONDS - 20.0)).is_clear


def test_endless_equal_cycles_are_not_clear():
    waves = 5.0 * np.sin(SECONDS * np.pi / 8.0) ** 2
    part = AT[:40]
    found = find_offset(part, seen(5.0 * np.sin(part * np.pi / 8.0) ** 2, np.random.default_rng(4)), SECONDS, waves)
    assert not found.is_clear


@pytest.mark.parametrize(("changes", "values"), [(np.ones(59), ramp(SECONDS)), (np.arange(59.0), 0.0 * SECONDS)])
def test_without_motion_there_is_no_offset(changes, values):
    with pytest.raises(ValueError, match="motion"):
        find_offset(AT, changes, SECONDS, values)


def test_the_change_of_a_picture_is_that_of_its_pattern_and_not_of_its_light():
    image = np.random.default_rng(5).uniform(0.0, 100.0, (16, 20))
    assert change(image, image + 7.0) == pytest.approx(0.0, abs=1e-12)
    moved = image.copy()
    moved[:4, :4] += 20.0
    share = 1 / 20
    assert change(image, moved) == pytest.approx(20.0 * np.sqrt(share * (1 - share)))
