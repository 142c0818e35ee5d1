"""A specimen in front of a patterned wall: drawn from two random patterns, so that each pixel's part is known."""

import cv2
import numpy as np
import pytest

from dicflow.core.matching import background
from dicflow.core.matching.background import estimate_motion, still_background
from dicflow.core.photographs.region import rasterise, speckled_region
from dicflow.core.photographs.texture import speckled_points, texture

pytestmark = pytest.mark.slow

SHAPE = (300, 400)
FINER = 3
Y, X = (axis.astype(np.float32) for axis in np.mgrid[: SHAPE[0] * FINER, : SHAPE[1] * FINER])
X, Y = (X + 0.5) / FINER - 0.5, (Y + 0.5) / FINER - 0.5


def pattern(seed):
    """Dark blobs of about 4 px on a bright ground, larger than the photograph."""
    grain = np.random.default_rng(seed).standard_normal((700 * FINER, 800 * FINER)).astype(np.float32)
    smooth = cv2.GaussianBlur(grain, (0, 0), 1.7 * FINER)
    return np.float32(40.0) + np.float32(170.0) / (1.0 + np.exp(-3.0 * smooth / smooth.std()))


SPECIMEN, WALL = pattern(1), pattern(2)


def look(ground, x, y):
    places = np.stack([(x + 200.0) * FINER, (y + 200.0) * FINER], axis=-1).astype(np.float32)
    return cv2.remap(ground, places, None, cv2.INTER_LINEAR)


def photograph(back=lambda x, y: (x, y), shape=lambda x, y: x > -1e9, wall=True, seed=0):
    """The grey levels, and which pixels show the specimen. back : place in the photograph → place on the specimen."""
    x, y = back(X, Y)
    inside = shape(x, y)
    image = np.where(inside, look(SPECIMEN, x, y), look(WALL, X, Y) if wall else np.float32(60.0))
    grey, share = (cv2.resize(np.float32(part), SHAPE[::-1], interpolation=cv2.INTER_AREA) for part in (image, inside))
    noisy = grey + np.random.default_rng(seed).normal(0.0, 1.5, SHAPE)
    return np.clip(np.round(noisy), 0, 255).astype(np.uint8), share > 0.5


def shift(u, v):
    return lambda x, y: (x - u, y - v)


def turn(degrees):
    c, s = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    return lambda x, y: (200 + c * (x - 200) + s * (y - 150), 150 - s * (x - 200) + c * (y - 150))


def pulled(strain, below):
    """Held above a line, stretched below it."""
    return lambda x, y: (x, np.where(y < below, y, below + (y - below) / (1.0 + strain)))


def box(x0, y0, x1, y1):
    return lambda x, y: (x > x0) & (x < x1) & (y > y0) & (y < y1)


BLOCK, STRIP = box(110, 70, 290, 230), box(110, -999, 290, 999)


def region_of(first, later):
    """Pixels of the automatic region; None where the motion is too small to tell what stands behind."""
    found = texture(first)
    seen = speckled_points(found)
    still = still_background(first, [later], seen)
    return None if still is None else rasterise(speckled_region(found, still), first.shape)


def assert_is(region, specimen, core_missed=0.03):
    """Nothing but the specimen, and nearly all of its part at more than half a window from its edge."""
    core = cv2.erode(specimen.astype(np.uint8), np.ones((37, 37), np.uint8)) > 0
    assert not (region & ~specimen).any()
    assert (core & ~region).sum() < core_missed * core.sum()


@pytest.mark.parametrize(
    ("back", "shape"),
    [
        (shift(3.3, -1.7), BLOCK),
        (shift(0.0, 2.6), STRIP),
        (shift(-24.0, 12.0), BLOCK),
        (turn(4.0), BLOCK),
        (pulled(0.05, 0), STRIP),
    ],
    ids=["shifted", "strip", "far", "turned", "stretched"],
)
def test_a_wall_behind_the_specimen_is_left_out(back, shape):
    first, specimen = photograph(shape=shape, seed=1)
    later, _ = photograph(back, shape, seed=2)
    assert_is(region_of(first, later), specimen, core_missed=0.08)


@pytest.mark.parametrize("strain", [0.015, 0.05, 0.25, 0.5])
def test_the_end_at_the_grip_is_part_of_the_specimen(strain):
    first, specimen = photograph(shape=STRIP, wall=False, seed=1)
    later, _ = photograph(pulled(strain, 90), STRIP, wall=False, seed=2)
    assert_is(region_of(first, later), specimen)


