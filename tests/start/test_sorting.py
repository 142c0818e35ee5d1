"""Photographs of two cameras under one sort of names, and ways to pair them: by paths, cameras and times alone."""

from __future__ import annotations

from pathlib import PurePosixPath

import pytest

from dicflow.errors import InputError
from dicflow.start.cameras import Evidence, pairs_of
from dicflow.start.layouts import Series, series_of
from dicflow.start.sorting import copied_from, copies_in, parted_by_counter
from dicflow.start.ways import chosen_way, ways_to_pair

MOMENTS = [0.0, 11.0, 40.0, 55.0, 63.0, 90.0]


def paths(pattern, first, count=6):
    return [PurePosixPath(pattern.format(k)) for k in range(first, first + count)]


def series(pattern, first, count=6):
    return Series(tuple(paths(pattern, first, count)), ())


def clock(*sides):
    """When photographs were taken, by the series and what their clock shows more."""
    times = {path: moment + ahead for files, ahead in sides for path, moment in zip(files, MOMENTS, strict=False)}
    return times.get


@pytest.mark.parametrize(
    ("name", "original"),
    [
        ("IMG_2301 (1).jpg", "IMG_2301.jpg"),
        ("IMG_2301(2).jpg", "IMG_2301.jpg"),
        ("IMG_2301 - Kopie.jpg", "IMG_2301.jpg"),
        ("IMG_2301 - Copy (2).jpg", "IMG_2301.jpg"),
        ("IMG_2301 copy.jpg", "IMG_2301.jpg"),
        ("IMG_2301_1.jpg", None),
        ("Ensayo (1).jpg", None),
    ],
)
def test_names_of_copies(name, original):
    known = {PurePosixPath(f"a/{one}") for one in ("IMG_2301.jpg", name)}
    found = copied_from(PurePosixPath(f"a/{name}"), known)
    assert found == (original and PurePosixPath(f"a/{original}"))


def test_a_copy_is_left_out_and_a_photograph_of_the_other_phone_is_not(tmp_path):
    """Both phones count to the same number, and a file manager gave the second file another name."""
    for name, content in (("a.jpg", b"1"), ("a (1).jpg", b"1"), ("b.jpg", b"2"), ("b (1).jpg", b"3")):
        (tmp_path / name).write_bytes(content)
    files = sorted(PurePosixPath(path.name) for path in tmp_path.iterdir())
    assert copies_in(tmp_path, files, lambda path: "", lambda path: None) == [PurePosixPath("a (1).jpg")]
    cameras = {PurePosixPath("b (1).jpg"): "Pixel 7"}
    found = copies_in(tmp_path, files, lambda path: cameras.get(path, "iPhone 12"), lambda path: 5.0)
    assert found == [PurePosixPath("a (1).jpg")]


def test_photographs_of_two_models_are_two_series_which_are_a_pair():
    one, other = paths("IMG_{:04}.jpg", 2301), paths("IMG_{:04}.jpg", 412)
    found = series_of([*one, *other], lambda path: "Apple iPhone 12" if path in one else "Google Pixel 7")
    assert {(part.files, part.camera) for part in found} == {
        (tuple(one), "Apple iPhone 12"),
        (tuple(other), "Google Pixel 7"),
    }
    (pair,) = pairs_of(found)
    assert (pair.left.files, pair.right.files) == (tuple(one), tuple(other))
    assert pair.evidence == Evidence.DEVICE


def test_two_phones_of_one_model_are_parted_where_the_counter_jumps_and_the_times_overlap():
    one, other = paths("IMG_{:04}.jpg", 412), paths("IMG_{:04}.jpg", 2301)
    (whole,) = series_of([*one, *other])
    found = parted_by_counter(whole, clock((one, 0.0), (other, 1.0)))
    assert [part.files for part in found] == [tuple(one), tuple(other)]
    assert len({part.camera for part in found}) == 2
    later = parted_by_counter(whole, clock((one, 0.0), (other, 500.0)))
    assert later == [whole], "one camera, which took other photographs meanwhile"


def test_without_times_a_large_jump_makes_two_series_that_are_asked_about():
    (whole,) = series_of([*paths("IMG_{:04}.jpg", 412), *paths("IMG_{:04}.jpg", 2301)])
    found = parted_by_counter(whole, lambda path: None)
    assert [len(part.files) for part in found] == [6, 6]
    assert {part.camera for part in found} == {""}
    (near,) = series_of([*paths("IMG_{:04}.jpg", 412), *paths("IMG_{:04}.jpg", 430)])
    assert parted_by_counter(near, lambda path: None) == [near]


def test_ways_to_pair_names_that_do_not_agree():
    left, right = series("IMG_{:04}.jpg", 2301), series("DSC_{:04}.jpg", 7)
    ways = ways_to_pair(left, right, clock((left.files, 0.0), (right.files, 3713.0)))
    assert [way.by for way in ways] == ["taken", "order"]
    assert ways[0].pairs == ways[1].pairs == tuple(zip(left.files, right.files, strict=True))
    assert ways[0].words == "by the time when they were taken (the right camera's clock is 1 h 2 min ahead)"


def test_a_photograph_that_one_phone_lacks_is_left_out_by_the_times():
    left, right = series("IMG_{:04}.jpg", 2301), series("DSC_{:04}.jpg", 7, 5)
    lacks = [moment for k, moment in enumerate(MOMENTS) if k != 2]
    times = clock((left.files, 0.0)).__self__ | dict(zip(right.files, [moment - 70.0 for moment in lacks], strict=True))
    way = chosen_way(left, right, times.get, None)
    assert [a.name for a, _ in way.pairs] == [f"IMG_{k}.jpg" for k in (2301, 2302, 2304, 2305, 2306)]
    assert [path.name for path in way.alone] == ["IMG_2303.jpg"]
    assert "70.0 s behind; without a partner, left out: IMG_2303.jpg" in way.words


def test_order_must_be_confirmed_unless_the_counters_run_alike():
    left = series("IMG_{:04}.jpg", 2301)
    alike, unlike = series("DSC_{:04}.jpg", 7), series("DSC_{:04}.jpg", 7, 7)
    unlike = unlike._replace(files=(*unlike.files[:3], *unlike.files[4:]))
    assert chosen_way(left, alike, lambda path: None, None).by == "order"
    with pytest.raises(
        InputError, match=r"--pair-by order pairs IMG_2301\.jpg with DSC_0007\.jpg … IMG_2306\.jpg with DSC_0013"
    ):
        chosen_way(left, unlike, lambda path: None, None)
    assert chosen_way(left, unlike, lambda path: None, "order").pairs[-1][1].name == "DSC_0013.jpg"
    with pytest.raises(InputError, match="6 left and 7 right photographs: cannot be paired in their order"):
        chosen_way(left, series("DSC_{:04}.jpg", 7, 7), lambda path: None, "order")


def test_names_that_agree_come_first():
    left, right = series("left/{:02}.png", 0), series("right/{:02}.png", 0)
    assert chosen_way(left, right, clock((left.files, 0.0), (right.files[::-1], 9.0)), None).by == "name"
