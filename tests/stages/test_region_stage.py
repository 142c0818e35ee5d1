"""The automatic region of a whole test: later photographs, pixels that do not count, and when it is made again."""

import cv2
import numpy as np
import pytest

from dicflow.core.photographs.region import bounding_box, rasterise
from dicflow.kinds.images import Images
from dicflow.kinds.region import polygons_from_json
from dicflow.stages.region import Region

SHAPE = (240, 320)
SPECIMEN = (slice(60, 180), slice(90, 230))


def pattern(seed):
    grain = np.random.default_rng(seed).standard_normal((400, 480))
    smooth = cv2.GaussianBlur(grain, (0, 0), 1.8)
    return 128.0 + 60.0 * np.tanh(2.0 * smooth / smooth.std())


def photograph(shift=0, counts=None, seed=0):
    """A block in front of a wall; the block is moved to the right by whole pixels."""
    image = pattern(1)[: SHAPE[0], : SHAPE[1]].copy()
    rows, columns = SPECIMEN
    image[rows, columns.start + shift : columns.stop + shift] = pattern(2)[rows, columns]
    noisy = np.clip(image + np.random.default_rng(seed).normal(0.0, 1.0, SHAPE), 0, 255)
    return Images.write(np.round(noisy).astype(np.uint8), counts={} if counts is None else {"left": counts})


def pixels(product):
    return rasterise(polygons_from_json(product.attrs["polygons"]), SHAPE)


def is_specimen(mask):
    inside = np.zeros(SHAPE, bool)
    inside[SPECIMEN] = True
    return bool(not (mask & ~inside).any() and mask.sum() > 0.45 * inside.sum())


def test_a_later_photograph_tells_the_specimen_from_the_wall():
    assert is_specimen(pixels(Region().run(images=photograph(), images_early=[photograph(4, seed=1)])))


def test_the_first_photograph_with_enough_motion_counts():
    """At rest for two steps, then in motion; what comes after that plays no part."""
    early = [photograph(0, seed=1), photograph(1, seed=2), photograph(4, seed=3)]
    found = Region().run(images=photograph(), images_early=early)
    assert is_specimen(pixels(found))
    later = Region().run(images=photograph(), images_early=[*early, photograph(40, seed=4)])
    assert later.attrs == found.attrs


@pytest.mark.parametrize("early", [None, [photograph(0, seed=1)], [photograph(1, seed=1), photograph(1, seed=2)]])
def test_without_motion_everything_stays(early):
    mask = pixels(Region().run(images=photograph(), images_early=early))
    assert mask.mean() > 0.85


def test_a_given_region_takes_no_later_photograph():
    assert not Region(rectangle=(100, 70, 200, 150)).joins("images_early")
    assert Region().joins("images_early")
    assert Region(rectangle=(100, 70, 200, 150)).joins("rig")


def test_pixels_that_do_not_count_are_in_no_region():
    counts = np.ones(SHAPE, bool)
    counts[:, :140] = False
    counts[100:110, 180:190] = False
    for region in (Region(), Region(rectangle=(20, 20, 300, 220))):
        found = region.run(images=photograph(counts=counts))
        assert not (pixels(found) & ~counts).any()
        assert bounding_box(polygons_from_json(found.attrs["polygons"]))[0] >= 140
        assert pixels(found).sum() > 0.7 * counts.sum() - 3000


def test_pixels_that_all_count_change_nothing():
    counts = np.ones(SHAPE, bool)
    counts[:10] = False
    given = Region(rectangle=(100, 70, 200, 150))
    assert given.run(images=photograph(counts=counts)).attrs == given.run(images=photograph()).attrs
