"""Shares of fields whose parts are known."""

import numpy as np
import pytest

from dicflow.core.uncertainty.scatter import common_share, half_width, smooth_part, without_outliers


def grid(count=60):
    return np.stack(np.meshgrid(np.arange(count), np.arange(count)), axis=-1).reshape(-1, 2).astype(float)


@pytest.mark.parametrize("share", [0.0, 0.5, 0.9])
def test_the_common_share_is_that_of_the_field_that_all_steps_have(share):
    rng = np.random.default_rng(1)
    common, own = rng.normal(size=20_000), rng.normal(size=(4, 20_000))
    found = common_share(np.sqrt(share) * common + np.sqrt(1.0 - share) * own)
    assert found == pytest.approx(share, abs=0.02)


def test_a_slow_mode_is_smooth_and_noise_is_not():
    rng, places = np.random.default_rng(2), grid()
    mode = np.sin(places[:, 1] / 60.0 * 2.0) + 0.3 * (places[:, 0] / 30.0) ** 3
    noise = rng.normal(size=(2, len(places)))
    assert smooth_part([mode, 2.0 * mode], places) == pytest.approx(np.stack([mode, 2.0 * mode]), abs=0.01)
    # 21 coefficients take their share of the noise
    left = noise - smooth_part(noise, places)
    assert left.var() / noise.var() == pytest.approx(
        1.0 - 21 / len(places), abs=0.005
    )  # 21 coefficients take their share


def test_the_half_width_is_that_of_the_noise_and_not_of_outliers():
    rng = np.random.default_rng(3)
    noise = 2.5 * rng.normal(size=200_000) + 7.0
    assert half_width(noise) == pytest.approx(2.5, rel=0.01)
    noise[:2000] += 1e6
    assert half_width(noise) == pytest.approx(2.5, rel=0.03)
    assert np.abs(without_outliers([noise, -noise])).max() == pytest.approx(4 * half_width(noise))


def test_the_half_width_is_less_certain_than_a_standard_deviation_by_a_third():
    found = [half_width(one) for one in np.random.default_rng(4).normal(size=(2000, 500))]
    assert np.std(found) / (1.0 / np.sqrt(2 * 500)) == pytest.approx(1.36, abs=0.06)
