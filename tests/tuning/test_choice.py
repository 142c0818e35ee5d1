"""What is recommended of trials with given figures, and what is said where nothing can be."""

from __future__ import annotations

import pytest

from dicflow.core.strain.gauge_kernel import GaugeSetting
from dicflow.errors import ConfigurationError
from dicflow.kinds.total import Gauge
from dicflow.tuning.choice import Wish, choose, pareto_front, strain_text, wish
from dicflow.tuning.trials import Trial


def trial(side, noise, bias, points=1000):
    """A gauge of a side [px], of 0.1 mm each; strains in µε."""
    setting = GaugeSetting(21, 5, "affine", int(side) // 5, 1)
    return Trial(setting, Gauge(side, 0.1 * side), 1e-6 * noise, None, 1e-6 * bias, points)


SMALL, MIDDLE, LARGE = trial(20, 900, 10), trial(40, 300, 150), trial(80, 90, 800)
WORSE = trial(45, 400, 200)
TRIED = [SMALL, WORSE, MIDDLE, LARGE]


def test_the_least_error_wins_and_not_the_least_noise():
    assert choose(TRIED, Wish()).trial is MIDDLE


def test_of_equal_errors_the_fewest_points_win():
    fast = trial(40, 303, 150, points=300)
    assert choose([*TRIED, fast], Wish()).trial is fast


@pytest.mark.parametrize(("resolve", "expected"), [("3 mm", SMALL), ("40 px", MIDDLE), ("1 cm", LARGE)])
def test_the_least_noise_in_a_gauge(resolve, expected):
    assert choose(TRIED, wish(resolve, None)).trial is expected


@pytest.mark.parametrize(("noise", "expected"), [("1000e-6", SMALL), ("500 µε", MIDDLE), ("0.01 %", LARGE)])
def test_the_smallest_gauge_of_a_noise(noise, expected):
    assert choose(TRIED, wish(None, noise)).trial is expected


def test_both_wishes():
    assert choose(TRIED, wish("4.5 mm", "500 µε")).trial is MIDDLE
    impossible = choose(TRIED, wish("3 mm", "500 µε"))
    assert impossible.trial is None
    for fact in ("500 µε", "3 mm", "900 µε", "20 px = 2 mm", "40 px = 4 mm"):
        assert fact in impossible.reason


def test_a_gauge_smaller_than_all():
    impossible = choose(TRIED, wish("10 px", None))
    assert impossible.trial is None
    assert "20 px = 2 mm" in impossible.reason


def test_a_noise_below_all():
    impossible = choose(TRIED, wish(None, "50 µε"))
    assert impossible.trial is None
    assert "90 µε" in impossible.reason


@pytest.mark.parametrize(("resolve", "noise"), [("3", None), ("-3 mm", None), ("3 s", None), (None, "x"), (None, "0")])
def test_other_texts_are_refused(resolve, noise):
    with pytest.raises(ConfigurationError, match="such as"):
        wish(resolve, noise)


def test_the_front_falls_and_leaves_out_what_is_worse():
    assert pareto_front(TRIED) == [SMALL, MIDDLE, LARGE]


def test_the_larger_of_measured_and_predicted_noise_counts():
    assert MIDDLE._replace(measured=4e-4).error == pytest.approx((16e-8 + 2.25e-8) ** 0.5)
    assert MIDDLE._replace(measured=1e-4).noise == MIDDLE.predicted


def test_strains_for_people():
    assert [strain_text(strain) for strain in (180.4e-6, 0.0021, 0.5)] == ["180 µε", "0.21 %", "50 %"]
