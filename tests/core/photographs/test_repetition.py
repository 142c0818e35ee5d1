"""Patterns that repeat themselves, and others."""

import cv2
import numpy as np
import pytest

from dicflow.core.photographs.repetition import repetition

SHAPE = (200, 280)
Y, X = np.mgrid[: SHAPE[0], : SHAPE[1]].astype(float)
EVERYWHERE = np.ones(SHAPE, dtype=bool)


def photographed(pattern, noise=2.0):
    """A pattern of 0 and 1 through a lens, with noise."""
    grey = cv2.GaussianBlur(40.0 + 170.0 * pattern.astype(float), (0, 0), 0.8)
    return np.clip(grey + np.random.default_rng(0).normal(0.0, noise, SHAPE), 0, 255).astype(np.uint8)


def lattice(first, second):
    """Dots at whole multiples of two vectors [px]."""
    vectors = np.array([first, second], dtype=float).T
    shares = np.linalg.inv(vectors) @ np.stack([X.ravel(), Y.ravel()])
    away = vectors @ (shares - np.rint(shares))
    return (np.hypot(*away) < 0.3 * np.hypot(*vectors).min()).reshape(SHAPE)


def speckles(size, seed):
    noise = np.random.default_rng(seed).standard_normal(SHAPE)
    return cv2.GaussianBlur(noise, (0, 0), size / 2.5) > 0.0


@pytest.mark.parametrize(
    ("first", "second", "period"),
    [
        ((14, 0), (0, 14), 14.0),
        ((12.1, 7.0), (-7.0, 12.1), 13.98),
        ((20, 0), (10, 17.3), 20.0),
        ((45, 0), (0, 45), 45.0),
        ((14, 0), (0, 23), 14.0),
    ],
)
def test_the_period_of_a_lattice(first, second, period):
    found = repetition(photographed(lattice(first, second)), EVERYWHERE)
    assert found.period_px == pytest.approx(period, abs=0.8)
    assert found.share == 1.0
    assert found.stripes_share == 0.0


def test_a_checkerboard_and_a_wavy_weave_repeat():
    assert repetition(photographed((X // 12 + Y // 12) % 2), EVERYWHERE).period_px == pytest.approx(17.0, abs=0.8)
    wave = 3.0 * np.sin(2.0 * np.pi * Y / 150.0)
    weave = np.sin(2.0 * np.pi * (X + wave) / 11.0) + np.sin(2.0 * np.pi * Y / 11.0) > 0.0
    assert repetition(photographed(weave), EVERYWHERE).period_px == pytest.approx(11.0, abs=0.8)


def test_a_random_stamp_repeats():
    stamp = np.tile(speckles(5.0, 3)[:90, :90], (3, 4))[: SHAPE[0], : SHAPE[1]]
    assert repetition(photographed(stamp), EVERYWHERE).period_px == pytest.approx(90.0, abs=0.8)


@pytest.mark.parametrize("angle_deg", [0.0, 30.0, 90.0])
def test_stripes(angle_deg):
    across = X * np.cos(np.deg2rad(angle_deg)) + Y * np.sin(np.deg2rad(angle_deg))
    assert repetition(photographed(across % 14.0 < 7.0), EVERYWHERE).stripes_share == 1.0


@pytest.mark.parametrize("size", [3.0, 5.0, 9.0, 16.0, 30.0])
def test_random_speckles_never_repeat(size):
    for seed in range(8):
        found = repetition(photographed(speckles(size, seed), noise=10.0), EVERYWHERE)
        assert np.isnan(found.period_px)
        assert found.share == found.stripes_share == 0.0


@pytest.mark.parametrize("seed", [478, 1141, 5198])
def test_the_highest_significant_shift_is_a_peak_beside_a_higher_one_that_is_not_significant(seed):
    rng = np.random.default_rng(seed)
    shape, period = rng.integers(24, 60, 2), rng.uniform(8, 20)
    y, x = np.mgrid[: shape[0], : shape[1]]
    grey = 100 + 60 * np.sin(2 * np.pi * x / period) * np.sin(2 * np.pi * y / period)
    grey = grey + rng.normal(0, rng.uniform(20, 80), shape)
    inside = cv2.GaussianBlur(rng.random(tuple(shape)), (0, 0), 4.0) > 0.48
    assert repetition(np.clip(grey, 0, 255).astype(np.uint8), inside).period_px > 0.0


def test_only_the_region_is_examined():
    left = X < 140
    mixed = photographed(np.where(left, lattice((14, 0), (0, 14)), speckles(5.0, 1)))
    assert repetition(mixed, left).share == 1.0
    assert repetition(mixed, ~left).share == 0.0
    assert repetition(mixed, np.zeros(SHAPE, dtype=bool)).share == 0.0
