"""Which photograph a point has left: from the status of the points in each."""

from __future__ import annotations

import numpy as np

from dicflow.core.status import Status
from dicflow.explorer.entries import reasons
from dicflow.explorer.outside import Outside, status_by_photograph

VALID, OUT, LOST = int(Status.VALID), int(Status.OUTSIDE), int(Status.UNTRACKED)


def test_each_photograph_and_the_region_have_a_code_of_their_own():
    """In order: valid, outside the region, left, right, right at the first step, and lost for another reason."""
    status = np.array([[VALID, OUT, OUT, OUT, OUT, LOST]], dtype=np.uint8)
    inside = np.array([[True, False, True, True, True, True]])
    left = np.array([[VALID, OUT, OUT, VALID, VALID, LOST]], dtype=np.uint8)
    right = np.array([[VALID, OUT, OUT, OUT, OUT, LOST]], dtype=np.uint8)
    first = np.array([[VALID, OUT, VALID, VALID, OUT, VALID]], dtype=np.uint8)
    found = status_by_photograph(status, inside, left, right, first)
    assert found.tolist() == [[VALID, OUT, Outside.LEFT, Outside.RIGHT, Outside.FIRST_RIGHT, LOST]]
    assert status.tolist() == [[VALID, OUT, OUT, OUT, OUT, LOST]], "the product is not changed"


def test_one_camera_has_a_left_photograph_alone():
    status, inside = np.array([[OUT, OUT]], dtype=np.uint8), np.array([[True, False]])
    assert status_by_photograph(status, inside, status, None, None).tolist() == [[Outside.LEFT, OUT]]


def test_every_code_has_words_and_a_colour():
    found = {one["code"]: one for one in reasons()}
    assert found[OUT]["label"] == "outside the region"
    assert found[Outside.RIGHT]["label"] == "outside the right photograph"
    assert found[Outside.FIRST_RIGHT]["sentence"].startswith(
        "Its subset reaches beyond the right photograph of the first"
    )
    assert all(one["sentence"].endswith(".") for one in found.values())
    assert all(found[code]["colour"].startswith("#") for code in Outside)
    assert len({found[code]["colour"] for code in found if code}) == len(found) - 2, "left keeps the colour of outside"
