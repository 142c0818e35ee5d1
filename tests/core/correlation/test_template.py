"""The pixels of subsets: of their own part of the region, and measured in both photographs."""

import numpy as np
import pytest

from dicflow.core.correlation.search import without_mixed_rim
from dicflow.core.correlation.subsets import Subset, correlate, residuals
from dicflow.core.correlation.template import template
from dicflow.core.correlation.warp import identity
from dicflow.core.photographs.interpolate import spline
from dicflow.core.status import Status
from dicflow.core.synthetic.planar import planar_pair

SIZE = (90, 80)
CENTRE = np.array([[45.0, 40.0]])
SHIFT = np.array([0.4, -0.3])


def pair():
    found = planar_pair(SIZE, SHIFT, diameter=(3.0, 5.0), coverage=0.5)
    return found.reference.astype(np.float32), found.deformed.astype(np.float32)


def region_with_gap(rows):
    region = np.ones(SIZE[::-1], dtype=bool)
    region[rows] = False
    return region


def pixels_of_subset(region):
    """The pixels (21, 21) that count in the subset around the centre."""
    photograph = spline(pair()[0])
    found = residuals(template(photograph, region), photograph, CENTRE.astype(np.int64), identity(CENTRE), Subset(21))
    return found.weight.reshape(21, 21) > 0.0


def test_a_subset_keeps_to_the_side_of_its_centre():
    gap = region_with_gap(slice(44, 47))
    mask = pixels_of_subset(gap)
    assert mask[:14].all()  # rows 30 to 43
    assert not mask[14:].any()
    around = gap.copy()
    around[44:47, 50:] = True  # the gap ends inside the square: both sides belong together
    mask = pixels_of_subset(around)
    np.testing.assert_array_equal(mask, around[30:51, 35:56])


@pytest.mark.parametrize("where", ["template", "target", "both"])
def test_pixels_that_are_not_measured_change_nothing(where):
    """With any contents of theirs, the place stays that of the others."""
    clean = pair()
    hidden = np.zeros(SIZE[::-1], dtype=bool)
    hidden[34:44, 38:50] = True
    images, masks = [image.copy() for image in clean], [None, None]
    for k in {"template": (0,), "target": (1,), "both": (0, 1)}[where]:
        images[k][hidden] = 255.0
        masks[k] = ~hidden
    first, second = (spline(image, 3, mask) for image, mask in zip(images, masks, strict=True))
    found = correlate(template(first), second, CENTRE, identity(CENTRE + 1.0), Subset(25))
    assert found.status[0] == Status.VALID
    np.testing.assert_allclose(found.warp[0, :, 0] - CENTRE[0], SHIFT, atol=0.04)  # the spline smears what is hidden
    fooled = correlate(template(spline(images[0], 3)), spline(images[1], 3), CENTRE, identity(CENTRE + 1.0), Subset(25))
    assert not np.allclose(fooled.warp[0, :, 0] - CENTRE[0], SHIFT, atol=0.05)


@pytest.mark.parametrize(("side", "status"), [(16, Status.VALID), (23, Status.OVEREXPOSED)])
def test_a_subset_needs_a_quarter_of_its_pixels(side, status):
    measured = np.ones(SIZE[::-1], dtype=bool)
    measured[28 : 28 + side, 33:58] = False
    image = spline(pair()[0], 3, measured)
    assert correlate(template(image), image, CENTRE, identity(CENTRE), Subset(25)).status[0] == status


def test_where_all_pixels_are_measured_a_mask_changes_no_bit():
    images, everywhere = pair(), np.ones(SIZE[::-1], dtype=bool)
    plain = correlate(template(spline(images[0])), spline(images[1]), CENTRE, identity(CENTRE), Subset(25))
    first, second = (spline(image, measured=everywhere) for image in images)
    masked = correlate(template(first, everywhere), second, CENTRE, identity(CENTRE), Subset(25))
    for one, other in zip(plain, masked, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("blur", "width"), [(0.0, 0), (0.6, 0), (1.5, 1), (3.0, 2), (4.5, 3)])
def test_pixels_at_a_rim_that_a_blur_mixes_do_not_count(blur, width):
    """Seven tenths of its standard deviation; the subset stays part of the same region."""
    photograph, region = spline(pair()[0]), region_with_gap(slice(50, None))
    whole = template(photograph, region)
    inner = without_mixed_rim(whole, blur)
    found = residuals(inner, photograph, CENTRE.astype(np.int64), identity(CENTRE), Subset(21))
    rows = (found.weight.reshape(21, 21) > 0.0).all(axis=1)  # 30 to 50
    assert rows.tolist() == [True] * (20 - width) + [False] * (1 + width)
    np.testing.assert_array_equal(inner.region, region)
    assert (inner is whole) == (width == 0)