def test_a_held_specimen_in_front_of_a_wall():
    """The wall beside the grip moves as little as the grip; the border below it, continued, parts them."""
    first, specimen = photograph(shape=STRIP, seed=1)
    later, _ = photograph(pulled(0.05, 90), STRIP, seed=2)
    assert_is(region_of(first, later), specimen, core_missed=0.1)


@pytest.mark.parametrize("motion", [0.0, 0.4, 1.2])
def test_of_a_motion_below_two_pixels_nothing_is_said(motion):
    first, _ = photograph(shape=BLOCK, seed=1)
    assert region_of(first, photograph(shift(motion, 0.3 * motion), BLOCK, seed=2)[0]) is None


def test_of_photographs_at_rest_only_halves_are_compared(monkeypatch):
    """A part of 2 % that moves by 3 px is seen in these already."""
    first, _ = photograph(seed=1)
    compared, dense = [], background._dense_motion

    def counted(before, *rest):
        compared.append(before.shape)
        return dense(before, *rest)

    monkeypatch.setattr(background, "_dense_motion", counted)
    assert region_of(first, photograph(shift(0.3, 0.1), seed=2)[0]) is None
    assert compared == [(150, 200)]
    part = box(180, 130, 240, 170)
    later, _ = photograph(shift(3.0, 0.0), part, seed=2)
    first, _ = photograph(shape=part, seed=1)
    region_of(first, later)
    assert compared[1:3] == [(150, 200), SHAPE]


def test_a_pattern_that_moves_as_a_whole_has_no_background():
    first, _ = photograph(seed=1)
    later, _ = photograph(shift(4.0, 2.0), seed=2)
    whole = rasterise(speckled_region(texture(first)), SHAPE)
    np.testing.assert_array_equal(region_of(first, later), whole)


def test_a_still_part_across_bare_surface_is_background():
    """The smaller one moves, so it is the specimen."""
    both = lambda x, y: box(20, 40, 200, 260)(x, y) | box(270, 60, 380, 240)(x, y)  # noqa: E731
    first, _ = photograph(shape=both, wall=False, seed=1)
    moved = lambda x, y: (np.where(x > 235, x - 3.0, x), y)  # noqa: E731
    later, _ = photograph(moved, both, wall=False, seed=2)
    _, specimen = photograph(shape=box(270, 60, 380, 240), wall=False)
    assert_is(region_of(first, later), specimen)


def test_a_held_specimen_beside_a_larger_part_that_stands_still():
    """A machine across bare surface; the specimen's end at the grip stays, and the machine does not."""
    held, machine = box(270, -999, 380, 999), box(-999, -999, 220, 999)
    both = lambda x, y: held(x, y) | machine(x, y)  # noqa: E731
    first, _ = photograph(shape=both, wall=False, seed=1)
    stretched = lambda x, y: (x, np.where((x > 245) & (y > 90), 90 + (y - 90) / 1.05, y))  # noqa: E731
    later, _ = photograph(stretched, both, wall=False, seed=2)
    _, specimen = photograph(shape=held, wall=False)
    assert_is(region_of(first, later), specimen, core_missed=0.05)


def test_deeper_and_larger_photographs_have_the_same_background():
    first, specimen = photograph(shape=BLOCK, seed=1)
    later, _ = photograph(shift(3.3, -1.7), BLOCK, seed=2)
    deep = [image.astype(np.uint16) * 100 + 3000 for image in (first, later)]
    assert_is(region_of(*deep), specimen)
    large = [cv2.resize(image, (2000, 1500), interpolation=cv2.INTER_CUBIC) for image in (first, later)]
    found = cv2.resize(region_of(*large).astype(np.uint8), SHAPE[::-1], interpolation=cv2.INTER_AREA) > 0
    assert (found & specimen).sum() > 0.6 * specimen.sum()
    assert not (found & ~specimen).any()


def test_the_motion_is_that_of_the_photographs():
    first, _ = photograph(seed=1)
    for u, v in ((0.0, 0.0), (3.3, -1.7), (-24.0, 12.0)):
        found = estimate_motion(first, photograph(shift(u, v), seed=2)[0], np.ones((75, 100), bool))
        inner = (slice(15, -15), slice(15, -15))
        assert found.known[inner].all()
        np.testing.assert_allclose(found.shift[inner].mean(axis=(0, 1)), (u, v), atol=0.1)
