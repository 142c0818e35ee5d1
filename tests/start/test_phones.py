"""Photographs of two phones in one folder, as a student copies them there."""

from __future__ import annotations

import shutil

import pytest
from small import dicflow

from dicflow.io.configuration import parse
from tests.phones import ALIKE, UNLIKE, taken_by_phones

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("boards_recognised_once")]
SMALL = {"steps": 4, "boards": 4}


def stages(folder):
    return parse((folder / "pipeline.yaml").read_text(), "pipeline.yaml").data["stages"]


def numbered(pattern, *numbers):
    return [pattern.format(number) for number in numbers]


def test_unlike_names_are_paired_by_the_time_and_copies_are_left_out(tmp_path):
    """The right phone lacks one photograph, and two photographs of the left one were copied twice."""
    folder = taken_by_phones(tmp_path / "test", missing=(5,), **SMALL)
    for name in ("IMG_2301", "IMG_2306"):
        shutil.copy(folder / f"{name}.jpg", folder / f"{name} (1).jpg")
    answer = dicflow("init", folder, "--square", "14.5 mm")
    assert answer.code == 0, answer.err
    found = stages(folder)
    assert found["photos"]["left"] == numbered("IMG_{:04}.jpg", 2305, 2307, 2308)
    assert found["photos"]["right"] == numbered("DSC_{:04}.jpg", 11, 12, 13)
    assert found["photos"]["pair_by"] == "order"
    assert found["boards"]["left"] == numbered("IMG_{:04}.jpg", 2301, 2302, 2303, 2304)
    assert "3 pairs by the time when they were taken (the right camera's clock is 1 h 2 min ahead" in answer.out
    assert "without a partner, left out: IMG_2306.jpg" in answer.out
    assert "left out: 2 copies of photographs, IMG_2301 (1).jpg, IMG_2306 (1).jpg" in answer.out


@pytest.mark.parametrize("model", ["Pixel 7", "iPhone 12"])
def test_both_phones_name_their_photographs_alike(tmp_path, model):
    """Also where both are of one model."""
    folder = taken_by_phones(tmp_path / "test", (ALIKE[0], ALIKE[1]._replace(model=model)), **SMALL)
    answer = dicflow("init", folder, "--square", "14.5 mm")
    assert answer.code == 0, answer.err
    sides = [numbered("IMG_{:04}.jpg", *range(first + 4, first + 8)) for first in (2301, 412)]
    assert sorted([stages(folder)["photos"]["left"], stages(folder)["photos"]["right"]]) == sorted(sides)
    assert len(stages(folder)["boards"]["left"]) == 4


def test_a_number_that_both_phones_have_used_is_no_copy(tmp_path):
    """A file manager has given the files of the right phone other names."""
    folder = taken_by_phones(tmp_path / "test", **SMALL)
    for k in range(8):
        other = 2304 + k
        name = f"IMG_{other} (1).jpg" if other <= 2308 else f"IMG_{other}.jpg"
        (folder / f"DSC_{7 + k:04}.jpg").rename(folder / name)
    answer = dicflow("init", folder, "--square", "14.5 mm")
    assert answer.code == 0, answer.err
    photos = stages(folder)["photos"]
    names = ["IMG_2308 (1).jpg", *numbered("IMG_{}.jpg", 2309, 2310, 2311)]
    assert [photos["left"], photos["right"]] == [numbered("IMG_{}.jpg", 2305, 2306, 2307, 2308), names]
    assert "copies" not in answer.out


def test_without_metadata_somebody_is_asked_and_order_must_be_confirmed(tmp_path):
    """A messenger takes away when and by what photographs were taken; the right counter has jumped once."""
    phones = tuple(phone._replace(model="") for phone in UNLIKE)
    folder = taken_by_phones(tmp_path / "test", phones, missing=(5,), **SMALL)
    (folder / "DSC_0013.jpg").rename(folder / "DSC_0019.jpg")
    (folder / "IMG_2306.jpg").unlink()
    asked = dicflow("init", folder)
    assert asked.code == 2
    assert "2 series of the specimen look alike (3, 3 photographs)" in asked.err
    options = [*("--left", "IMG_*.jpg"), *("--right", "DSC_*.jpg")]
    refused = dicflow("init", folder, *options)
    assert refused.code != 0
    assert "--pair-by order pairs IMG_2305.jpg with DSC_0011.jpg … IMG_2308.jpg with DSC_0019.jpg" in refused.err
    answer = dicflow("init", folder, *options, "--pair-by", "order")
    assert answer.code == 0, answer.err
    assert stages(folder)["photos"]["right"] == numbered("DSC_{:04}.jpg", 11, 12, 19)
